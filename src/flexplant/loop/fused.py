"""The recursion of a cascade in one compiled pass over short blocks of samples: the fast form, where numba is installed."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import cache

import numpy as np

from flexplant.loop.cascade import Cascade
from flexplant.loop.layout import Layout, aligned, block_length
from flexplant.loop.lifted import stepped
from flexplant.loop.recursion import Recursion
from flexplant.loop.stepping import stepper
from flexplant.model.arrays import FloatArray
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
        layout = Layout(cascade)
        self._modal = layout.modal(one, cascade.shape_in)
        self._other = layout.other(one, (one.drive[:nw] - self._ramp + stepped(one, self._ramp)).T)
        rows = np.hstack([cascade.C_modes, cascade.C])
        self._reading = layout.reading(cascade.C_modes, cascade.C, cascade.D + rows @ self._ramp.T)
        self._work = aligned((block_length(), layout.width))

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
        inputs = np.ascontiguousarray(w[:nt].T)
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


def recursion_of(cascade: Cascade, dt: float, state: FloatArray, hold: str, every: int = 1) -> FusedRecursion | Recursion:
    """The fused recursion where it is the faster one, else the lifted one."""
    return (FusedRecursion if is_fused(cascade) else Recursion)(cascade, dt, state, hold, every)
