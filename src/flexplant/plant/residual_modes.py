"""What kept modes lack under static loads: residual modes, and the part without inertia."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as la

from flexplant.assembly import System
from flexplant.model.arrays import FloatArray, dense
from flexplant.modes import Modes
from flexplant.plant.massless import DEPENDENT, FASTEST, ROUND_OFF, massless_displacement, stiff_basis
from flexplant.plant.static_correction import residual_displacement


@dataclass(frozen=True, eq=False)
class Residual:
    """modes: the kept ones followed by residual modes, at most one an input. p of unit inputs (n, nu): displacement, all that
    the kept modes lack; massless, what of it has no inertia, so that the residual modes lack it too.
    """

    modes: Modes
    displacement: FloatArray
    massless: FloatArray


def residual_of(system: System, forces: Any, modes: Modes) -> Residual:
    """The truncated modes' response to forces F (n, nu), as a displacement and as modes.

    The residual vectors R = residual_displacement(F), less what coordinates without mass add to them, are orthogonal to the kept
    modes in M and K; the eigenvectors of (R^T K R, R^T M R), mass-normalised, turn them into modes with frequencies of their own,
    above the kept ones. Together they answer static loads exactly and have mass, so that velocities, accelerations and interface
    forces are corrected as displacements are. Combinations without inertia are `massless`; equal inputs give one vector.
    Source: Dickens, Nakagawa and Wittbrodt, A critique of mode acceleration and modal truncation augmentation methods for
    modal response analysis, Computers and Structures 62 (1997).
    """
    R = _cleaned(residual_displacement(system, forces, modes.omega, modes.shapes), _kept_displacement(forces, modes))
    instant = massless_displacement(system, forces)
    inert = _cleaned(R - instant, R)
    basis = stiff_basis(inert, system.uncoupled_stiffness)
    omega, shapes = _as_modes(basis, system.uncoupled_mass, float(modes.omega.max(initial=0.0)))
    massless = instant + _cleaned(inert - shapes @ ((shapes.T @ dense(forces)) / omega[:, None] ** 2), R)
    enriched = replace(
        modes,
        frequency_hz=np.r_[modes.frequency_hz, omega / (2 * np.pi)],
        shapes=np.hstack([modes.shapes, shapes]),
        residuals=np.r_[modes.residuals, np.full(omega.size, np.nan)],
        labels=[],
    )
    return Residual(enriched, R, massless)


def _as_modes(basis: FloatArray, mass: Any, highest: float) -> tuple[FloatArray, FloatArray]:
    """Ascending omega (k,) and mass-normalised shapes (n, k) of the combinations that have inertia."""
    if not basis.shape[1]:
        return np.zeros(0), basis
    slowness, turn = la.eigh(basis.T @ (mass @ basis))
    moving = np.flatnonzero(slowness > (1 / (FASTEST * highest) ** 2 if highest else DEPENDENT * slowness.max(initial=0.0)))[::-1]
    omega = 1 / np.sqrt(slowness[moving])
    return omega, basis @ (turn[:, moving] * omega)


def _kept_displacement(forces: Any, modes: Modes) -> FloatArray:
    """(n, nu) static displacement of unit inputs through the kept modes, |phi| |phi^T F| / omega^2: the size of round-off."""
    flexible = modes.omega > 0
    shapes = modes.shapes[:, flexible]
    return np.asarray(abs(shapes) @ (abs(dense(forces.T @ shapes)) / modes.omega[flexible] ** 2).T)


def _cleaned(part: FloatArray, whole: FloatArray) -> FloatArray:
    """The part (n, nu) of static displacements, exactly zero where it is their round-off."""
    part = part.copy()
    part[:, abs(part).max(axis=0, initial=0.0) <= ROUND_OFF * abs(whole).max(axis=0, initial=0.0)] = 0.0
    return part
