"""Sampled modes and discrete state spaces over the warped frequency (see `warped`): a mode is again a mode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace

AT_NYQUIST = 1e13  # condition of A + I, above which a block has a pole at z = -1


@dataclass(frozen=True, eq=False)
class WarpedModes:
    """omega, zeta: of the modes in w. M: (n, 2, 2) -tanh(A T / 2), A that of a continuous mode; F = (I + M)^-1 (I - M)."""

    omega: FloatArray
    zeta: FloatArray
    M: FloatArray
    dt: float


def warped_modes(omega: FloatArray, zeta: FloatArray, dt: float) -> WarpedModes:
    """The poles p of continuous modes go to (2 / T) tanh(p T / 2); by Cayley and Hamilton M = m0 I + m1 A.

    With a = zeta omega T and b^2 = (omega T)^2 - a^2: det M = (cosh a - cos b) / (cosh a + cos b) and
    trace M = 2 sinh a / (cosh a + cos b), every term times exp(-a); above critical damping cos b = cosh(theta), b = i theta.
    InputError for a mode without damping at the Nyquist frequency.
    """
    x = omega * dt
    a = zeta * x
    over = zeta > 1
    theta = np.where(over, x * np.sqrt(abs((zeta - 1) * (zeta + 1))), 0.0)
    b = np.where(over, 0.0, x * np.sqrt(abs((1 - zeta) * (1 + zeta))))
    gap = np.where(over, x**2 / np.where(over, a + theta, 1.0), a)  # a - theta
    e, f = np.exp(-a), np.exp(-gap)
    sinh = -0.5 * np.expm1(-2 * a)
    ratio = np.where(over, -f * np.expm1(-2 * theta) / np.where(over, 2 * theta, 1.0), e * np.sinc(b / np.pi))  # sin b / b
    less = np.where(over, 0.5 * np.expm1(-a - theta) * np.expm1(-gap), 0.5 * np.expm1(-a) ** 2 + 2 * e * np.sin(b / 2) ** 2)
    more = np.where(over, 0.5 * (1 + np.exp(-a - theta)) * (1 + f), 0.5 * np.expm1(-a) ** 2 + 2 * e * np.cos(b / 2) ** 2)
    _refuse_nyquist(less, more, omega)
    m0, m1 = (sinh - a * ratio) / more, -dt * ratio / more
    M = np.stack([np.stack([m0, m1], -1), np.stack([-(omega**2) * m1, m0 - 2 * zeta * omega * m1], -1)], axis=1)
    size = np.sqrt(less * more)
    ratios = np.divide(sinh, size, out=np.zeros_like(size), where=size > 0)
    return WarpedModes(2 / dt * np.sqrt(less / more), ratios, M, dt)


def _refuse_nyquist(less: FloatArray, more: FloatArray, omega: FloatArray) -> None:
    at = np.flatnonzero(more <= 1e-24 * less)
    if at.size:
        hz = omega[at[0]] / (2 * np.pi)
        raise InputError(
            f"sampled loop: mode {at[0]} (counted from 0) at {hz:.6g} Hz has no damping and lies at an odd multiple of the"
            " Nyquist frequency, where its samples only alternate; give it damping or change the sample time"
        )


def warped_plant(modes: WarpedModes, rows: FloatArray, held: FloatArray, force: FloatArray, direct: FloatArray) -> ModalPlant:
    """The plant in w of [eta; eta']+ = F [eta; eta'] + held (force u), y = rows [eta; eta'] + direct u.

    rows: (ny, 2, n); held: (n, 2); force: (n, nu). With K = I + M and z = (1 + v) / (1 - v), v = w T / 2:
        rows (z I - F)^-1 held = rows K^2 / 2 (v I + M)^-1 held - rows K held / 2
    """
    K, M = np.eye(2) + modes.M, modes.M
    adjugate = np.stack([np.stack([M[:, 1, 1], -M[:, 0, 1]], -1), np.stack([-M[:, 1, 0], M[:, 0, 0]], -1)], axis=1)
    seen = 0.5 * np.einsum("yin,nij,njk->ynk", rows, K, K)
    velocity = np.einsum("yni,ni->yn", seen, held) * (2 / modes.dt)
    position = np.einsum("yni,nij,nj->yn", seen, adjugate, held) * (2 / modes.dt) ** 2
    constant = -0.5 * np.einsum("yin,nij,nj->yn", rows, K, held) @ force
    return ModalPlant(
        omega=modes.omega,
        zeta=modes.zeta,
        shape_in=force,
        shape_out=position,
        shape_out_velocity=velocity,
        feedthrough=direct + constant,
        inputs=[f"u{k}" for k in range(force.shape[1])],
        outputs=[f"y{k}" for k in range(len(rows))],
        name="sampled modes",
    )


def warped_space(system: StateSpace, dt: float) -> StateSpace:
    """A discrete state space over w: with N = (A + I)^-1, (2 / T) N (A - I), (4 / T) N N B, C, D - C N B."""
    A, B, C, D = system.A, system.B, system.C, system.D
    shifted = A + np.eye(system.n_states)
    if system.n_states and np.linalg.cond(shifted) > AT_NYQUIST:
        raise InputError(
            f"sampled loop: block {system.name!r} has a pole at z = -1 (the Nyquist frequency), where its response is infinite;"
            " move this pole inside the unit circle"
        )
    once = np.linalg.solve(shifted, B)
    moved = np.asarray(np.linalg.solve(shifted, A - np.eye(system.n_states)), dtype=float)
    into = np.asarray(np.linalg.solve(shifted, once), dtype=float)
    D = D - C @ once
    return StateSpace(2 / dt * moved, 4 / dt * into, C, D, system.inputs, system.outputs, name=system.name)
