"""The compiled form of a `HybridRecursion`: its matrices laid out once, and the state carried from run to run."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np

from flexplant.loop.hybrid import Hybrid
from flexplant.loop.layout import Layout, aligned, block_length
from flexplant.loop.lifted import stepped
from flexplant.loop.stepping import Stepper
from flexplant.loop.tiled import MOST_REST, Rows, Tiles, modes_driven, terms
from flexplant.model.arrays import FloatArray, IntArray

TILE = 4  # samples, as in `sampled_tiles`
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


class TiledLoop:
    """As `SampledLoop`, where the blocks drive modes that not too many rows read: in tiles of four samples."""

    def __init__(self, hybrid: Hybrid, one: Stepper, rows: Rows, tables: Tables, functions: IntArray) -> None:
        linear, nw, nz = hybrid.linear, hybrid.nw, hybrid.nz
        width, n, m, block = (
            linear.B.shape[1],
            linear.omega.size,
            len(linear.A),
            int(importlib.import_module("flexplant.loop.tile_steps").BLOCK),
        )
        self._ramp, self._modal, self._functions, self._silent = one.drive[width : width + nw], 2 * n, functions, not nw
        forced, causal = one.drive[nw:width], one.drive[:nw] - self._ramp + stepped(one, self._ramp)
        shape_in = linear.shape_in[:, :nw] if nw else np.zeros((n, 1))  # the compiled steps need an input
        self._tiles = Tiles(modes_driven(one, shape_in), rows)
        D = linear.D.copy()
        D[:, :nw] += np.hstack([linear.C_modes, linear.C]) @ self._ramp.T
        reading = np.hstack([rows.placed[m:], linear.C, *self._inputs(D[:, :nw]), D[:, nw:]])
        into = np.hstack([rows.placed[:m], one.A, *self._inputs(causal[:, 2 * n :].T), forced[:, 2 * n :].T])
        first, ahead = rows.placed.shape[1], into.shape[1] - (width - nw)
        self._Z, self._scratch = aligned((into.shape[1], block + 8)), (np.zeros((TILE, width - nw)), np.zeros(m))
        self._rest, self._written = self._Z[first : first + m, 0], aligned((nz, block))
        self._other = np.ascontiguousarray(into), *self._echoes(one, forced[:, : 2 * n], rows)
        self._reading, self._asking = (terms(reading[:nz]), self._Z), np.ascontiguousarray(reading[nz:, :ahead])
        self._blocks, self.asked = (*tables, np.ascontiguousarray(linear.D[nz:, nw:])), np.zeros(len(self._asking))

    def _inputs(self, columns: FloatArray) -> list[FloatArray]:
        return [columns, np.zeros((len(columns), int(self._silent)))]

    def _echoes(self, one: Stepper, forced: FloatArray, rows: Rows) -> tuple[FloatArray, FloatArray]:
        """What outputs of the blocks add to the rows at the next three samples, and to the modes at the end of a tile."""
        free = replace(one, A=np.zeros((0, 0)), from_modes=np.zeros((0, forced.shape[1])))
        moved = [forced]
        for _ in range(TILE - 1):
            moved.append(stepped(free, moved[-1]))
        return np.stack([rows.whole @ part.T for part in moved[:-1]]), self._tiles.pushes(np.vstack(moved[::-1]))

    def run(
        self,
        state: tuple[FloatArray, ...],
        w: FloatArray,
        driven: FloatArray,  # noqa: ARG002 - no modes are stepped beforehand
        seen: FloatArray,  # noqa: ARG002
        out: FloatArray,
        at: tuple[int, int, float],
    ) -> tuple[int, int]:
        """As `SampledLoop.run`."""
        march = importlib.import_module("flexplant.loop.sampled_tiles").tiled_march
        x, p, s = state
        start = x - w[0] @ self._ramp
        self._tiles.enter(start[: self._modal])
        self._rest[:] = start[self._modal :]
        self.asked[:] = 0.0
        memory = (p, s, self.asked, np.zeros(self.asked.size), np.zeros(s.size), *self._scratch, self._written)
        inputs = np.zeros((1, len(w) - 1)) if self._silent else np.ascontiguousarray(w[:-1].T)
        fixed = (self._tiles.modes, self._other, self._reading, self._asking, self._blocks, self._functions)
        failure: tuple[int, int] = march(*fixed, inputs, memory, out, *at)
        x[:] = np.concatenate([self._tiles.leave(), self._rest]) + w[-1] @ self._ramp
        return failure


def tiled_rows(hybrid: Hybrid, one: Stepper, n_ahead: int) -> Rows | None:
    """The rows that read the modes, where the loop around them is stepped in tiles; else None."""
    linear = hybrid.linear
    if n_ahead or not linear.omega.size or len(linear.A) > MOST_REST:
        return None
    rows = Rows(np.vstack([one.from_modes, linear.C_modes]))
    return rows if rows.fit else None
