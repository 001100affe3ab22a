"""Where a transfer function crosses a level: every crossing, from the eigenvalues of a Hamiltonian pencil, not from a grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.linalg
from scipy.optimize import brentq

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray
from flexplant.plant.state_space import StateSpace
from flexplant.response.first_order import TransferFunction

NEAR_AXIS = 1e-6  # real part of an eigenvalue relative to its size, up to which it is examined as a crossing
PENCIL_LIMIT = 1e10  # condition of the direct terms above which they are not eliminated


@dataclass(frozen=True, eq=False)
class Gain:
    """Largest singular value of a state space over frequency, and all its level crossings.

    Discrete systems are taken through s = (z - 1) / (z + 1), which keeps every gain; `hz` maps back.
    """

    system: StateSpace

    def __post_init__(self) -> None:
        continuous = self.system if self.system.dt is None else _bilinear(self.system)
        object.__setattr__(self, "continuous", _balanced(continuous))
        object.__setattr__(self, "transfer", TransferFunction(self.continuous))

    continuous: StateSpace = None  # type: ignore[assignment]
    transfer: TransferFunction = None  # type: ignore[assignment]

    def __call__(self, omega: npt.ArrayLike) -> FloatArray:
        """(nf,) largest singular value at omega of the continuous system."""
        values = self.transfer(1j * np.atleast_1d(np.asarray(omega, dtype=float))).transpose(2, 0, 1)
        return np.asarray(np.linalg.svd(values, compute_uv=False).max(axis=1, initial=0.0))  # 0 without channels

    def hz(self, omega: npt.ArrayLike) -> FloatArray:
        """Frequencies in Hz of the given omega of the continuous system."""
        w = np.asarray(omega, dtype=float)
        return w / (2 * np.pi) if self.system.dt is None else np.arctan(w) / (np.pi * self.system.dt)

    def omega(self, hz: npt.ArrayLike) -> FloatArray:
        """The inverse of `hz`."""
        f = np.asarray(hz, dtype=float)
        return 2 * np.pi * f if self.system.dt is None else np.tan(np.pi * f * self.system.dt)

    def crossings(self, level: float) -> FloatArray:
        """Ascending omega > 0 where the largest singular value passes through `level`, refined by root finding."""
        return sign_changes(lambda w: float(np.log(max(self(w)[0], 1e-300) / level)), self.candidates(level))

    def candidates(self, level: float) -> FloatArray:
        """Ascending omega >= 0 that contain every frequency where some singular value equals `level`."""
        g = self.continuous
        nu, ny, n = g.B.shape[1], g.C.shape[0], g.n_states
        if n == 0:
            return np.zeros(0)
        direct = np.block([[g.D, -level * np.eye(ny)], [-level * np.eye(nu), g.D.T]])
        left = scipy.linalg.block_diag(g.B, -g.C.T)
        right = scipy.linalg.block_diag(g.C, g.B.T)
        dynamic = scipy.linalg.block_diag(g.A, -g.A.T)
        if np.linalg.cond(direct) < PENCIL_LIMIT:
            values = scipy.linalg.eigvals(dynamic - left @ np.linalg.solve(direct, right))
        else:
            pencil = np.block([[dynamic, left], [right, direct]])
            mass = scipy.linalg.block_diag(np.eye(2 * n), np.zeros_like(direct))
            values = scipy.linalg.eigvals(pencil, mass)
        return on_axis(values)


def on_axis(values: npt.NDArray[np.complex128]) -> FloatArray:
    """Ascending distinct |imaginary parts| of the finite eigenvalues that lie near the imaginary axis."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return np.zeros(0)
    smallest = 1e-11 * float(np.median(abs(finite)))
    near = finite[abs(finite.real) <= NEAR_AXIS * abs(finite) + smallest]
    return np.unique(abs(near.imag))


def sign_changes(function: Callable[[float], float], candidates: FloatArray) -> FloatArray:
    """Roots of `function` with a change of sign; between two neighbouring candidates the sign is known to be constant.

    Candidates without a change of sign (touching points, round-off) drop out.
    """
    positive = candidates[candidates > 0]
    if not positive.size:
        return np.zeros(0)
    between = np.sqrt(positive[:-1] * positive[1:])
    edges = np.r_[positive[0] / 2, between, positive[-1] * 2]
    values = [function(w) for w in edges]
    roots = [
        brentq(function, a, b, xtol=1e-13 * a, rtol=1e-13)
        for a, b, fa, fb in zip(edges[:-1], edges[1:], values[:-1], values[1:], strict=True)
        if fa * fb < 0
    ]
    return np.array(roots)


def _balanced(system: StateSpace) -> StateSpace:
    if not system.n_states:
        return system
    A, (scale, _) = scipy.linalg.matrix_balance(system.A, permute=False, separate=True)
    B, C = system.B / scale[:, None], system.C * scale[None, :]
    size_in, size_out = float(abs(B).max(initial=0.0)), float(abs(C).max(initial=0.0))
    shift = 2.0 ** np.round(np.log2(size_out / size_in) / 2) if size_in and size_out else 1.0
    return StateSpace(A, B * shift, C / shift, system.D, system.inputs, system.outputs, name=system.name)


def _bilinear(system: StateSpace) -> StateSpace:
    identity = np.eye(system.n_states)
    shifted = system.A + identity
    if system.n_states and np.linalg.cond(shifted) > 1e13:
        raise InputError(f"state space {system.name!r} has a pole at z = -1 (the Nyquist frequency); its gain is unbounded there")
    B: FloatArray = scipy.linalg.solve(shifted, system.B)
    A: FloatArray = scipy.linalg.solve(shifted, system.A - identity)
    C: FloatArray = scipy.linalg.solve(shifted.T, system.C.T).T
    root = np.sqrt(2.0)
    return StateSpace(A, root * B, root * C, system.D - system.C @ B, system.inputs, system.outputs, name=system.name)
