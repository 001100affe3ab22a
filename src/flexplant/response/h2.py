"""The H2 norm: the RMS response to white noise, in closed form for modal plants."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, real_values
from flexplant.numerics.threads import one_thread
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace, output_rows, state_space

ROUND_OFF = 1e-9
BLOCK = 256


@one_thread
def h2_norm(plant: ModalPlant | StateSpace | Descriptor) -> float:
    """sqrt( (1 / 2 pi) int trace(G G^H) d omega ); inf where it does not exist (feedthrough, undamped or growing poles seen).

    It is the root sum square of `white_noise_rms` for one unit of two-sided intensity on every input.
    """
    return float(np.sqrt((white_noise_rms(plant) ** 2).sum()))


@one_thread
def white_noise_rms(plant: ModalPlant | StateSpace | Descriptor, intensity: FloatArray | None = None) -> FloatArray:
    """(ny,) RMS of each output for white inputs with E[u(t) u(t')^T] = W delta(t - t'); intensity W (nu, nu), or I.

    A one-sided PSD of g per Hz on an input is W = g / 2. Modal plants with modal damping: the stationary covariance of every
    pair of modes in closed form, D = d_i + d_j, d = 2 zeta omega, Delta = omega_i^2 - omega_j^2, S = b_i W b_j^T:
        E[eta_i eta_j] = S D / (Delta^2 + D (omega_j^2 d_i + omega_i^2 d_j)).
    Others: a Lyapunov equation. inf for an output whose RMS does not exist. InputError for another type, or a W of another shape
    that is not a covariance.
    """
    if not isinstance(plant, ModalPlant | StateSpace | Descriptor):
        name = type(plant).__name__
        raise InputError(
            f"white noise: a ModalPlant, StateSpace or Descriptor is needed, got {name} (close() makes one of a Diagram)"
        )
    nu = len(plant.inputs)
    W = np.eye(nu) if intensity is None else real_values(intensity, "white noise intensity")
    if W.shape != (nu, nu) or not np.isfinite(W).all():
        raise InputError(f"white noise intensity of shape {W.shape}; a finite ({nu}, {nu}) matrix is needed")
    size = abs(W).max(initial=0.0)
    if abs(W - W.T).max(initial=0.0) > 1e-10 * size or np.linalg.eigvalsh(W).min(initial=0.0) < -1e-10 * size:
        raise InputError("white noise intensity must be symmetric and not negative, as a covariance is")
    if isinstance(plant, ModalPlant) and plant.damping is None:
        return _modal_rms(plant, W)
    return _dense_rms(state_space(plant), W)


def _modal_rms(plant: ModalPlant, W: FloatArray) -> FloatArray:
    position, velocity, direct = output_rows(plant)
    lasting = plant.zeta * plant.omega == 0
    seen = abs(position[:, lasting]) + abs(velocity[:, lasting])
    driven = np.sqrt(np.maximum(np.einsum("iu,uv,iv->i", plant.shape_in, W, plant.shape_in), 0.0))
    unbounded = (seen * driven[lasting] > 0).any(axis=1) | _white_through(direct, W)
    keep = ~lasting
    w, d, b = plant.omega[keep], 2 * (plant.zeta * plant.omega)[keep], plant.shape_in[keep]
    P, V, Wb = position[:, keep], velocity[:, keep], W @ b.T
    variance = np.zeros(len(plant.outputs))
    for start in range(0, w.size, BLOCK):  # of rows, so that thousands of modes need no whole covariance
        at = slice(start, start + BLOCK)
        total = d[at, None] + d
        delta = (w[at, None] - w) * (w[at, None] + w)
        mixed = d[at, None] * w**2 + w[at, None] ** 2 * d
        displacement = (b[at] @ Wb) * total / (delta**2 + total * mixed)
        share = displacement / total
        cross, rate = share * delta, share * mixed  # E[eta_i eta_j'], E[eta_i' eta_j']
        rows, speeds = P[:, at], V[:, at]
        variance += ((rows @ displacement) * P).sum(1) + 2 * ((rows @ cross) * V).sum(1) + ((speeds @ rate) * V).sum(1)
    return np.where(unbounded, np.inf, np.sqrt(np.maximum(variance, 0.0)))


def _white_through(direct: FloatArray, W: FloatArray) -> np.ndarray:
    return np.asarray(np.einsum("ou,uv,ov->o", direct, W, direct) > 0)


def _dense_rms(system: StateSpace, W: FloatArray) -> FloatArray:
    A, B = system.A, system.B
    direct = np.einsum("ou,uv,ov->o", system.D, W, system.D)
    if not system.n_states:
        return np.where(direct > 0, np.inf if system.dt is None else np.sqrt(direct), 0.0)
    poles = np.linalg.eigvals(A)
    if (poles.real.max() if system.dt is None else abs(poles).max() - 1) >= -ROUND_OFF * 1e-6 * abs(poles).max():
        return np.full(len(system.outputs), np.inf)
    if system.dt is None:
        P = scipy.linalg.solve_continuous_lyapunov(A, -B @ W @ B.T)
        variance = ((system.C @ P) * system.C).sum(axis=1)
        return np.where(direct > 0, np.inf, np.sqrt(np.maximum(variance, 0.0)))
    P = scipy.linalg.solve_discrete_lyapunov(A, B @ W @ B.T)
    return np.asarray(np.sqrt(np.maximum(((system.C @ P) * system.C).sum(axis=1) + direct, 0.0)))
