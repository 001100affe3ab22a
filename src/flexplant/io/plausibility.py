"""Is this the unit system? A look at mass, size and first frequency; it tells, and never guesses or changes anything."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexplant.errors import SolverError
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.geometry import rigid_body_vectors
from flexplant.modes import normal_modes

Model = Component | FiniteElementModel
RANGES = {"mass": (1e-3, 1e6, "kg"), "size": (1e-2, 1e3, "m"), "first elastic frequency": (1e-3, 1e5, "Hz")}


@dataclass(frozen=True)
class Quantities:
    """Mass, largest extent of the nodes, first elastic frequency in Hz; None where the model does not say."""

    mass: float | None
    size: float | None
    frequency_hz: float | None


def quantities(model: Model) -> Quantities:
    """Mass from rigid translation (mean of three axes), extent of the nodes, first elastic frequency of the free model."""
    frequencies = first_frequencies(model, 12)
    elastic = [f for f in frequencies if f > 0]
    size = None if model.nodes is None or len(model.nodes) < 2 else model.nodes.extent
    return Quantities(rigid_mass(model), size, elastic[0] if elastic else None)


def rigid_mass(model: Model) -> float | None:
    """Mass that moves in rigid translation, mean of the axes that have DOF; None without node positions."""
    if model.nodes is None:
        return None
    rigid = rigid_body_vectors(model.nodes, model.dofs)[:, :3]
    masses = np.einsum("ij,ij->j", rigid, np.asarray(model.mass @ rigid))
    moving = masses[abs(rigid).max(axis=0) > 0]
    return float(moving.mean()) if moving.size else None


def first_frequencies(model: Model, count: int) -> list[float]:
    """The first natural frequencies of the model as it is, Hz; empty where they cannot be computed."""
    try:
        modes = normal_modes(model, n_modes=min(count, len(model.dofs)))
    except SolverError:
        return []
    return [float(f) for f in modes.frequency_hz]


def plausibility(model: Model, found: Quantities | None = None) -> list[str]:
    """A sentence for each quantity outside the range of structures, taking the numbers as SI; empty if all is plausible."""
    found = found or quantities(model)
    out = []
    for (name, (low, high, unit)), value in zip(RANGES.items(), (found.mass, found.size, found.frequency_hz), strict=True):
        if value is not None and not low <= value <= high:
            out.append(
                f"{name} {value:.4g} {unit} is outside {low:g} to {high:g} {unit}; is {model.source.get('units', 'SI')!r} "
                "the unit system of this file? Pass units= to convert."
            )
    return out
