"""The free-free check: how many motions cost no energy, and if not as many as expected, what floats or is grounded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from flexplant.assembly import System, component_rigid_body, system_rigid_body
from flexplant.model.arrays import FloatArray
from flexplant.modes import Modes
from flexplant.verification.rigid_body import DIRECTION_NAMES, blocked_directions, strain_energy

ENERGY_LIMIT = 1e-8  # energy ratio of a rigid motion; coordinates with 5 decimals give about 1e-10, a spring to ground 1e-3


@dataclass(frozen=True)
class FreeFree:
    """Number of zero-energy motions found and expected, and the diagnosis where they differ."""

    found: int
    expected: int
    explanation: str


def free_free(system: System, modes: Modes, expected: int) -> FreeFree:
    """Compare the number of rigid-body modes with the expected one and say what floats or is grounded."""
    found = modes.n_rigid
    if found == expected:
        return FreeFree(found, expected, "as expected")
    if found > expected:
        text = floating(system, modes) if system.has_geometry else _moving_parts(system, modes.shapes[:, :found])
        return FreeFree(found, expected, f"{found - expected} too many: {text}")
    return FreeFree(found, expected, f"{expected - found} too few: {grounded(system)}")


def floating(system: System, modes: Modes) -> str:
    """Which components move without energy, and in which direction: relative to the ground where there is one, else
    relative to the component that leaves the fewest others moving."""
    zero = modes.shapes[:, : modes.n_rigid]
    if system.grounded:
        return _moving_parts(system, zero)
    relative = [_held(system, c.name, zero) for c in system.components]
    relative = [motion for motion in relative if motion.shape[1]]
    return _moving_parts(system, min(relative, key=lambda m: len(_movers(system, m)), default=zero))


def _held(system: System, name: str, zero: FloatArray) -> FloatArray:
    """The zero-energy motions (n, k) that leave one component at rest."""
    part = zero[system.offsets[name]]
    _, s, vt = la.svd(part, full_matrices=True)
    rank = int(np.count_nonzero(s > 1e-8 * max(float(np.linalg.norm(zero)), 1e-300)))
    return np.asarray(zero @ vt[rank:].T)


def _movers(system: System, motion: FloatArray) -> list[str]:
    """Components with more than a hundredth of the largest motion, the largest first."""
    size = {c.name: float(np.linalg.norm(motion[system.offsets[c.name]])) for c in system.components}
    return [name for name, part in sorted(size.items(), key=lambda item: -item[1]) if part > 0.01 * max(size.values())]


def _moving_parts(system: System, motion: FloatArray) -> str:
    """Components that take part in a set of motions (n, k), with the directions in which they move."""
    movers = _movers(system, motion)
    texts = [f"{name!r} floats{_directions(system, name, motion)}" for name in movers[:4]]
    more = f" (and {len(movers) - 4} others)" if len(movers) > 4 else ""
    return "component " + "; component ".join(texts) + f"{more}; couple the missing directions or ground it"


def _directions(system: System, name: str, motion: FloatArray) -> str:
    component = system.component(name)
    if component.nodes is None or not len(component.nodes):
        return ""
    place = system.placement(name)
    basis = component_rigid_body(component, place, place.apply(component.nodes.positions.mean(axis=0)))
    twist = np.linalg.lstsq(basis, motion[system.offsets[name]], rcond=None)[0] * np.linalg.norm(basis, axis=0)[:, None]
    return f" in {', '.join(_named_directions(twist))}"


def _named_directions(twist: FloatArray) -> list[str]:
    """Axes of (6, k) twists: those of the rotations, and of the motions that are translations alone.

    What a rotation about a distant hinge moves at the centre is no freedom of its own.
    """
    _, s, vt = la.svd(twist[3:], full_matrices=True)
    turning = int(np.count_nonzero(s > 1e-6 * max(float(np.linalg.norm(twist)), 1e-300)))
    size = np.r_[np.linalg.norm(twist[:3] @ vt[turning:].T, axis=1), np.linalg.norm(twist[3:], axis=1)]
    limits = np.repeat([0.05 * max(float(size[:3].max()), 1e-300), 0.05 * max(float(size[3:].max()), 1e-300)], 3)
    floor = 1e-6 * float(np.linalg.norm(twist))
    return [n for n, v, limit in zip(DIRECTION_NAMES, size, limits, strict=True) if v > max(limit, floor)]


def grounded(system: System) -> str:
    """Which directions of rigid-body motion are held, by which constraint, component and DOF."""
    if not system.has_geometry:
        return "something is grounded; give the components node positions to see which DOF"
    texts = []
    blocked = blocked_directions(system, system_rigid_body(system))
    for direction, labels in blocked.items():
        texts.append(f"{direction} is held by {', '.join(labels[:3])}{' ...' if len(labels) > 3 else ''}")
    for component in system.components:
        strain = strain_energy(component, system.placement(component.name))
        held = [d for d, r in zip(DIRECTION_NAMES, strain.ratio, strict=True) if r > ENERGY_LIMIT]
        if held:
            texts.append(
                f"component {component.name!r} is grounded or its frames are wrong in {', '.join(held)} ({strain.explanation})"
            )
    return "; ".join(texts) or "a compliant connection to ground, or constraints that admit less motion, hold the system"


def undeflated_hz(system: System, count: int) -> FloatArray:
    """The `count` lowest frequencies as a plain eigensolver returns them (|eigenvalue|, Hz): what Table 2 lists.

    `normal_modes` makes rigid-body modes exact zeros; this shows how near to zero round-off and the files' precision
    leave them.
    """
    k = (system.basis.T @ system.uncoupled_stiffness @ system.basis).toarray()
    m = (system.basis.T @ system.uncoupled_mass @ system.basis).toarray()
    values = la.eigh(0.5 * (k + k.T), 0.5 * (m + m.T), eigvals_only=True)[:count]
    return np.asarray(np.sqrt(abs(values)) / (2 * np.pi))
