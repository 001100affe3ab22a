"""Residual flexibility: the static response of the modes that a modal plant leaves out."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from flexplant.assembly import System
from flexplant.errors import SolverError
from flexplant.model.arrays import FloatArray, dense

RESIDUAL = 1e-6  # relative, of the static solution; above it the stiffness has an undeclared singular direction


def residual_displacement(system: System, forces: Any, omega: FloatArray, shapes: FloatArray) -> FloatArray:
    """(n, nu) static displacement p of unit inputs through the truncated modes:  (K^+ - sum_kept phi phi^T / omega^2) F.

    forces: F (n, nu). shapes: (n, k) kept modes in p, mass-normalised, rigid-body modes (omega = 0) all among them.
    K^+ is the inertia-relief inverse, from the sparse bordered system [[K, M Phi_r], [Phi_r^T M, 0]]. The kept modes are
    taken out of the load, F - M Phi Phi^T F, and out of the answer, not subtracted as phi phi^T / omega^2, which would cancel
    digits. Equal to the sum of phi phi^T / omega^2 over all truncated modes; includes the static compliance of massless
    coordinates. Raises SolverError where the stiffness stays singular (a rigid-body mode is missing).
    Source: Craig and Kurdila, Fundamentals of Structural Dynamics, chapter 11 (residual flexibility, inertia relief).
    """
    L = system.basis
    K = sp.csr_array(L.T @ system.uncoupled_stiffness @ L)
    momentum = _momentum(system.uncoupled_mass, system.uncoupled_stiffness, omega, shapes)
    load = L.T @ (dense(forces) - momentum @ (shapes.T @ dense(forces)))
    p = L @ _inertia_relief(K, L.T @ momentum[:, omega == 0], load)
    return np.asarray(p - shapes @ (momentum.T @ p))


def _momentum(mass: Any, stiffness: Any, omega: FloatArray, shapes: FloatArray) -> FloatArray:
    """M Phi (n, k); of a mode so stiff that its mass is what is left of cancelling larger ones, the same as K phi / omega^2."""
    momentum = np.asarray(mass @ shapes)
    terms = (abs(matrix.diagonal()) @ shapes**2 for matrix in (mass, stiffness))  # what phi^T M phi and phi^T K phi sum up
    inertia, energy = (np.asarray(term) for term in terms)
    stiff = np.flatnonzero(omega**2 * inertia > energy)
    momentum[:, stiff] = (stiffness @ shapes[:, stiff]) / omega[stiff] ** 2
    return momentum


def _inertia_relief(K: sp.csr_array, border: FloatArray, load: FloatArray) -> FloatArray:
    """x of [[K, b], [b^T, 0]] [x; mu] = [load; 0]; the stiffness and the border scaled to unit diagonal first."""
    diagonal = abs(K.diagonal())
    d = 1 / np.sqrt(np.where(diagonal > 0, diagonal, diagonal.max() if diagonal.size else 1.0))
    scaled = sp.diags_array(d) @ K @ sp.diags_array(d)
    size = np.linalg.norm(d[:, None] * border, axis=0)
    b = d[:, None] * border / np.where(size > 0, size, 1.0)
    bordered = sp.csc_array(sp.block_array([[scaled, sp.csr_array(b)], [sp.csr_array(b.T), None]])) if b.shape[1] else scaled
    right = np.vstack([d[:, None] * load, np.zeros((b.shape[1], load.shape[1]))])
    try:
        factor = splu(sp.csc_array(bordered))
    except RuntimeError:
        raise SolverError(_SINGULAR) from None
    x = factor.solve(right)
    x += factor.solve(right - bordered @ x)
    residual = np.linalg.norm(right - bordered @ x, axis=0)
    if not (residual <= RESIDUAL * np.linalg.norm(right, axis=0)).all():
        raise SolverError(_SINGULAR)
    return np.asarray(d[:, None] * x[: d.size])


_SINGULAR = (
    "static correction: the coupled stiffness stays singular beyond its rigid-body modes; run verify(system) to see which "
    "component floats, or pass static_correction=False"
)
