"""The compiled form of a `HybridRecursion`: its matrices laid out once, and the state carried from run to run."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np

from flexplant.loop.hybrid import Hybrid
from flexplant.loop.layout import Layout, aligned, block_length
from flexplant.loop.lifted import stepped
from flexplant.loop.stepping import Stepper
from flexplant.model.arrays import FloatArray, IntArray

Tables = tuple[IntArray, FloatArray, FloatArray]


class SampledLoop:
    """Advances the linear states x that are in the loop, the outputs p and the states s of the sampled blocks.

    asked: (nq,) the blocks' inputs of the last sample.
    Under a first-order hold of w the states are shifted by what the ramp adds, as in `FusedRecursion`; p is held.
    """

    def __init__(self, hybrid: Hybrid, one: Stepper, n_ahead: int, tables: Tables, functions: IntArray) -> None:
        linear, nw, nz = hybrid.linear, hybrid.nw, hybrid.nz
        width = linear.B.shape[1]
        held, ramp = one.drive[:width, n_ahead:], one.drive[width:, n_ahead:].copy()
        ramp[nw:] = 0.0
        if n_ahead:
            none = np.zeros(0)
            linear = replace(
                linear, omega=none, zeta=none, shape_in=none.reshape(0, width), C_modes=np.zeros((len(linear.C_modes), 0))
            )
            one = replace(one, modes=one.modes[:0], from_modes=one.from_modes[:, :0], forced=one.forced[:, :0])
        layout, self._nw, self._ramp = Layout(linear), nw, ramp[:nw]
        self._n, self._m, self._padded = layout.n, layout.m, layout.modes
        self._modal = layout.modal(one, linear.shape_in)
        self._other = layout.other(one, (held - ramp + stepped(one, ramp)).T)
        rows = np.hstack([linear.C_modes, linear.C])
        D = linear.D + rows @ ramp.T
        self._reading = layout.reading(linear.C_modes[:nz], linear.C[:nz], D[:nz])
        D[nz:, nw:] = 0.0
        self._asking = layout.rows(linear.C_modes[nz:], linear.C[nz:], D[nz:])
        self._blocks = (*tables, np.ascontiguousarray(linear.D[nz:, nw:]))
        self._functions, self.asked = functions, np.zeros(len(linear.C) - nz)
        self._work = aligned((block_length() + 1, layout.width))

    def run(
        self,
        state: tuple[FloatArray, ...],
        w: FloatArray,
        driven: FloatArray,
        seen: FloatArray,
        out: FloatArray,
        at: tuple[int, int, float],
    ) -> tuple[int, int]:
        """Advance under w (nt + 1, nw), state = (x, p, s) in place; at: first sample, every, dt. (sample, block) of a failure."""
        march = importlib.import_module("flexplant.loop.sampled_lanes").sampled_march
        x, p, s = state
        n, padded, first = self._n, self._padded, self._work[0]
        start = x - w[0] @ self._ramp
        first[:n], first[padded : padded + n], first[len(first) - self._other[3].size :][: self._m] = np.split(start, [n, 2 * n])
        nq = self._blocks[3].shape[0]
        self.asked = np.zeros(nq)
        memory = (p, s, self.asked, np.zeros(nq), np.zeros(s.size))
        fixed = (self._modal, self._other, self._reading, self._asking, self._blocks, self._functions)
        inputs = np.ascontiguousarray(w[:-1])
        failure: tuple[int, int] = march(*fixed, inputs, driven, seen, self._work, memory, out, *at)
        parts = (first[:n], first[padded : padded + n], first[len(first) - self._other[3].size :][: self._m])
        x[:] = np.concatenate(parts) + w[-1] @ self._ramp
        return failure
