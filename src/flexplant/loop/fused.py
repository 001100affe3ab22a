"""The recursion of a cascade in one compiled pass over short blocks of samples: the fast form, where numba is installed."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import cache

import numpy as np

from flexplant.loop.cascade import Cascade
from flexplant.loop.lifted import stepped
from flexplant.loop.recursion import Recursion
from flexplant.loop.stepping import Stepper, stepper
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.numerics.compiled import numba

CHUNK = 4096  # samples taken at once
LARGEST_REST = 64  # other states up to which stepping them one sample at a time is the faster way


@cache
def march_kernel() -> Callable[..., None] | None:
    """The compiled steps, or None where numba is not installed."""
    return None if numba() is None else importlib.import_module("flexplant.loop.modal_steps").march


def is_fused(cascade: Cascade) -> bool:
    """True for a cascade that this form steps faster than the lifted one."""
    return march_kernel() is not None and cascade.A.shape[0] <= LARGEST_REST


class FusedRecursion:
    """x[k+1] = F x[k] + G w[k] of a cascade, resumable; equal to the lifted `Recursion` to round-off.

    With a first-order hold the state is shifted by what the ramp adds, x - R w, which makes the recursion causal: each sample
    then needs its own inputs only. Every sum has a fixed order: the result does not depend on the number of threads.
    """

    def __init__(self, cascade: Cascade, dt: float, state: FloatArray, hold: str, every: int = 1) -> None:
        self.cascade, self.every, self.position = cascade, every, 0
        self.order = np.r_[cascade.modal_states, cascade.other_states]
        self.state = state[self.order].copy()
        one, nw = stepper(cascade, dt, hold), cascade.B.shape[1]
        self._ramp = one.drive[nw:]
        self._sizes = _Sizes(cascade)
        self._modal = self._sizes.modal(one, cascade.shape_in)
        self._other = self._sizes.other(one, (one.drive[:nw] - self._ramp + stepped(one, self._ramp)).T)
        rows = np.hstack([cascade.C_modes, cascade.C])
        self._reading = self._sizes.reading(cascade, cascade.D + rows @ self._ramp.T)
        self._work = aligned((_block(), self._sizes.width))

    @property
    def chunk(self) -> int:
        """Samples that `run` takes at once at most; a multiple of `every`."""
        return max(1, CHUNK // self.every) * self.every

    def run(self, w: FloatArray, nt: int) -> FloatArray:
        """(kept, nz) outputs at the kept samples of nt; the state moves on by nt. w: (nt + 1, nw)."""
        march, every, n, m = march_kernel(), self.every, self.cascade.omega.size, self.cascade.A.shape[0]
        assert march is not None
        x, rest = self._modal[2], self._other[3]
        start = self.state - w[0] @ self._ramp
        x[0, :n], x[1, :n], rest[:m] = start[:n], start[n : 2 * n], start[2 * n :]
        out = np.empty((len(range(-self.position % every, nt, every)), self.cascade.D.shape[0]))
        inputs = np.ascontiguousarray(w[:nt])
        march(self._modal, self._other, self._reading, inputs, self._work, out, self.position, every, nt)
        self.position += nt
        self.state = np.r_[x[0, :n], x[1, :n], rest[:m]] + w[nt] @ self._ramp
        return out

    def last(self, w: FloatArray) -> FloatArray:
        """(nz,) outputs at the sample that the state stands at, for the inputs w (nw,)."""
        rows = np.hstack([self.cascade.C_modes, self.cascade.C])
        return np.asarray(rows @ self.state + self.cascade.D @ w)

    @property
    def whole_state(self) -> FloatArray:
        """(N,) the state in the order of `close` or `state_space`."""
        out = np.empty(self.state.size)
        out[self.order] = self.state
        return out


def _block() -> int:
    return int(importlib.import_module("flexplant.loop.modal_steps").BLOCK)


def aligned(shape: tuple[int, ...]) -> FloatArray:
    """Zeros that begin on a cache line: vectors that straddle two lines take twice as long."""
    size = int(np.prod(shape))
    raw = np.zeros(size + 8)
    first = (-raw.ctypes.data % 64) // 8
    return raw[first : first + size].reshape(shape)


def padded(matrix: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """The matrix with zeros behind its rows and columns."""
    out = aligned(shape)
    out[tuple(slice(size) for size in matrix.shape)] = matrix
    return out


def _up(size: int, unit: int) -> int:
    return -(-size // unit) * unit


class _Sizes:
    """How a cascade's matrices are laid out for the kernel: [eta | eta' | inputs | other states], each padded to whole lanes."""

    def __init__(self, cascade: Cascade) -> None:
        self.n, self.m, (self.nz, self.nw) = cascade.omega.size, cascade.A.shape[0], cascade.D.shape
        self.modes, self.inputs, self.rest = _up(self.n, 16), _up(self.nw, 8), _up(self.m, 8)
        self.width = 2 * self.modes + self.inputs + self.rest

    def _spread(self, rows: FloatArray) -> FloatArray:
        """(k, 2n) rows on [eta, eta'] -> an even number of rows on the padded modes."""
        out = aligned((_up(len(rows), 2), 2 * self.modes))
        out[: len(rows), : self.n], out[: len(rows), self.modes : self.modes + self.n] = rows[:, : self.n], rows[:, self.n :]
        return out

    def modal(self, one: Stepper, shape_in: FloatArray) -> tuple[FloatArray, ...]:
        """F and b of each mode, b = hold - ramp + F ramp; the modal forces of unit inputs; the state."""
        hold, ramp = one.forced
        b = hold - ramp + np.einsum("nij,nj->ni", one.modes, ramp)
        modes = np.vstack([one.modes.reshape(-1, 4).T, b.T])
        return padded(modes, (6, self.modes)), padded(shape_in.T, (self.nw, self.modes)), aligned((2, self.modes))

    def other(self, one: Stepper, causal: FloatArray) -> tuple[FloatArray, ...]:
        """A transposed, what the modes and the inputs add to the other states, scratch, the other states."""
        into = aligned((_up(self.m, 2), self.width - self.rest))
        into[:, : 2 * self.modes] = self._spread(one.from_modes)
        into[: self.m, 2 * self.modes : 2 * self.modes + self.nw] = causal[2 * self.n :]
        scratch = aligned((_block() + 3, self.rest))
        return padded(one.A.T, (self.m, self.rest)), into, scratch, aligned((self.rest,))

    def reading(self, cascade: Cascade, D: FloatArray) -> tuple[FloatArray | IntArray, ...]:
        """The distinct rows on the modes, all rows on [inputs | other states], scratch, and how outputs share distinct rows."""
        share, row, chosen = shared_rows(cascade.C_modes)
        on_modes = self._spread(cascade.C_modes[chosen])
        if not on_modes[:, self.modes :].any():
            on_modes = padded(on_modes[:, : self.modes], (len(on_modes), self.modes))
        tail = aligned((_up(self.nz, 2), self.inputs + self.rest))
        tail[: self.nz, : self.nw], tail[: self.nz, self.inputs : self.inputs + self.m] = D, cascade.C
        seen, direct = (aligned((_block() + 3, max(2, len(rows)))) for rows in (on_modes, tail))
        return on_modes, seen, tail, direct, share, row


def shared_rows(rows: FloatArray) -> tuple[FloatArray, IntArray, list[int]]:
    """share (k,), row (k,), chosen: rows[i] = share[i] rows[chosen[row[i]]] to the last digits; zero rows have share 0."""
    share, row, chosen = np.zeros(len(rows)), np.zeros(len(rows), dtype=np.int64), list[int]()
    for i, line in enumerate(rows):
        if not line.any():
            continue
        peak = int(np.argmax(abs(line)))
        for place, j in enumerate(chosen):
            factor = line[peak] / rows[j, peak] if rows[j, peak] else 0.0
            if abs(line - factor * rows[j]).max() <= 4 * np.finfo(float).eps * abs(line[peak]):
                share[i], row[i] = factor, place
                break
        else:
            share[i], row[i] = 1.0, len(chosen)
            chosen.append(i)
    return share, row, chosen


def recursion_of(cascade: Cascade, dt: float, state: FloatArray, hold: str, every: int = 1) -> FusedRecursion | Recursion:
    """The fused recursion where it is the faster one, else the lifted one."""
    return (FusedRecursion if is_fused(cascade) else Recursion)(cascade, dt, state, hold, every)
