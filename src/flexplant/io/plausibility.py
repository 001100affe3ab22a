"""Is this the unit system? A look at mass, size and first frequency; it tells, and never guesses or changes anything.

Two products of them know more than each alone. Mass over size cubed: no structure is denser than metal, nor, over the distance
of its own nodes, thinner than a long mast. Frequency times size: no wave in a structure runs faster than the sound in it.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexplant.errors import InputError, PlausibilityWarning, SolverError, expect
from flexplant.io.parse.files import one_line
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.geometry import rigid_body_vectors

Model = Component | FiniteElementModel
RANGES = {
    "mass": (1e-3, 1e6, "kg"),
    "size": (1e-2, 1e3, "m"),
    "first elastic frequency": (1e-3, 1e5, "Hz"),
    "mass over size cubed": (5e-5, 2e4, "kg/m^3"),
    "frequency times size": (1e-3, 2e4, "m/s"),
}
FEW = 600  # coordinates up to which all modes are found at once, so that nobody need know how many are finite


@dataclass(frozen=True)
class Quantities:
    """Mass, largest extent of the nodes, first elastic frequency in Hz; None where the model does not say.

    whole: whether the nodes are those of the whole structure, and not only of its boundary.
    """

    mass: float | None
    size: float | None
    frequency_hz: float | None
    whole: bool = True

    def rows(self) -> Iterable[tuple[str, float | None]]:
        """The numbers by the names of `RANGES`."""
        yield "mass", self.mass
        yield "size", self.size
        yield "first elastic frequency", self.frequency_hz
        if self.size and self.mass:
            with np.errstate(all="ignore"):  # sizes of 1e200 and 1e-200 are no plausible ones either
                density = float(np.float64(self.mass) / np.float64(self.size) ** 3)
            yield "mass over size cubed", density if self.whole else min(density, RANGES["mass over size cubed"][1])
        if self.size and self.frequency_hz:
            yield "frequency times size", self.frequency_hz * self.size


def quantities(model: Model, *, modes: bool = True) -> Quantities:
    """Mass from rigid translation (mean of three axes), extent of the nodes, first elastic frequency of the free model.

    modes False: only what costs next to nothing; instead of the first elastic frequency a component's lowest fixed-interface
    one, and none of a finite-element model.
    """
    size = None if model.nodes is None or len(model.nodes) < 2 else model.nodes.extent
    frequency = _first_elastic(model) if modes else _fixed_interface(model)
    return Quantities(rigid_mass(model) or None, size or None, frequency, whole=isinstance(model, FiniteElementModel))


def _first_elastic(model: Model) -> float | None:
    return next((f for f in first_frequencies(model, 12)[0] if f > 0), None)


def _fixed_interface(model: Model) -> float | None:
    if not isinstance(model, Component):
        return None
    usable = [f for f in model.fixed_interface_hz.tolist() if 0 < f < np.inf]
    return min(usable, default=None)


def rigid_mass(model: Model) -> float | None:
    """Mass that moves in rigid translation, mean of the axes that have DOF; None without node positions."""
    if model.nodes is None:
        return None
    rigid = rigid_body_vectors(model.nodes, model.dofs)[:, :3]
    masses = np.einsum("ij,ij->j", rigid, np.asarray(model.mass @ rigid))
    moving = masses[abs(rigid).max(axis=0) > 0]
    return float(moving.mean()) if moving.size else None


def first_frequencies(model: Model, count: int) -> tuple[list[float], str]:
    """The first natural frequencies of the model as it is, Hz; empty where they cannot be computed, and then why."""
    from flexplant.modes import normal_modes  # not before it is needed: most reading never asks

    try:
        modes = normal_modes(model, n_modes=None if len(model.dofs) <= FEW else count)
    except (SolverError, InputError) as error:  # an indefinite mass, a massless mechanism; fewer finite modes than that
        return [], one_line(error)
    return [float(f) for f in modes.frequency_hz[:count]], "the model has no finite modes"


def plausibility(model: Model, found: Quantities | None = None) -> list[str]:
    """A sentence for each quantity outside the range of structures, taking the numbers as SI; empty if all is plausible."""
    if not isinstance(model, Model):
        raise InputError(f"plausibility looks at a Component or FiniteElementModel, got {type(model).__name__}")
    found = quantities(model) if found is None else found
    expect(found, Quantities, "plausibility: found", "leave it out")
    out = []
    for name, value in _unusual(found):
        low, high, unit = RANGES[name]
        out.append(
            f"{name} {value:.4g} {unit} is outside {low:g} to {high:g} {unit}; is {model.source.get('units', 'SI')!r} "
            "the unit system of this file? Pass units= to convert."
        )
    return out


def _unusual(found: Quantities) -> list[tuple[str, float]]:
    return [(name, v) for name, v in found.rows() if v is not None and not RANGES[name][0] <= v <= RANGES[name][1]]


def warn_if_implausible(model: Model, path: str | Path) -> None:
    """One `PlausibilityWarning` for a file whose numbers, taken as SI, are no structure's; cheap, so that every reading can.

    Silence it with  warnings.simplefilter("ignore", flexplant.PlausibilityWarning).
    """
    with np.errstate(all="ignore"):  # absurd numbers are what it looks for
        found = quantities(model, modes=False)
        odd = [f"{name} {value:.4g} {RANGES[name][2]}" for name, value in _unusual(found)]
    if odd:
        label = one_line(model.source.get("units", "SI"))
        text = f"{path}: {', '.join(odd)} (units {label}): is that the unit system of this file? Pass units= to convert"
        warnings.warn(PlausibilityWarning(text), stacklevel=3)
