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
    form: tuple[ComplexArray, ComplexArray, ComplexArray, FloatArray], hz: FloatArray, psd: FloatArray
) -> FloatArray:
    """(ny,) integral over hz[0]..hz[-1] of sum_u |G_u|^2 S_u df; psd (nu, nf) one-sided, linear between the points hz.

    |G|^2 = D^2 + 2 Re sum_k X_k / (i w - p_k), X_k = R_k G(-p_k), and (a + b w) / (i w - p) integrates to
    -i b w + (a - i b p) (-i) log(i w - p) over each interval, in closed form.
    """
    poles, left, right, D = form
    if (poles.real >= 0).any():
        return np.full(left.shape[0], np.inf)
    mirrored = np.einsum("ok,kj,ku->ouj", left, 1 / (-poles - poles[:, None]), right, optimize=True) + D[:, :, None]
    X = left[:, None, :] * right.T[None, :, :] * mirrored
    w = 2 * np.pi * hz
    slope = np.diff(psd, axis=1) / np.diff(w)
    level = psd[:, :-1] - slope * w[:-1]
    logarithm = np.diff(np.log(1j * w - poles[:, None]), axis=1)
    width = np.diff(w)
    # (nu, n): integral of the input's PSD against each pole
    against = -1j * (slope @ width)[:, None] - 1j * (level @ logarithm.T) - slope @ logarithm.T * poles
    variance = 2 * np.einsum("ouk,uk->o", X, against).real
    mean = 0.5 * (psd[:, 1:] + psd[:, :-1]) @ width
    return np.asarray((variance + (D**2) @ mean) / (2 * np.pi))
