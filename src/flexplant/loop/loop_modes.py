"""A loop that feeds back into its plants in its own modes: blocks of two states that no longer hear each other.

Each block is driven by the inputs alone and is stepped exactly; the states and outputs are sums over blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.linalg

from flexplant.loop.cascade import Cascade, Inner
from flexplant.model.arrays import FloatArray
from flexplant.plant.discretize import mode_steps

ComplexArray = npt.NDArray[np.complex128]
LARGEST_CONDITION = 1e4  # of a pole: how much larger its eigenvectors' product is than that of a normal matrix
LARGEST_GROWTH = 2000.0  # of the terms of a separated mode's equation over their sum
RESIDUAL = 1e-11  # of the eigenvectors, relative to the balanced matrix
ROUND_OFF = 1e-13  # relative to the largest, below which an effect is none


@dataclass(frozen=True, eq=False)
class LoopModes:
    """x = outward b, b = inward x: the blocks' first states, then their second ones; b' is block diagonal.

    omega, zeta: of the blocks that come first, modes that the loop does not reach, states eta and eta'. poles: (k, 2) of the
    others: a pair of conjugate poles (states Re and -Im of its complex coordinate), or two real ones. forces: (2 blocks, nw).
    """

    omega: FloatArray
    zeta: FloatArray
    poles: ComplexArray
    outward: FloatArray
    inward: FloatArray
    forces: FloatArray
    condition: float

    def steps(self, dt: float, hold: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Transition (blocks, 2, 2) over dt; what a held input and its ramp add: (blocks, 2, nw) each."""
        free, nw = self.omega.size, self.forces.shape[1]
        forces = self.forces.reshape(2, -1, nw).swapaxes(0, 1)
        modes = mode_steps(self.omega, self.zeta, dt, hold)
        none = np.zeros_like(modes.hold)
        transition, held, ramped = _pole_steps(self.poles, forces[free:], dt)
        force = forces[:free, 1, None]
        held = np.vstack([modes.hold[:, :, None] * force, held])
        ramped = np.vstack([(none if modes.ramp is None else modes.ramp)[:, :, None] * force, ramped])
        return np.vstack([modes.transition, transition]), held, ramped if hold == "first" else np.zeros_like(ramped)


def _pole_steps(poles: ComplexArray, forces: FloatArray, dt: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The exact step of z' = pole z + force: exp(pole dt), dt phi1(pole dt) force and dt phi2(pole dt) force, as blocks."""
    pair = poles[:, 0].imag > 0
    x = poles * dt
    e, (one, two) = np.exp(x), phi_functions(x)
    transition = np.zeros((len(poles), 2, 2))
    transition[:, 0, 0], transition[:, 1, 1] = e[:, 0].real, e[:, 1].real
    transition[pair, 0, 1], transition[pair, 1, 0] = e[pair, 0].imag, -e[pair, 0].imag
    z = forces[:, 0] - 1j * forces[:, 1]
    added = []
    for factor in (dt * one, dt * two):
        whole = factor[:, :1] * z
        added.append(np.stack([whole.real, -whole.imag], axis=1))
        added[-1][~pair] = factor[~pair].real[:, :, None] * forces[~pair]
    return transition, added[0], added[1]


def phi_functions(x: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """phi1 = (e^x - 1) / x and phi2 = (phi1 - 1) / x, by their series where the differences would lose digits."""
    near = abs(x) < 1.0
    small, large = np.where(near, x, 0), np.where(near, 1, x)
    two = np.zeros_like(x)
    for k in range(20, 1, -1):
        two = (two * small + 1) / k
    one = np.where(near, 1 + two * small, np.expm1(large) / large)
    return one, np.where(near, two, (one - 1) / large)


def loop_modes(cascade: Cascade) -> LoopModes | str:
    """The modes of a continuous loop, or why it is stepped as one dense block instead.

    Modes that no feedback drives stay as they are, rigid-body modes in a basis in which as many as possible do; the others and
    the controllers are diagonalised, and then freed from what they hear of the first: with W the inverse of the eigenvectors,
    W core - T free is driven by the inputs alone where Lambda T - T F = -W H (see `parallel`).
    """
    n, N, parts = cascade.omega.size, cascade.n_states, [undriven(part) for part in cascade.inner]
    core, apart = _bases(cascade, parts)
    found = _diagonal(core.T @ cascade.A @ core)
    if isinstance(found, str):
        return found
    poles, V, W, condition = found
    omega = np.concatenate([cascade.omega, *(part.omega for part in parts)])
    zeta = np.concatenate([cascade.zeta, *(part.zeta for part in parts)])
    k, free = omega.size, np.zeros((N, 2, omega.size))
    free[: 2 * n, :, :n] = np.eye(2 * n).reshape(2 * n, 2, n)
    free[2 * n :, :, n:] = apart
    columns, inside = free.reshape(N, 2 * k), np.vstack([np.zeros((2 * n, core.shape[1])), core])
    shape, whole = (2, len(poles), 2, k), np.hstack([cascade.from_modes, cascade.A])
    heard = (W @ (core.T @ (whole @ columns))).reshape(shape)
    noise = ROUND_OFF * (abs(W) @ (abs(core.T) @ (abs(whole) @ abs(columns)))).reshape(shape)
    T = _separation(poles, heard, noise, omega, zeta)
    if isinstance(T, str):
        return T
    parts_of = np.split(np.arange(2 * (k + len(poles))), np.cumsum([k, k, len(poles)]))
    order = np.concatenate([parts_of[i] for i in (0, 2, 1, 3)])
    outward = np.hstack([columns + inside @ (V @ T), inside @ V])[:, order]
    inward = np.vstack([columns.T, W @ inside.T - T @ columns.T])[order]
    forces = inward @ np.vstack([np.zeros_like(cascade.shape_in), cascade.shape_in, cascade.B])
    return LoopModes(omega, zeta, poles, outward, inward, forces, condition)


def _diagonal(A: FloatArray) -> tuple[ComplexArray, FloatArray, FloatArray, float] | str:
    """Poles (k, 2) in blocks, V and W = V^-1 with A = V blocks W, the largest condition of a pole; or why there are none."""
    balanced, (scale, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    values, vectors = scipy.linalg.eig(balanced)
    pair, real = np.flatnonzero(values.imag > 0), np.flatnonzero(values.imag == 0)
    second = real[1::2]
    V = np.hstack([vectors[:, pair].real, vectors[:, real[::2]].real, vectors[:, pair].imag, vectors[:, second].real])
    try:
        W = np.linalg.inv(V)
    except np.linalg.LinAlgError:
        return "it has multiple poles without as many modes"
    p, k = pair.size, pair.size + (real.size + 1) // 2
    left = np.vstack([0.5 * abs(W[:p] - 1j * W[k : k + p]), abs(W[p:k]), abs(W[k + p :])])
    peak = np.maximum(left.max(axis=1, initial=0.0), 1.0)
    size = np.append(peak * np.linalg.norm(left / peak[:, None], axis=1), 1.0)
    worst = int(size.argmax())
    if not size[worst] <= LARGEST_CONDITION:
        pole = values[np.concatenate([pair, real[::2], second])[worst]]
        return f"its poles near {abs(pole):.4g} rad/s are nearly multiple (condition {size[worst]:.1e})"
    poles = np.zeros((k, 2), dtype=complex)
    poles[:p, 0], poles[:p, 1] = values[pair], values[pair].conj()
    poles[p:, 0], poles[p : p + second.size, 1] = values[real[::2]], values[second]
    if real.size % 2:
        V, W = np.hstack([V, np.zeros((len(A), 1))]), np.vstack([W, np.zeros((1, len(A)))])
    error = abs(_turned(poles, W) - W @ balanced).max(initial=0.0)
    if error > RESIDUAL * np.linalg.norm(balanced) * abs(W).max(initial=1.0):
        return f"its modes leave a residual of {error:.1e}"
    return poles, scale[:, None] * V, W / scale, float(size[worst])


def _turned(poles: ComplexArray, rows: FloatArray) -> FloatArray:
    """The block diagonal matrix of the poles times rows (2k, .)."""
    first, second = np.split(rows, 2)
    a, d, turn = poles[:, :1].real, poles[:, 1:].real, poles[:, :1].imag
    return np.vstack([a * first + turn * second, d * second - turn * first])


def _separation(
    poles: ComplexArray, heard: FloatArray, noise: FloatArray, omega: FloatArray, zeta: FloatArray
) -> FloatArray | str:
    """T (2k, 2n) with blocks T - T F = -heard; or why not. heard, noise: (2, k, 2, n) what blocks hear of eta and eta'."""
    pair = (poles[:, 0].imag > 0)[:, None, None]
    both, F = noise[0] + noise[1], (omega, zeta)
    first = _listening(poles[:, :1], np.where(pair, heard[0] - 1j * heard[1], heard[0]), both, *F)
    second = _listening(poles[:, 1:], np.where(pair, heard[0] + 1j * heard[1], heard[1]), both, *F)
    if first is None or second is None:
        return "a mode that the loop does not drive lies beside a pole of the loop"
    return np.stack([first.real, np.where(pair, -first.imag, second.real)]).reshape(2 * len(poles), 2 * omega.size)


def _listening(
    poles: ComplexArray, heard: ComplexArray, noise: FloatArray, omega: FloatArray, zeta: FloatArray
) -> ComplexArray | None:
    """s (k, 2, n) with pole s - s F = -heard of each pole (k, 1) and mode; None where they are too near to each other.

    What a pole does not hear but for noise may be as near as it likes: an integrator reads the way of a free body in its rate.
    """
    position, velocity, decay = heard[:, 0], heard[:, 1], 2 * zeta * omega
    size, force = abs(poles), position + poles * velocity
    bottom, terms = poles**2 + decay * poles + omega**2, size**2 + decay * size + omega**2
    near = (abs(bottom) * LARGEST_GROWTH < terms) | (bottom == 0) | (size + omega < ROUND_OFF * size.max(initial=0.0))
    if (near & (abs(force) > noise[:, 0] + size * noise[:, 1] + ROUND_OFF * size.max(initial=0.0) * abs(velocity))).any():
        return None
    fast = np.where(near, 0.0, -force / np.where(near, 1.0, bottom))
    return np.stack([(poles + decay) * fast + velocity, fast], axis=1)


def _bases(cascade: Cascade, parts: Sequence[Apart]) -> tuple[FloatArray, FloatArray]:
    """Orthonormal columns of the other states: those that the loop closes on (m, .), and (m, 2, k) of the modes apart."""
    m = cascade.A.shape[0]
    apart, core, plain = [np.zeros((m, 2, 0))], [np.zeros((m, 0))], np.ones(m, dtype=bool)
    for inner, part in zip(cascade.inner, parts, strict=True):
        n, k = part.basis.shape
        places = inner.first + np.arange(2 * n).reshape(2, n)
        plain[places] = False
        columns, rest = np.zeros((m, 2, k)), np.zeros((m, 2, n - k))
        for order in (0, 1):
            columns[places[order], order], rest[places[order], order] = part.basis, part.rest
        apart.append(columns)
        core.append(rest.reshape(m, -1))
    return np.hstack([*core, np.eye(m)[:, plain]]), np.concatenate(apart, axis=2)


@dataclass(frozen=True, eq=False)
class Apart:
    """Modes of a plant that no feedback drives, in an orthonormal basis (n, k) of its modes, and the rest of that basis."""

    omega: FloatArray
    zeta: FloatArray
    basis: FloatArray
    rest: FloatArray


def undriven(inner: Inner) -> Apart:
    """The modes that none of the inputs fed back drives: single ones, and directions among the rigid-body modes."""
    largest = abs(inner.fed_back).max(axis=0, initial=0.0)
    shape = inner.fed_back / np.where(largest > 0, largest, 1.0)
    n, rigid = inner.omega.size, inner.omega == 0
    basis = np.eye(n)
    still = ~shape.any(axis=1) & ~rigid
    if rigid.any():
        directions, sizes, _ = np.linalg.svd(shape[rigid])
        rank = int((sizes > ROUND_OFF * abs(shape).max(initial=0.0)).sum())
        basis[np.ix_(rigid, rigid)] = directions
        still[np.flatnonzero(rigid)[rank:]] = True
    return Apart(inner.omega[still], inner.zeta[still], basis[:, still], basis[:, ~still])
