"""Exact variance of an output over a frequency band, for an input whose PSD is piecewise linear: integrals of poles, no grid."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.linalg

from flexplant.model.arrays import FloatArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, output_rows

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
WELL_CONDITIONED = 1e6
CHUNK = 512  # poles taken at a time
CRITICAL = 1e-4  # |1 - zeta| below which a mode's two poles are too close for their residues


def poles_and_residues(plant: ModalPlant | StateSpace) -> tuple[ComplexArray, ComplexArray, ComplexArray, FloatArray] | None:
    """(poles (n,), left (ny, n), right (n, nu), D) with G = sum left_k right_k / (s - p_k) + D, or None.

    Badly conditioned eigenvectors, rigid-body modes and poles that meet have no such form.
    """
    if isinstance(plant, ModalPlant) and plant.damping is None:
        return _of_modal(plant)
    if isinstance(plant, ModalPlant) or plant.dt is not None or not plant.n_states:
        return None
    A, (scale, _) = scipy.linalg.matrix_balance(plant.A, permute=False, separate=True)
    poles, vectors = scipy.linalg.eig(A)
    if np.linalg.cond(vectors) > WELL_CONDITIONED:
        return None
    right = np.linalg.solve(vectors, (plant.B / scale[:, None]).astype(complex))
    return poles, (plant.C * scale) @ vectors, right, plant.D


def _of_modal(plant: ModalPlant) -> tuple[ComplexArray, ComplexArray, ComplexArray, FloatArray] | None:
    if (plant.omega == 0).any() or (abs(1 - plant.zeta) < CRITICAL).any():
        return None
    position, velocity, D = output_rows(plant)
    root = np.sqrt((plant.zeta**2 - 1).astype(complex))
    first, second = plant.omega * (-plant.zeta + root), plant.omega * (-plant.zeta - root)
    difference = first - second
    left = np.hstack([(position + velocity * first) / difference, -(position + velocity * second) / difference])
    return np.r_[first, second], left, np.vstack([plant.shape_in, plant.shape_in]).astype(complex), D


def band_variance(
    form: tuple[ComplexArray, ComplexArray, ComplexArray, FloatArray], hz: FloatArray, psd: FloatArray | ComplexArray
) -> FloatArray:
    """(ny,) integral over hz[0]..hz[-1] of G S G^H df; S one-sided, linear between the points hz.

    psd: (nu, nf) of uncorrelated inputs, or (nu, nu, nf) cross-spectra, Hermitian. On the axis G_i conj(G_j) is
    D_i D_j + F_ij + conj(F_ji), F_ij = sum_k X_k / (i w - p_k), X_k = R_ki G_j(-p_k), and (a + b w) / (i w - p) integrates to
    -i b w + (a - i b p) (-i) log(i w - p) over each interval, in closed form. Work: poles^2 and poles times points, in blocks.
    """
    poles, left, right, D = form
    if (poles.real >= 0).any():
        return np.full(left.shape[0], np.inf)
    nu = psd.shape[0]
    rows, columns = (np.arange(nu), np.arange(nu)) if psd.ndim == 2 else [index.ravel() for index in np.indices((nu, nu))]
    pairs = psd.reshape(rows.size, -1)  # of inputs i, j that are correlated
    w = 2 * np.pi * hz
    slope = np.diff(pairs, axis=1) / np.diff(w)
    level = pairs[:, :-1] - slope * w[:-1]
    mean = (0.5 * (pairs[:, 1:] + pairs[:, :-1]) @ np.diff(w)).real
    variance = (D[:, rows] * D[:, columns]) @ mean
    for start in range(0, poles.size, CHUNK):
        at = slice(start, start + CHUNK)
        mirrored = (left[:, None, :] * right.T) @ (1 / (-poles[at] - poles[:, None])) + D[:, :, None]
        logarithm = np.diff(np.log(1j * w - poles[at, None]), axis=1)
        # (pairs, poles): integral of the input's spectrum against each pole
        against = -1j * (slope @ np.diff(w))[:, None] - 1j * (level @ logarithm.T) - slope @ logarithm.T * poles[at]
        weights = right.T[rows][:, at] * against
        variance += 2 * np.einsum("ok,opk,pk->o", left[:, at], mirrored[:, columns], weights, optimize=True).real
    return np.asarray(variance / (2 * np.pi))
