"""Balanced truncation of general state-space plants, the part that is not stable kept exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from flexplant.errors import InputError, SolverError, expect, expect_count
from flexplant.model.arrays import FloatArray, is_number
from flexplant.plant.state_space import StateSpace, channels_of

ON_AXIS = 1e-10  # stability margin relative to the largest pole below which a pole counts as not stable (integrators)


@dataclass(frozen=True, eq=False)
class BalancedTruncation:
    """plant: the reduced state space; hankel_singular_values of the stable part, descending; n_unstable states kept exactly.

    error_bound: 2 times the sum of the dropped values, which bounds the largest singular value of the error at all frequencies.
    """

    plant: StateSpace
    hankel_singular_values: FloatArray
    n_unstable: int
    error_bound: float


def balanced_truncation(system: StateSpace, *, order: int | None = None, tolerance: float | None = None) -> BalancedTruncation:
    """Balanced truncation by the square-root method; unstable and undamped poles are split off first and kept.

    order: states of the result, those of the unstable part counted; tolerance: error bound relative to the largest Hankel
    singular value. Continuous or discrete. Raises InputError unless exactly one of the two is given, or out of range.
    Source: Moore 1981; Enns 1984; Tombs and Postlethwaite 1987.
    """
    expect(system, StateSpace, "balanced_truncation", "state_space(plant) makes one")
    if (order is None) == (tolerance is None):
        raise InputError("balanced_truncation: give either order or tolerance")
    stable, rest = split_stable(system)
    factor_c, factor_o = (_root(g) for g in gramians(stable))
    U, values, Vt = np.linalg.svd(factor_o.T @ factor_c)
    kept = _count(values, order, tolerance, rest.n_states, system)
    s = values[:kept] ** -0.5
    left, right = (factor_o @ U[:, :kept]) * s, (factor_c @ Vt[:kept].T) * s
    reduced = (left.T @ stable.A @ right, left.T @ stable.B, stable.C @ right)
    A = scipy.linalg.block_diag(reduced[0], rest.A)
    B, C = np.vstack([reduced[1], rest.B]), np.hstack([reduced[2], rest.C])
    plant = StateSpace(A, B, C, system.D, dt=system.dt, **channels_of(system))
    return BalancedTruncation(plant, values, rest.n_states, float(2 * values[kept:].sum()))


def _count(values: FloatArray, order: int | None, tolerance: float | None, unstable: int, system: StateSpace) -> int:
    numerical = int(np.count_nonzero(values > values.max(initial=0.0) * 1e-15))
    if order is not None:
        expect_count(order, "balanced_truncation: order")
        if not unstable <= order <= system.n_states:
            raise InputError(
                f"balanced_truncation: order = {order}, but it must lie between the {unstable} states that are not stable "
                f"and all {system.n_states}"
            )
        return min(order - unstable, numerical)
    if not is_number(tolerance) or not 0 <= tolerance < np.inf:
        raise InputError(f"balanced_truncation: tolerance must be finite and not negative, got {tolerance!r}")
    tail = 2 * np.cumsum(values[::-1])[::-1]
    return min(int(np.count_nonzero(tail > tolerance * values.max(initial=0.0))), numerical)


def split_stable(system: StateSpace) -> tuple[StateSpace, StateSpace]:
    """(stable, not stable) parts with G = G_stable + G_rest and D in neither: ordered Schur form and a Sylvester equation."""
    if not system.n_states:
        empty = _part(system, system.A, system.B, system.C)
        return empty, empty
    A, (scale, _) = scipy.linalg.matrix_balance(system.A, permute=False, separate=True)
    B, C = system.B / scale[:, None], system.C * scale[None, :]
    size = float(abs(scipy.linalg.eigvals(A)).max())

    def inside(real: float, imaginary: float) -> bool:
        return bool(real < -ON_AXIS * size if system.dt is None else np.hypot(real, imaginary) < 1 - ON_AXIS)

    T, Q, k = scipy.linalg.schur(A, output="real", sort=inside)
    X = scipy.linalg.solve_sylvester(T[:k, :k], -T[k:, k:], -T[:k, k:]) if 0 < k < T.shape[0] else np.zeros((k, T.shape[0] - k))
    QB, CQ = Q.T @ B, C @ Q
    return (
        _part(system, T[:k, :k], QB[:k] - X @ QB[k:], CQ[:, :k]),
        _part(system, T[k:, k:], QB[k:], CQ[:, k:] + CQ[:, :k] @ X),
    )


def _part(system: StateSpace, A: FloatArray, B: FloatArray, C: FloatArray) -> StateSpace:
    return StateSpace(A, B, C, np.zeros_like(system.D), dt=system.dt, **channels_of(system))


def gramians(system: StateSpace) -> tuple[FloatArray, FloatArray]:
    """Controllability and observability Gramians of a stable state space (Lyapunov equations); SolverError if it is not."""
    if not system.n_states:
        return np.zeros((0, 0)), np.zeros((0, 0))
    poles = np.linalg.eigvals(system.A)
    if (poles.real.max() >= 0) if system.dt is None else (abs(poles).max() >= 1):
        raise SolverError(f"state space {system.name!r} is not stable, so it has no Gramians; split the unstable part off first")
    A, B, C = system.A, system.B, system.C
    if system.dt is None:
        solve = scipy.linalg.solve_continuous_lyapunov
        return np.asarray(solve(A, -B @ B.T)), np.asarray(solve(A.T, -C.T @ C))
    return (
        np.asarray(scipy.linalg.solve_discrete_lyapunov(A, B @ B.T)),
        np.asarray(scipy.linalg.solve_discrete_lyapunov(A.T, C.T @ C)),
    )


def gramian_singular_values(system: StateSpace) -> FloatArray:
    """Hankel singular values of a stable state space, descending."""
    factor_c, factor_o = (_root(g) for g in gramians(system))
    return np.asarray(np.linalg.svd(factor_o.T @ factor_c, compute_uv=False))


def _root(gramian: FloatArray) -> FloatArray:
    """F with F F^T = gramian; eigenvalues that round-off made negative count as zero."""
    values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T)) if gramian.size else (np.zeros(0), gramian)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
