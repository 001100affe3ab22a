"""Unit systems: explicit choices, converted to SI at the edge, never guessed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from flexplant.errors import InputError, expect, expect_text, nearest
from flexplant.model.arrays import FloatArray, Matrix, is_finite, is_number
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes
from flexplant.model.recovery import Recovery


@dataclass(frozen=True)
class UnitSystem:
    """A consistent mechanical unit system: one unit of length in metres, of mass in kilograms; time is the second.

    mass_factor: the file's mass numbers are multiplied by this to be in the unit of mass, as by Nastran's PARAM,WTMASS:
    1 / g where mass is written as weight. Stiffness and damping are in consistent units all the same.
    """

    name: str
    length: float
    mass: float
    mass_factor: float = 1.0

    def __post_init__(self) -> None:
        expect_text(self.name, "unit system: name")
        for kind in ("length", "mass", "mass_factor"):
            value = getattr(self, kind)
            if not (is_finite(value) and value > 0):
                raise InputError(f"unit system {self.name!r}: {kind} must be a positive number, got {value!r:.60}")

    @property
    def force(self) -> float:
        """One unit of force, newtons."""
        return self.mass * self.length


UNSTATED = "not stated"  # `units` of a component or model from a file that does not say; numbers as in the file
INCH, POUND_FORCE, GRAVITY = 0.0254, 4.4482216152605, 9.80665
SI = UnitSystem("SI", 1.0, 1.0)
UNIT_SYSTEMS = {
    u.name: u
    for u in (
        SI,
        UnitSystem("mm-tonne-s", 1e-3, 1e3),
        UnitSystem("mm-kg-s", 1e-3, 1.0),
        UnitSystem("inch-slinch-s", INCH, POUND_FORCE / INCH),
        UnitSystem("inch-lbf", INCH, POUND_FORCE / INCH, mass_factor=INCH / GRAVITY),  # mass as weight: g = 386.0886 in/s^2
        UnitSystem("ft-slug-s", 0.3048, POUND_FORCE / 0.3048),
    )
}


def unit_system(units: str | UnitSystem | tuple[float, float]) -> UnitSystem:
    """A preset by name, or (length in m, mass in kg); InputError names the presets.

    "inch-lbf": inch, pound-force, second, with mass written as weight in lbf (density in lbf/in^3, no PARAM,WTMASS in the run).
    """
    if isinstance(units, UnitSystem):
        return units
    if isinstance(units, str):
        if units in UNIT_SYSTEMS:
            return UNIT_SYSTEMS[units]
        raise InputError(f"unknown unit system {units!r}." + nearest(units, UNIT_SYSTEMS))
    pair = list(units) if isinstance(units, (tuple, list)) else []
    if len(pair) != 2 or not all(is_number(value) and 0 < value < np.inf for value in pair):
        raise InputError(f"unit system: a preset or two positive numbers (length in m, mass in kg) are needed, got {units!r}")
    length, mass = pair
    return UnitSystem(f"{length} m, {mass} kg", float(length), float(mass))


def _old_per_si(dofs: DofSet, units: UnitSystem) -> FloatArray:
    """d with u_old = d * u_SI: translations 1/L, rotations 1, modal coordinates 1/(sqrt(M f) L), f the factor of mass."""
    scale = np.ones(len(dofs))
    scale[(dofs.direction >= 1) & (dofs.direction <= 3)] = 1 / units.length
    scale[dofs.direction == 0] = 1 / (np.sqrt(units.mass * units.mass_factor) * units.length)
    return scale


def _scaled(matrix: Matrix | None, d: FloatArray, energy: float) -> Matrix | None:
    if matrix is None:
        return None
    if sp.issparse(matrix):
        return sp.csr_array(sp.diags_array(energy * d) @ matrix @ sp.diags_array(d))
    return energy * d[:, None] * matrix * d[None, :]


def _nodes_to_si(nodes: Nodes | None, units: UnitSystem) -> Nodes | None:
    return None if nodes is None else replace(nodes, positions=nodes.positions * units.length)


def _recovery_to_si(recovery: Recovery, d: FloatArray) -> Recovery:
    """Columns only: the rows' own quantity stays in the file's units, as their `units` text says."""

    def scaled(matrix: Matrix | None) -> Matrix | None:
        return None if matrix is None else (matrix @ sp.diags_array(d) if sp.issparse(matrix) else matrix * d)

    return replace(
        recovery,
        displacement=scaled(recovery.displacement),
        velocity=scaled(recovery.velocity),
        acceleration=scaled(recovery.acceleration),
    )


def _interior_to_si(component: Component, d: FloatArray, units: UnitSystem) -> Matrix | None:
    """Displacement rows: columns as the coordinates, rows as the DOF they give."""
    if component.interior_rows is None:
        return None
    own = sp.diags_array(1 / _old_per_si(component.interior, units))
    scaled = own @ component.interior_rows @ sp.diags_array(d)
    return sp.csr_array(scaled) if sp.issparse(scaled) else np.asarray(scaled)


def component_to_si(component: Component, units: str | UnitSystem | tuple[float, float]) -> Component:
    """The component converted to SI: energy scales by M L^2, so Mqq = I and frequencies stay as they are.

    Mass written as weight ("inch-lbf") is divided by g: all frequencies, those of Kqq too, are then sqrt(g) times the file's.
    Recovery rows keep the file's own row units (a stress row cannot be told from a displacement row).
    """
    expect(component, Component, "component_to_si", "read_component gives one, craig_bampton reduces a model to one")
    system = unit_system(units)
    d, energy = _old_per_si(component.dofs, system), system.mass * system.length**2
    return replace(
        component,
        mass=_scaled(component.mass, d, energy * system.mass_factor),
        stiffness=_scaled(component.stiffness, d, energy),
        damping=_scaled(component.damping, d, energy),
        structural_damping=_scaled(component.structural_damping, d, energy),
        interior_rows=_interior_to_si(component, d, system),
        nodes=_nodes_to_si(component.nodes, system),
        recovery={r.name: _recovery_to_si(r, d) for r in component.recovery.values()},
        units="SI",
    )


def model_to_si(model: FiniteElementModel, units: str | UnitSystem | tuple[float, float]) -> FiniteElementModel:
    """The finite-element model converted to SI, see `component_to_si`."""
    expect(model, FiniteElementModel, "model_to_si", "read_model gives one from a file")
    system = unit_system(units)
    d, energy = _old_per_si(model.dofs, system), system.mass * system.length**2
    return replace(
        model,
        mass=_scaled(model.mass, d, energy * system.mass_factor),
        stiffness=_scaled(model.stiffness, d, energy),
        damping=_scaled(model.damping, d, energy),
        nodes=_nodes_to_si(model.nodes, system),
        units="SI",
    )
