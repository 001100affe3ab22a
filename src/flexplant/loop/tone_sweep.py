"""Steady states of a `Cascade` for several inputs, each at many frequencies of its own: one pass over modes and frequencies."""

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
                self._to_modal = np.linalg.solve(self._vectors, np.eye(A.shape[0]))

    @property
    def pays(self) -> bool:
        """False where the rest is large and badly conditioned, and the block-by-block frequency response is the better way."""
        return self.cascade.A.shape[0] <= SMALL or self._vectors is not None

    def __call__(self, amplitude: ComplexArray, omega: FloatArray) -> ComplexArray:
        """(nz, k, nf) outputs for input vectors a (nw, k), each at omega (k, nf) rad/s, ascending along nf.

        InputError on an undamped mode.
        """
        self._refuse_poles(omega.ravel())
        cascade, nz = self.cascade, self.cascade.D.shape[0]
        out = np.repeat((cascade.D @ amplitude)[:, :, None], omega.shape[1], axis=2)
        driven = np.repeat((cascade.B @ amplitude)[:, :, None], omega.shape[1], axis=2)
        through = self._modal(cascade.shape_in @ amplitude, omega)
        used = np.flatnonzero(self._used)
        seen = int((used < nz).sum())
        out[used[:seen]] += through[:seen]
        driven[used[seen:] - nz] += through[seen:]
        if cascade.A.size:
            s = np.asarray(1j * omega if cascade.dt is None else np.exp(1j * omega * cascade.dt), dtype=np.complex128)
            out += self._rest(driven.reshape(driven.shape[0], -1), s.ravel()).reshape(out.shape)
        return np.asarray(out, dtype=np.complex128)

    def _modal(self, force: ComplexArray, omega: FloatArray) -> ComplexArray:
        """(rows, k, nf) what the modes add under the modal forces (n, k): real sums, for the parts that are there."""
        cascade, flexible = self.cascade, self.flexible
        parts = [p * f.T[:, None, :] for p in (self._position, self._velocity) for f in (force.real, force.imag)]
        needed = [k for k, part in enumerate(parts) if part.any()]
        out = np.zeros((self._position.shape[0], *omega.shape), dtype=complex)
        if not needed:
            return out
        columns = np.concatenate([parts[k] for k in needed], axis=1)
        modes, zeta, stacked = cascade.omega[flexible], cascade.zeta[flexible], columns[:, :, flexible]
        rigid = columns[:, :, ~flexible].sum(axis=2)
        if rigid.any():
            modes, zeta = np.append(modes, 0.0), np.append(zeta, 0.0)
            stacked = np.concatenate([stacked, rigid[:, :, None]], axis=2)
        sums = ModalSum(stacked, modes, zeta).groups(omega).reshape(len(needed), *out.shape)
        for k, values in zip(needed, sums, strict=True):
            if k >= 2:
                values *= omega
            _add_turned(out, values, k // 2 + k % 2)
        return out

    def _rest(self, driven: ComplexArray, s: ComplexArray) -> ComplexArray:
        cascade = self.cascade
        if self._vectors is not None:
            modal = self._to_modal @ driven
            modal /= s - self._poles[:, None]
            return np.asarray((cascade.C @ self._vectors) @ modal)
        matrix = s[:, None, None] * np.eye(cascade.A.shape[0]) - cascade.A
        return np.asarray(cascade.C @ np.linalg.solve(matrix, driven.T[:, :, None])[:, :, 0].T)

    def _refuse_poles(self, omega: FloatArray) -> None:
        undamped = self.cascade.omega[(self.cascade.zeta == 0) | ~self.flexible]
        hit = undamped[np.isin(undamped, omega)]
        if hit.size:
            where = hit[0] / (2 * np.pi)
            raise InputError(
                f"no steady state: a tone at {where:.6g} Hz meets an undamped mode; give it damping, or leave it out"
            )
        size, dt = abs(self._poles).max(initial=0.0), self.cascade.dt
        for pole in self._poles[abs(self._poles.real) <= 1e-14 * size] if dt is None else self._poles:
            s = 1j * omega if dt is None else np.exp(1j * omega * dt)
            if (abs(s - pole) <= 1e-14 * size).any():
                raise InputError(
                    f"no steady state: a tone meets an undamped pole of the loop at {abs(pole.imag) / (2 * np.pi):.6g} Hz"
                )


def _add_turned(out: ComplexArray, values: ComplexArray, quarters: int) -> None:
    """out += i^quarters values."""
    if quarters == 0:
        out += values
    elif quarters == 1:
        out.real -= values.imag
        out.imag += values.real
    else:
        out -= values
