"""Strain energy of geometric rigid-body motion: the test that finds grounded components and wrong frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexplant.assembly import System, component_rigid_body, stiffness_scale
from flexplant.errors import InputError, expect
from flexplant.model.arrays import FloatArray
from flexplant.model.component import Component
from flexplant.model.geometry import Placement

DIRECTION_NAMES = ("Tx", "Ty", "Tz", "Rx", "Ry", "Rz")


@dataclass(frozen=True, eq=False)
class StrainEnergy:
    """Strain energy of unit rigid motions of one component.

    energy: (6,) r^T K r / 2, J (rotations about the component's mean node). ratio: (6,) relative to the same motion of
    `stiffness_scale`: 0 for a free component, 1e-6 and more for one that is grounded or whose frames or positions are
    wrong. worst_dof: per direction, the (node, direction) with the largest residual force K r; force: that force.
    per_dof: (n, 6) share of each coordinate, r_i (K r)_i / 2, rows as in `Component.dofs`; columns sum to `energy`.
    """

    component: str
    energy: FloatArray
    ratio: FloatArray
    worst_dof: tuple[tuple[int, int], ...]
    force: FloatArray
    per_dof: FloatArray

    @property
    def worst(self) -> int:
        """Direction (0-5) with the largest energy ratio."""
        return int(np.argmax(self.ratio))

    @property
    def explanation(self) -> str:
        """Which direction and DOF strain the most."""
        node, direction = self.worst_dof[self.worst]
        return f"worst in {DIRECTION_NAMES[self.worst]}, mostly at {self.component}.{node}.{direction}"


def strain_energy(component: Component, placement: Placement | None = None) -> StrainEnergy:
    """Strain energy of the six geometric rigid-body motions of a component; InputError without positions."""
    expect(component, Component, "strain_energy", "read_component gives one, craig_bampton reduces a model to one")
    place = Placement() if placement is None else placement
    expect(place, Placement, "strain_energy: placement", "Placement(rotation, translation) makes one")
    if component.nodes is None or not len(component.nodes):
        raise InputError(f"strain_energy: component {component.name!r} has no node positions, so its rigid motion is unknown")
    about = place.apply(component.nodes.positions.mean(axis=0))
    motion = component_rigid_body(component, place, about)
    force = np.asarray(component.stiffness @ motion)
    per_dof = motion * force / 2
    energy = per_dof.sum(axis=0)
    local = np.einsum("ij,ij->j", motion, stiffness_scale(component)[:, None] * motion)
    at = np.argmax(abs(force), axis=0) if component.n else np.zeros(6, int)
    pairs = component.dofs.pairs
    ratio = np.divide(2 * abs(energy), local, out=np.zeros(6), where=local > 0)
    return StrainEnergy(component.name, energy, ratio, tuple(pairs[i] for i in at), abs(force[at, np.arange(6)]), per_dof)


def blocked_directions(system: System, motion: FloatArray) -> dict[str, list[str]]:
    """Constraint labels that a rigid-body motion (n, 6) of the system violates, by direction name."""
    gap = abs(np.asarray(system.constraints @ motion))
    size = abs(system.constraints) @ abs(motion)
    broken = gap > 1e-5 * np.maximum(size, size.max(initial=1.0) * 1e-3)
    return {
        name: [system.constraint_labels[i] for i in np.flatnonzero(broken[:, j])]
        for j, name in enumerate(DIRECTION_NAMES)
        if broken[:, j].any()
    }
