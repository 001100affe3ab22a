"""The steps of a cascade whose modes are read by a few distinct rows: what the compiled steps of `tile_steps` need."""

from __future__ import annotations

import importlib

import numpy as np

from flexplant.loop.cascade import Cascade
from flexplant.loop.layout import aligned, shared_rows
from flexplant.loop.stepping import Stepper
from flexplant.model.arrays import FloatArray

LANES = 8
MOST_ROWS = 6  # their sums at four samples fit into the registers
MOST_REST = 16  # other states, which are stepped one by one
LEAST = 1e-150  # stands for a modal force that adds nothing to eta'


class TileSteps:
    """x[k+1] = F x[k] + G w[k] and z = C x + D w. causal: G transposed; rows: the distinct ones of [from_modes; C_modes].

    Rows that are multiples of each other are summed over the modes once; the other states and the outputs are combined from them.
    """

    def __init__(self, cascade: Cascade, one: Stepper, causal: FloatArray, D: FloatArray, rows: Rows) -> None:
        n, m, nw = cascade.omega.size, cascade.A.shape[0], cascade.B.shape[1]
        self.n, self.m, self.groups, self.rows = n, m, -(-n // LANES), rows
        self._packed = self._pack(cascade, one)
        self._x = aligned((self.groups, 2, LANES))
        self._into = np.hstack([rows.weights[:m], causal[:, 2 * n :].T])
        self._weights = np.hstack([rows.weights[m:], cascade.C, D])
        block = importlib.import_module("flexplant.loop.tile_steps").BLOCK
        self._Z, self._G = aligned((rows.weights.shape[1] + m, block)), aligned((m, block))
        self._A, self._rest, self._tail = np.ascontiguousarray(one.A), np.zeros(2 * m), np.zeros((nw, LANES))
        self._last = np.zeros((D.shape[0], LANES))

    def _pack(self, cascade: Cascade, one: Stepper) -> FloatArray:
        """(groups, ., 8) what eight modes need, in the order in which it is used."""
        hold, ramp = one.forced
        n, rows, nw = self.n, self.rows, cascade.shape_in.shape[1]
        b = hold - ramp + np.einsum("nij,nj->ni", one.modes, ramp)
        through = np.where(abs(b[:, 1]) < LEAST, LEAST, b[:, 1])
        out = aligned((self.groups, 5 + nw + len(rows.still) + 2 * len(rows.both), LANES))
        each = np.zeros((out.shape[1], self.groups * LANES))
        parts = (one.modes.reshape(-1, 4).T, [b[:, 0] / through], cascade.shape_in.T * through)
        each[:, :n] = np.vstack([*parts, rows.still, rows.both[:, :n], rows.both[:, n:]])
        out[:] = each.reshape(-1, self.groups, LANES).swapaxes(0, 1)
        return out

    def advance(self, state: FloatArray, w: FloatArray, first: int, count: int, out: FloatArray, place: int) -> FloatArray:
        """The state after `count` samples of w (nw, .) from `first` on; writes the outputs into out[:, place:]."""
        n, m, x = self.n, self.m, self._x
        flat = np.zeros((2, self.groups * LANES))
        flat[:, :n] = state[: 2 * n].reshape(2, n)
        x[:] = flat.reshape(2, -1, LANES).swapaxes(0, 1)
        self._rest[:m] = state[2 * n :]
        whole = count // LANES * LANES
        self._march(w, first, out, place, whole, whole)
        if whole < count:
            left = count - whole
            self._tail[:, :left] = w[:, first + whole : first + count]
            self._march(self._tail, 0, self._last, 0, LANES, left)
            out[:, place + whole : place + count] = self._last[:, :left]
        flat = x.swapaxes(0, 1).reshape(2, -1)
        return np.concatenate([flat[0, :n], flat[1, :n], self._rest[:m]])

    def _march(self, w: FloatArray, first: int, out: FloatArray, place: int, count: int, valid: int) -> None:
        march = importlib.import_module("flexplant.loop.tile_steps").tile_march
        counts = (0,) * len(self.rows.still), (0,) * len(self.rows.both)
        packed = self._packed.reshape(self.groups, -1)
        rest = (self._A, self._into, self._rest)
        march(packed, self._x, *counts, *rest, self._weights, self._Z, self._G, w, first, out, place, count, valid)


class Rows:
    """Sums of rows on [eta, eta'] as combinations, weights (k, distinct), of distinct ones: first those that read eta alone.

    terms: each (k, 2n). still: (p, n), both: (s, 2n), of each an even number, zeros where there is no further row.
    """

    def __init__(self, *terms: FloatArray) -> None:
        rows, n = np.vstack(terms), terms[0].shape[1] // 2
        share, row, chosen = shared_rows(rows)
        distinct = rows[chosen]
        moving = distinct[:, n:].any(axis=1)
        self.still, self.both = _even(distinct[~moving][:, :n]), _even(distinct[moving])
        place = np.where(moving, len(self.still) + np.cumsum(moving) - 1, np.cumsum(~moving) - 1)
        weights = np.zeros((len(rows), len(self.still) + len(self.both)))
        read = share != 0
        weights[np.flatnonzero(read), place[row[read]]] = share[read]
        self.weights = weights.reshape(len(terms), -1, weights.shape[1]).sum(axis=0)

    @property
    def cost(self) -> int:
        """Products a mode and sample."""
        return len(self.still) + 2 * len(self.both)

    @property
    def fit(self) -> bool:
        """True where the sums stay in registers."""
        return 0 < len(self.still) + len(self.both) <= MOST_ROWS


def _even(rows: FloatArray) -> FloatArray:
    return np.vstack([rows, np.zeros((len(rows) % 2, rows.shape[1]))])
