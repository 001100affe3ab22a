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
    """Which components move relative to the others without energy, and in which direction."""
    zero = modes.shapes[:, : modes.n_rigid]
    whole = la.orth(system_rigid_body(system))
    extra = zero - whole @ (whole.T @ zero)
    u, s, _ = la.svd(extra, full_matrices=False)
    extra = u[:, s > 1e-6 * max(float(np.linalg.norm(zero, axis=0).max()), 1e-300)]
    if not extra.shape[1]:
        return _moving_parts(system, zero)
    return _moving_parts(system, extra)


def _moving_parts(system: System, motion: FloatArray) -> str:
    """Components by their share of a set of motions (n, k), with the directions in which they move."""
    share = {c.name: float((motion[system.offsets[c.name]] ** 2).sum()) for c in system.components}
    total = sum(share.values()) or 1.0
    movers = [name for name, part in sorted(share.items(), key=lambda item: -item[1]) if part > 0.02 * total]
    texts = [f"{name!r} floats{_directions(system, name, motion)}" for name in movers[:4]]
    return "component " + "; component ".join(texts) + "; couple the missing directions or ground it"


def _directions(system: System, name: str, motion: FloatArray) -> str:
    component = system.component(name)
    if component.nodes is None or not len(component.nodes):
        return ""
    place = system.placement(name)
    basis = component_rigid_body(component, place, place.apply(component.nodes.positions.mean(axis=0)))
    fit = np.linalg.lstsq(basis, motion[system.offsets[name]], rcond=None)[0]
    size = np.linalg.norm(fit, axis=1) * np.linalg.norm(basis, axis=0)
    moving = [n for n, s in zip(DIRECTION_NAMES, size, strict=True) if s > 0.1 * max(size.max(), 1e-300)]
    return f" in {', '.join(moving)}"


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
