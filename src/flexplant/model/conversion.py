"""Components and finite-element models in SI: matrices, positions, and the recovery rows whose quantity is known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from flexplant.errors import InputError, expect
from flexplant.model.arrays import FloatArray, Matrix
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes
from flexplant.model.recovery import Recovery
from flexplant.model.recovery_units import displacement_units, recovery_in_si
from flexplant.model.units import SI, UNIT_SYSTEMS, UNSTATED, UnitSystem, unit_system

Units: TypeAlias = str | UnitSystem | tuple[float, float]


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


def _interior_to_si(component: Component, d: FloatArray, units: UnitSystem) -> Matrix | None:
    """Displacement rows: columns as the coordinates, rows as the DOF they give."""
    if component.interior_rows is None:
        return None
    own = sp.diags_array(1 / _old_per_si(component.interior, units))
    scaled = own @ component.interior_rows @ sp.diags_array(d)
    return sp.csr_array(scaled) if sp.issparse(scaled) else np.asarray(scaled)


def _recovery_to_si(recovery: Recovery, component: Component, d: FloatArray, units: UnitSystem) -> Recovery:
    """Columns as the coordinates; rows too where their quantity is known and nobody said that they are in another unit."""

    def scaled(matrix: Matrix | None) -> Matrix | None:
        return None if matrix is None else (matrix @ sp.diags_array(d) if sp.issparse(matrix) else matrix * d)

    own = displacement_units(recovery.name, recovery.labels, component.units)  # by the units that are now said to be others
    columns = replace(
        recovery,
        displacement=scaled(recovery.displacement),
        velocity=scaled(recovery.velocity),
        acceleration=scaled(recovery.acceleration),
        units="" if recovery.units == own else recovery.units,
    )
    return recovery_in_si(columns, units, frozenset(np.asarray(component.modal_ids).tolist()))


def _checked(model: Component | FiniteElementModel, system: UnitSystem) -> None:
    """InputError for a second conversion, and for other units than the model says it has ("SI" alone may be the default)."""
    recorded, what = str(model.source.get("units", "")), f"{type(model).__name__} {model.name!r}"
    if model.units == SI.name and recorded and not recorded.startswith(UNSTATED) and not _same(system, SI):
        raise InputError(
            f"{what} is in SI already, its record says (source['units']: {recorded!r}); {system.name!r} would scale it again. "
            "Leave this conversion out, or the units= where it was read"
        )
    own = UNIT_SYSTEMS.get(model.units, SI)
    if own is not SI and not _same(system, own):
        raise InputError(f"{what} is in {own.name!r}, as its units say, and not in {system.name!r}")


def _same(a: UnitSystem, b: UnitSystem) -> bool:
    return replace(a, name=b.name) == b


def component_to_si(component: Component, units: Units) -> Component:
    """The component converted to SI: energy scales by M L^2, so Mqq = I and frequencies stay as they are.

    Mass written as weight ("inch-lbf") is divided by g: all frequencies, those of Kqq too, are then sqrt(g) times the file's.
    Recovery rows become SI where their quantity is known (those of `recover=` and Nastran's sets); others keep the file's
    row units, and say so. `source["units"]` records the system. Raises InputError for a component that was converted before.
    """
    expect(component, Component, "component_to_si", "read_component gives one, craig_bampton reduces a model to one")
    system = unit_system(units)
    _checked(component, system)
    converted = component_in_si(component, system)
    return replace(converted, source={**component.source, "units": system.name})


def component_in_si(component: Component, system: UnitSystem) -> Component:
    """As `component_to_si`, of a component whose source speaks of the file."""
    d = _old_per_si(component.dofs, system)
    rows = [_recovery_to_si(r, component, d, system) for r in component.recovery.values()]
    return replace(
        component,
        **_matrices_to_si(component, d, system),
        structural_damping=_scaled(component.structural_damping, d, _energy(system)),
        interior_rows=_interior_to_si(component, d, system),
        recovery={r.name: r for r in rows},
        **_units_of_result(component, system),
    )


def _units_of_result(component: Component, system: UnitSystem) -> dict[str, Any]:
    """SI; and what a reduction keeps beside the matrices, which is not converted, is in the units that are now said."""
    before = getattr(component, "reduced_units", None)  # of a reduced one, whose module need not be loaded
    if before is None or before != SI.name or component.units != SI.name or _same(system, SI):
        return {"units": SI.name}
    return {"units": SI.name, "reduced_units": system.name}


def model_to_si(model: FiniteElementModel, units: Units) -> FiniteElementModel:
    """The finite-element model converted to SI, recorded and refused a second time as by `component_to_si`."""
    expect(model, FiniteElementModel, "model_to_si", "read_model gives one from a file")
    system = unit_system(units)
    _checked(model, system)
    converted = model_in_si(model, system)
    return replace(converted, source={**model.source, "units": system.name})


def model_in_si(model: FiniteElementModel, system: UnitSystem) -> FiniteElementModel:
    """As `model_to_si`, of a model whose source speaks of the file."""
    return replace(model, **_matrices_to_si(model, _old_per_si(model.dofs, system), system), units=SI.name)


def _energy(system: UnitSystem) -> float:
    return system.mass * system.length**2


def _matrices_to_si(of: Component | FiniteElementModel, d: FloatArray, system: UnitSystem) -> dict[str, Any]:
    """Mass, stiffness, damping and nodes, which components and models have alike."""
    return {
        "mass": _scaled(of.mass, d, _energy(system) * system.mass_factor),
        "stiffness": _scaled(of.stiffness, d, _energy(system)),
        "damping": _scaled(of.damping, d, _energy(system)),
        "nodes": _nodes_to_si(of.nodes, system),
    }
