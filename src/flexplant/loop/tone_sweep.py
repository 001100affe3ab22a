"""Steady states of a `Cascade` at many frequencies, each with its own input: one pass over modes and frequencies."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.linalg

from flexplant.errors import InputError
from flexplant.loop.cascade import Cascade
from flexplant.model.arrays import FloatArray
from flexplant.response.receptance import ModalSum

ComplexArray = npt.NDArray[np.complex128]
SMALL = 40  # states of the rest that are cheap to solve for at every frequency
WELL_CONDITIONED = 1e4  # eigenvectors of the rest up to which its poles and residues are used


class ToneSweep:
    """z(w) of inputs a exp(i w t): modes by receptances, the rest by poles and residues (or solved, where badly conditioned).

    Everything that does not depend on w is made once, in real arithmetic as far as it goes.
    """

    def __init__(self, cascade: Cascade) -> None:
        self.cascade, self.flexible = cascade, cascade.omega > 0
        n = cascade.omega.size
        rows = np.vstack([cascade.C_modes, cascade.from_modes])
        self._used = rows.any(axis=1)
        self._position, self._velocity = rows[self._used, :n], rows[self._used, n:]
        self._poles = np.zeros(0, dtype=complex)
        self._vectors: ComplexArray | None = None
        if cascade.A.size:
            A, (scale, _) = scipy.linalg.matrix_balance(cascade.A, permute=False, separate=True)
            self._poles, vectors = scipy.linalg.eig(A)
            if np.linalg.cond(vectors) <= WELL_CONDITIONED:
                self._vectors = scale[:, None] * vectors

    @property
    def pays(self) -> bool:
        """False where the rest is large and badly conditioned, and the block-by-block frequency response is the better way."""
        return self.cascade.A.shape[0] <= SMALL or self._vectors is not None

    def __call__(self, amplitude: ComplexArray, omega: FloatArray) -> ComplexArray:
        """(nz, nf) outputs for one input vector a (nw,) at omega (nf,) rad/s. InputError on an undamped mode."""
        self._refuse_poles(omega)
        cascade, nz = self.cascade, self.cascade.D.shape[0]
        force = cascade.shape_in @ amplitude
        through = np.zeros((nz + cascade.A.shape[0], omega.size), dtype=complex)
        through[self._used] = self._modal(force, omega)
        s = np.asarray(1j * omega if cascade.dt is None else np.exp(1j * omega * cascade.dt), dtype=np.complex128)
        direct = (cascade.D @ amplitude)[:, None]
        if not cascade.A.size:
            return np.asarray(through + direct)
        driven: ComplexArray = np.asarray(through[nz:] + (cascade.B @ amplitude)[:, None])
        return np.asarray(through[:nz] + direct + self._rest(driven, s))

    def _modal(self, force: ComplexArray, omega: FloatArray) -> ComplexArray:
        """(rows, nf) what the modes add under the modal force (n,)."""
        cascade, flexible = self.cascade, self.flexible
        parts = [p * f for p in (self._position, self._velocity) for f in (force.real, force.imag)]
        needed = [bool(part.any()) for part in parts]
        stacked = np.vstack([np.zeros((0, force.size)), *(p for p, use in zip(parts, needed, strict=True) if use)])
        rigid = stacked[:, ~flexible].sum(axis=1)
        product = ModalSum(stacked[:, flexible], cascade.omega[flexible], cascade.zeta[flexible])(omega)
        if rigid.any():
            product += np.outer(rigid, -1 / np.where(omega == 0, np.inf, omega) ** 2)
        pieces = iter(np.split(product, sum(needed)) if any(needed) else [])
        none = np.zeros((self._position.shape[0], omega.size), dtype=complex)
        found: list[ComplexArray] = [next(pieces) if use else none for use in needed]
        out: ComplexArray = found[0] + 1j * found[1] + 1j * omega * (found[2] + 1j * found[3])
        return out

    def _rest(self, driven: ComplexArray, s: ComplexArray) -> ComplexArray:
        cascade = self.cascade
        if self._vectors is not None:
            modal = np.linalg.solve(self._vectors, driven)
            return np.asarray((cascade.C @ self._vectors) @ (modal / (s - self._poles[:, None])))
        matrix = s[:, None, None] * np.eye(cascade.A.shape[0]) - cascade.A
        return np.asarray(cascade.C @ np.linalg.solve(matrix, driven.T[:, :, None])[:, :, 0].T)

    def _refuse_poles(self, omega: FloatArray) -> None:
        undamped = self.cascade.omega[(self.cascade.zeta == 0) | ~self.flexible]
        hit = np.intersect1d(undamped, omega)
        if hit.size:
            where = hit[0] / (2 * np.pi)
            raise InputError(
                f"no steady state: a tone at {where:.6g} Hz meets an undamped mode; give it damping, or leave it out"
            )
        size = abs(self._poles).max(initial=0.0)
        s = 1j * omega if self.cascade.dt is None else np.exp(1j * omega * self.cascade.dt)
        for pole in self._poles[abs(self._poles.real) <= 1e-14 * size] if self.cascade.dt is None else self._poles:
            if (abs(s - pole) <= 1e-14 * size).any():
                raise InputError(
                    f"no steady state: a tone meets an undamped pole of the loop at {abs(pole.imag) / (2 * np.pi):.6g} Hz"
                )
