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
    form: tuple[ComplexArray, ComplexArray, ComplexArray, FloatArray],
    hz: FloatArray,
    start: FloatArray | ComplexArray,
    end: FloatArray | ComplexArray,
) -> FloatArray:
    """(ny, nt) integrals of G S G^H df over the nt intervals hz[t]..hz[t + 1]; S one-sided, linear within each interval.

    start, end: S at the two ends of each interval, (nu, nt) of uncorrelated inputs, or (nu, nu, nt) cross-spectra, Hermitian. On
    the axis G_i conj(G_j) is D_i D_j + F_ij + conj(F_ji), F_ij = sum_k X_k / (i w - p_k), X_k = R_ki G_j(-p_k), and
    (a + b w) / (i w - p) integrates to -i b w + (a - i b p) (-i) log(i w - p) in closed form. Every pole lies in the left half
    plane. Work: poles^2, and poles times intervals for each pair of correlated inputs, in blocks of poles. Round-off: about
    1e-15 of the whole variance in each interval.
    """
    poles, left, right, D = form
    nu, w = start.shape[0], 2 * np.pi * hz
    width = np.diff(w)
    pairs = [(i, i) for i in range(nu)] if start.ndim == 2 else [(i, j) for i in range(nu) for j in range(nu)]
    first, last = start.reshape(len(pairs), width.size), end.reshape(len(pairs), width.size)
    slope = (last - first) / width
    level = first - slope * w[:-1]
    direct = (np.outer(D[:, i] * D[:, j], (0.5 * (a + b) * width).real) for (i, j), a, b in zip(pairs, first, last, strict=True))
    variance = sum(direct, start=np.zeros((D.shape[0], width.size)))
    for block in range(0, poles.size, CHUNK):
        at = slice(block, block + CHUNK)
        mirrored = (left[:, None, :] * right.T) @ (1 / (-poles[at] - poles[:, None])) + D[:, :, None]
        logarithm = np.diff(np.log(1j * w - poles[at, None]), axis=1)
        for (i, j), a, b in zip(pairs, level, slope, strict=True):
            if not (a.any() or b.any()):
                continue
            weight = left[:, at] * mirrored[:, j] * right[at, i]
            against = (
                weight @ logarithm * a - 1j * ((weight * poles[at]) @ logarithm) * b + np.outer(weight.sum(axis=1), b * width)
            )
            variance = variance + 2 * against.imag
    return np.asarray(variance / (2 * np.pi))
