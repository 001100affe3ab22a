"""Residual modes: the truncated modes' response as a few modes more, instead of a direct term."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.linalg as la

from flexplant.assembly import System
from flexplant.model.arrays import FloatArray, dense
from flexplant.modes import Modes
from flexplant.plant.static_correction import residual_displacement

DEPENDENT = 1e-10  # strain energy of a combination of residual vectors, relative to the largest, below which it is round-off
ROUND_OFF = 1e-9  # static displacement, relative to all that was truncated, below which nothing is lacking
FASTEST = 1e4  # a residual mode above this many times the highest kept frequency has no dynamics that a band could show


def with_residual_modes(system: System, forces: Any, modes: Modes) -> tuple[Modes, FloatArray]:
    """(the kept modes followed by residual modes, at most one an input; (n, nu) static displacement that they still lack).

    forces: F (n, nu). The residual vectors R = residual_displacement(F) are orthogonal to the kept modes in M and K; the
    eigenvectors of (R^T K R, R^T M R), mass-normalised, turn them into modes with frequencies of their own, above the kept ones.
    Together they answer static loads exactly and have mass, so that velocities, accelerations and interface forces are corrected
    as displacements are, without a direct term. Combinations without inertia (massless coordinates) are what is still lacking;
    equal inputs give one vector.
    Source: Dickens, Nakagawa and Wittbrodt, A critique of mode acceleration and modal truncation augmentation methods for
    modal response analysis, Computers and Structures 62 (1997).
    """
    R = residual_displacement(system, forces, modes.omega, modes.shapes)
    basis = _independent(R, system.uncoupled_stiffness)
    slowness, turn = la.eigh(basis.T @ (system.uncoupled_mass @ basis))
    highest = float(modes.omega.max(initial=0.0))
    moving = np.flatnonzero(slowness > (1 / (FASTEST * highest) ** 2 if highest else DEPENDENT * slowness.max(initial=0.0)))[::-1]
    omega = 1 / np.sqrt(slowness[moving])
    shapes = basis @ (turn[:, moving] * omega)
    lacking = R - shapes @ ((shapes.T @ dense(forces)) / omega[:, None] ** 2)
    lacking[:, abs(lacking).max(axis=0, initial=0.0) <= ROUND_OFF * abs(R).max(axis=0, initial=0.0)] = 0.0
    enriched = replace(
        modes,
        frequency_hz=np.r_[modes.frequency_hz, omega / (2 * np.pi)],
        shapes=np.hstack([modes.shapes, shapes]),
        residuals=np.r_[modes.residuals, np.full(omega.size, np.nan)],
        labels=[],
    )
    return enriched, lacking


def _independent(vectors: FloatArray, stiffness: Any) -> FloatArray:
    """Vectors with the same span that are orthonormal in the stiffness."""
    energy = np.einsum("ij,ij->j", vectors, stiffness @ vectors)
    used = energy > 0
    scaled = vectors[:, used] / np.sqrt(energy[used])
    size, directions = la.eigh(scaled.T @ (stiffness @ scaled))
    independent = size > DEPENDENT * size.max(initial=0.0)
    return np.asarray(scaled @ (directions[:, independent] / np.sqrt(size[independent])))
