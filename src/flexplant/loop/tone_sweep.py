"""Steady states of a `Cascade` for several inputs, each at many frequencies of its own: one pass over modes and frequencies."""

from __future__ import annotations

import importlib
from typing import NamedTuple, cast

import numpy as np
import numpy.typing as npt
import scipy.linalg

from flexplant.errors import InputError
from flexplant.loop.cascade import Cascade, Simulated, cascade_of
from flexplant.loop.diagram import Diagram
from flexplant.loop.layout import shared_rows
from flexplant.loop.unstable import refuse_growing
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.numerics.compiled import numba
from flexplant.response.receptance import ModalSum
from flexplant.response.tiles import STRIP

ComplexArray = npt.NDArray[np.complex128]
SMALL = 40  # states of the rest that are cheap to solve for at every frequency
WELL_CONDITIONED = 1e4  # eigenvectors of the rest up to which its poles and residues are used
TURNS = np.array([1, 1j, 1j, -1])  # of sums over positions and velocities, under real and imaginary forces: i^(order + part)


def tone_sweep_of(system: Simulated) -> ToneSweep:
    """The sweep of a plant, block or diagram; a diagram keeps it for the next speeds."""
    if not isinstance(system, Diagram):
        return ToneSweep(cascade_of(system))
    if "tone sweep" not in system.derived:
        system.derived["tone sweep"] = ToneSweep(cascade_of(system))
    return cast(ToneSweep, system.derived["tone sweep"])


class Sums(NamedTuple):
    """Real modal sums (count, k, nf): each adds to a row, times turn, and times the frequency where it is fast."""

    values: ComplexArray
    row: IntArray
    turn: ComplexArray
    fast: npt.NDArray[np.bool_]


class ToneSweep:
    """z(w) of inputs a exp(i w t): modes by receptances, the rest by poles and residues (or solved, where badly conditioned).

    Everything that does not depend on w is made once, in real arithmetic as far as it goes. Outputs and loops that read the same
    combination of the modes share its sum: z = read y + C x + D a, s x = A x + into y + B a, y the distinct rows.
    """

    def __init__(self, cascade: Cascade) -> None:
        self.cascade, self.flexible = cascade, cascade.omega > 0
        n, nz = cascade.omega.size, cascade.D.shape[0]
        rows = np.vstack([cascade.C_modes, cascade.from_modes])
        share, row, chosen = shared_rows(rows)
        self._position, self._velocity = rows[chosen, :n], rows[chosen, n:]
        spread = np.zeros((len(rows), len(chosen)))
        spread[np.flatnonzero(share), row[share != 0]] = share[share != 0]
        self._read, self._into = spread[:nz], spread[nz:]
        lasting = (cascade.zeta == 0) | ~self.flexible
        self._undamped = np.unique(cascade.omega[lasting])
        self._poles = np.zeros(0, dtype=complex)
        self._to_modal, self._out_of = np.zeros((0, 0), dtype=complex), np.zeros((nz, 0), dtype=complex)
        self.diagonal = True
        if cascade.A.size:
            self._diagonalise()

    def _diagonalise(self) -> None:
        A, (scale, _) = scipy.linalg.matrix_balance(self.cascade.A, permute=False, separate=True)
        poles, vectors = np.linalg.eig(A)
        self._poles = poles.astype(complex)
        self.diagonal = bool(np.linalg.cond(vectors) <= WELL_CONDITIONED)
        if self.diagonal:
            whole = scale[:, None] * vectors
            self._to_modal, self._out_of = np.linalg.inv(whole), self.cascade.C @ whole

    def refuse_growing(self, name: str, what: str) -> None:
        """InputError with the pole for an unstable system: its steady state is never reached."""
        refuse_growing(self._poles, self.cascade.dt, name, what)

    @property
    def pays(self) -> bool:
        """False where the rest is large and badly conditioned, and the block-by-block frequency response is the better way."""
        return self.cascade.A.shape[0] <= SMALL or self.diagonal

    def __call__(self, amplitude: ComplexArray, omega: FloatArray) -> ComplexArray:
        """(nz, k, nf) outputs for input vectors a (nw, k), each at omega (k, nf) rad/s, ascending along nf.

        InputError on an undamped mode.
        """
        self._refuse_poles(omega)
        cascade = self.cascade
        sums, drive, direct = self._sums(cascade.shape_in @ amplitude, omega), cascade.B @ amplitude, cascade.D @ amplitude
        if numba() is not None and self.diagonal and cascade.dt is None and omega.shape[1] >= STRIP:
            return self._compiled(sums, omega, drive, direct)
        y = np.zeros((self._read.shape[1], *omega.shape), dtype=complex)
        for value, row, turn, fast in zip(*sums, strict=True):
            y[row] += turn * (value * omega if fast else value)
        out = direct[:, :, None] + np.tensordot(self._read, y, axes=1)
        if cascade.A.size:
            s = np.asarray(1j * omega if cascade.dt is None else np.exp(1j * omega * cascade.dt), dtype=np.complex128)
            out += self._rest(drive[:, :, None] + np.tensordot(self._into, y, axes=1), s)
        return np.asarray(out, dtype=np.complex128)

    def _compiled(self, sums: Sums, omega: FloatArray, drive: ComplexArray, direct: ComplexArray) -> ComplexArray:
        """The same by `tone_steps.outputs`."""
        steps = importlib.import_module("flexplant.loop.tone_steps")
        out = np.empty((direct.shape[0], *omega.shape), dtype=complex)
        rows, modal = (np.zeros(count * steps.PAIR) for count in (self._read.shape[1], self._poles.size))
        lists = (self._to_modal @ self._into, self._to_modal @ drive, self._poles, self._out_of, self._read, direct)
        tables = [np.ascontiguousarray(table, dtype=complex).reshape(-1).view(float) for table in lists]
        flat = [array.reshape(-1).view(float) for array in (sums.values, sums.turn, out)]
        omega = np.ascontiguousarray(omega)
        steps.outputs(flat[0], sums.row, flat[1], sums.fast, omega, *tables, flat[2], rows, modal)
        return out

    def _sums(self, force: ComplexArray, omega: FloatArray) -> Sums:
        """What the modes add to each row under the modal forces (n, k): real sums, for the parts that are there."""
        shapes = np.stack([self._position, self._velocity])[:, None, :, None, :]
        forces = np.stack([force.real.T, force.imag.T])
        parts = shapes * forces[None, :, None]  # (order, part, row, k, n)
        needed = parts.any(axis=(3, 4))
        order, part, row = np.nonzero(needed)
        turn, fast = TURNS[2 * order + part], order == 1
        columns = parts[needed].transpose(1, 0, 2)
        modes, zeta, stacked = self.cascade.omega, self.cascade.zeta, columns
        if not self.flexible.all():
            modes, zeta, stacked = self._with_rigid(columns)
        values = ModalSum(stacked, modes, zeta).groups(omega) if row.size else np.zeros((0, *omega.shape), dtype=complex)
        return Sums(np.ascontiguousarray(values), row, turn, fast)

    def _with_rigid(self, columns: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The flexible modes, and all rigid-body modes as one."""
        flexible, rigid = self.flexible, columns[:, :, ~self.flexible].sum(axis=2)
        modes, zeta, stacked = self.cascade.omega[flexible], self.cascade.zeta[flexible], columns[:, :, flexible]
        if not rigid.any():
            return modes, zeta, stacked
        return np.append(modes, 0.0), np.append(zeta, 0.0), np.concatenate([stacked, rigid[:, :, None]], axis=2)

    def _rest(self, driven: ComplexArray, s: ComplexArray) -> ComplexArray:
        cascade, flat = self.cascade, driven.reshape(driven.shape[0], -1)
        if self.diagonal:
            modal = self._to_modal @ flat
            modal /= s.ravel() - self._poles[:, None]
            return np.asarray((self._out_of @ modal).reshape(-1, *s.shape))
        matrix = s.ravel()[:, None, None] * np.eye(cascade.A.shape[0]) - cascade.A
        return np.asarray((cascade.C @ np.linalg.solve(matrix, flat.T[:, :, None])[:, :, 0].T).reshape(-1, *s.shape))

    def _refuse_poles(self, omega: FloatArray) -> None:
        hit = self._undamped[np.isin(self._undamped, omega)] if self._undamped.size else self._undamped
        if hit.size:
            where, mode = hit[0] / (2 * np.pi), int(np.flatnonzero(self.cascade.omega == hit[0])[0])
            raise InputError(
                f"no steady state: a tone at {where:.6g} Hz meets the undamped mode {mode} (counted from 0); give it damping, or "
                "leave this frequency out"
            )
        size, dt = abs(self._poles).max(initial=0.0), self.cascade.dt
        for pole in self._poles[abs(self._poles.real) <= 1e-14 * size] if dt is None else self._poles:
            s = 1j * omega if dt is None else np.exp(1j * omega * dt)
            if (abs(s - pole) <= 1e-14 * size).any():
                raise InputError(
                    f"no steady state: a tone meets an undamped pole of the loop at {abs(pole.imag) / (2 * np.pi):.6g} Hz"
                )
