"""Frequency response of state-space plants."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.linalg

from flexplant.errors import InputError
from flexplant.numerics.threads import one_thread
from flexplant.plant.state_space import StateSpace

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
BLOCK = 256
ROWS = 32  # rows of the triangular solution that are updated by one matrix product
WELL_CONDITIONED = 1e4  # eigenvectors up to which pole-residue sums keep about twelve digits
NEAR_POLE = 1e-14  # distance of an evaluation point from a pole, relative to the largest pole, that counts as on it


class TransferFunction:
    """s -> C (s I - A)^-1 B + D with A decomposed once: balanced, then poles and residues or a complex Schur form."""

    @one_thread
    def __init__(self, system: StateSpace) -> None:
        self.system = system
        self.poles = np.zeros(0, dtype=complex)
        if not system.n_states:
            return
        A, (scale, _) = scipy.linalg.matrix_balance(system.A, permute=False, separate=True)
        B, C = system.B / scale[:, None], system.C * scale[None, :]
        self.poles, vectors = scipy.linalg.eig(A)
        self._solved = _pole_residue
        if np.linalg.cond(vectors) <= WELL_CONDITIONED:
            self._T, self._left, self._right = np.diag(self.poles), np.linalg.solve(vectors, B.astype(complex)), C @ vectors
        else:
            self._T, unitary = scipy.linalg.schur(A, output="complex")
            self._left, self._right, self._solved = unitary.conj().T @ B, C @ unitary, _triangular

    @property
    def residues(self) -> tuple[ComplexArray, ComplexArray, ComplexArray] | None:
        """(poles (n,), left (ny, n), right (n, nu)) with G = sum left_k right_k / (s - p_k) + D; None in Schur form."""
        if not self.system.n_states or self._solved is not _pole_residue:
            return None
        return self.poles, np.asarray(self._right, dtype=complex), np.asarray(self._left, dtype=complex)

    @one_thread
    def __call__(self, s: ComplexArray) -> ComplexArray:
        """(ny, nu, nf) at complex points s (nf,); InputError where one lies on a pole."""
        system = self.system
        out = np.repeat(system.D[:, :, None].astype(complex), s.size, axis=2)
        if system.n_states:
            _refuse_poles(system, np.diag(self._T), s)
            for start in range(0, s.size, BLOCK):
                at = slice(start, start + BLOCK)
                out[:, :, at] += self._solved(self._T, self._left, self._right, s[at])
        return out


def _refuse_poles(system: StateSpace, poles: ComplexArray, s: ComplexArray) -> None:
    radius = NEAR_POLE * max(float(abs(poles).max()), 1e-300)
    for pole in poles[(abs(poles.real) <= radius) if system.dt is None else abs(abs(poles) - 1) <= radius]:
        if (abs(s - pole) <= radius).any():
            where = (pole.imag if system.dt is None else np.angle(pole) / system.dt) / (2 * np.pi)
            raise InputError(
                f"state space {system.name!r} has an undamped pole at {abs(where):.9g} Hz, where its response is asked for; "
                "leave this frequency out (0 Hz: an integrator or a rigid-body mode)"
            )


def _pole_residue(T: ComplexArray, left: ComplexArray, right: ComplexArray, s: ComplexArray) -> ComplexArray:
    residues = (right[:, None, :] * left.T[None, :, :]).reshape(-1, T.shape[0])
    out: ComplexArray = (residues @ (1 / (s - np.diag(T)[:, None]))).reshape(right.shape[0], left.shape[1], s.size)
    return out


def _triangular(T: ComplexArray, left: ComplexArray, right: ComplexArray, s: ComplexArray) -> ComplexArray:
    """right (s I - T)^-1 left by back substitution for all s at once, ROWS rows between matrix products."""
    n, nu = left.shape
    x = np.repeat(left[:, :, None].astype(complex), s.size, axis=2).reshape(n, -1)
    for stop in range(n, 0, -ROWS):
        start = max(stop - ROWS, 0)
        for i in range(stop - 1, start - 1, -1):
            x[i] += T[i, i + 1 : stop] @ x[i + 1 : stop]
            x[i] = (x[i].reshape(nu, -1) / (s - T[i, i])).ravel()
        x[:start] += T[:start, start:stop] @ x[start:stop]
    out: ComplexArray = (right @ x).reshape(right.shape[0], nu, s.size)
    return out
