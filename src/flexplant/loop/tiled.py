"""Modes in tiles of samples and the rows that read them: what the compiled steps of `tile_steps` need."""

from __future__ import annotations

import importlib
from dataclasses import dataclass

import numpy as np

from flexplant.loop.layout import aligned, padded, shared_rows
from flexplant.loop.stepping import Stepper
from flexplant.model.arrays import FloatArray, IntArray

LANES = 8
AT_ONCE = 6  # rows whose sums at four samples fit into the registers
MOST_ROWS = 24  # distinct rows up to which reading the modes tile by tile is the faster way
MOST_REST = 16  # other states, which are stepped one by one
FAINT = 1e-60  # stands for an effect of nothing, relative to the largest one
LEAST = 1e-150  # the unit of a mode that no input drives


@dataclass(frozen=True, eq=False)
class Drive:
    """How n modes move: [eta, eta'][k+1] = F [eta, eta'][k] + G w[k], counted in what w[0] adds to eta'.

    table: (., n) F00, F01, F10, F11, what the first input adds to eta, what the others add to eta', and, if `twofold`, to eta;
    else every input adds to eta in the ratio of the first. unit: (n,).
    """

    table: FloatArray
    unit: FloatArray
    twofold: bool


def modes_driven(one: Stepper, shape_in: FloatArray) -> Drive:
    """Modes under a modal force shape_in w: every input drives a mode by the same b."""
    hold, ramp = one.forced
    b = hold - ramp + np.einsum("nij,nj->ni", one.modes, ramp)
    through = _not_zero(b[:, 1], abs(b[:, 0]))
    first = _not_zero(shape_in[:, 0], abs(shape_in).max(axis=1))
    table = np.vstack([one.modes.reshape(-1, 4).T, b[:, 0] / through, shape_in[:, 1:].T / first])
    return Drive(table, np.where(shape_in.any(axis=1), through * first, LEAST), twofold=False)


def blocks_driven(transition: FloatArray, G: FloatArray) -> Drive:
    """Blocks of two states, transition (n, 2, 2), under any G (n, 2, nw)."""
    largest = abs(G).max(axis=(1, 2))
    unit = np.where(largest > 0, _not_zero(G[:, 1, 0], largest), LEAST)
    scaled = G / unit[:, None, None]
    table = np.vstack([transition.reshape(-1, 4).T, scaled[:, 0, 0], scaled[:, 1, 1:].T, scaled[:, 0, 1:].T])
    return Drive(table, unit, twofold=True)


def _not_zero(values: FloatArray, largest: FloatArray) -> FloatArray:
    """The values, or where they are nothing beside the largest, what is nothing beside it and can be divided by."""
    least = np.where(largest > 0, FAINT * largest, 1.0)
    return np.where(abs(values) > least, values, least)


class Tiles:
    """The compiled steps' view of modes, `modes` and `rows` (see `tile_steps`), and the state in it: enter and leave."""

    def __init__(self, drive: Drive, rows: Rows) -> None:
        self._n, self._unit, groups = drive.unit.size, drive.unit, -(-drive.unit.size // LANES)
        table = self._lanes(drive.table, groups + groups % 2)
        self._x, seen = (aligned((len(table), k, LANES)) for k in (2, 8))
        self.modes = (table, self._x, seen, (0,) * drive.twofold)
        self.rows = (self._packed(rows, groups), *((0,) * size for size in rows.at_once))

    def _lanes(self, table: FloatArray, groups: int) -> FloatArray:
        """(groups, . * 8) of a table (., n)."""
        each = padded(table, (len(table), groups * LANES))
        out = aligned((groups, len(table), LANES))
        out[:] = each.reshape(-1, groups, LANES).swapaxes(0, 1)
        return out.reshape(groups, -1)

    def _packed(self, rows: Rows, groups: int) -> FloatArray:
        """(passes, groups, .) rows as they are read."""
        n = self._n
        still, both = (part.reshape(rows.passes, -1, part.shape[1]) for part in (rows.still, rows.both))
        out = aligned((rows.passes, groups, LANES * (still.shape[1] + 2 * both.shape[1])))
        for turn in range(rows.passes):
            out[turn] = self._lanes(np.vstack([still[turn], both[turn][:, :n], both[turn][:, n:]]) * self._unit, groups)
        return out

    def pushes(self, added: FloatArray) -> FloatArray:
        """(groups, k * 16) what k impulses add to [eta, eta'], (k, 2n), in lanes."""
        each = added.reshape(len(added) * 2, self._n) / self._unit
        return self._lanes(each, len(self._x))

    def enter(self, state: FloatArray) -> None:
        """Take [eta, eta'] (2n,)."""
        flat = np.zeros((2, len(self._x) * LANES))
        flat[:, : self._n] = state.reshape(2, self._n) / self._unit
        self._x[:] = flat.reshape(2, -1, LANES).swapaxes(0, 1)

    def leave(self) -> FloatArray:
        """(2n,) [eta, eta']."""
        flat: FloatArray = self._x.swapaxes(0, 1).reshape(2, -1)[:, : self._n] * self._unit
        return flat.ravel()


class TileSteps:
    """[eta, eta'][k+1] = F [eta, eta'][k] + G w[k];  l[k+1] = A l + P [eta, eta'] + into w;  z = Cm [eta, eta'] + C l + D w.

    rows: those of P and of Cm. Rows that are multiples of each other are summed over the modes once; the other states l and the
    outputs are combined from them.
    """

    def __init__(
        self, drive: Drive, rows: Rows, rest: tuple[FloatArray, FloatArray], reading: tuple[FloatArray, FloatArray]
    ) -> None:
        """rest: A (m, m) and into (m, nw). reading: C (nz, m) and D (nz, nw)."""
        (A, into), (C, D), weights = rest, reading, rows.placed
        self._tiles, self._modal, m = Tiles(drive, rows), 2 * drive.unit.size, len(A)
        block = int(importlib.import_module("flexplant.loop.tile_steps").BLOCK)
        Z = aligned((weights.shape[1] + m, block + LANES))
        self._rest, heard = Z[weights.shape[1] :, 0], weights[:m]
        self._other = _rest_layout(A, np.hstack([heard, into]) if heard.any() else into, block)
        self._reading = np.hstack([weights[m:], C, D]), Z
        self._tail, self._last = np.zeros((into.shape[1], LANES)), np.zeros((len(D), LANES))

    def advance(self, state: FloatArray, w: FloatArray, first: int, count: int, out: FloatArray, place: int) -> FloatArray:
        """The state after `count` samples of w (nw, .) from `first` on; writes the outputs into out[:, place:]."""
        self._tiles.enter(state[: self._modal])
        self._rest[:] = state[self._modal :]
        whole = count // LANES * LANES
        self._march(w, first, out, place, whole, whole)
        if whole < count:
            left = count - whole
            self._tail[:, :left] = w[:, first + whole : first + count]
            self._march(self._tail, 0, self._last, 0, LANES, left)
            out[:, place + whole : place + count] = self._last[:, :left]
        return np.concatenate([self._tiles.leave(), self._rest])

    def _march(self, w: FloatArray, first: int, out: FloatArray, place: int, count: int, valid: int) -> None:
        march = importlib.import_module("flexplant.loop.tile_steps").tile_march
        march(self._tiles.modes, self._tiles.rows, self._other, self._reading, w, first, out, place, count, valid)


def _rest_layout(A: FloatArray, into: FloatArray, block: int) -> tuple[FloatArray, ...]:
    """into; A, A^2 and A^4; A^1 to A^8 as lanes; scratch."""
    powers = [A]
    for _ in range(LANES - 1):
        powers.append(A @ powers[-1])
    free, doubled = np.ascontiguousarray(np.stack(powers, axis=-1)), np.stack([powers[k] for k in (0, 1, 3)])
    scratch = aligned((2, len(A), block))
    return np.ascontiguousarray(into), doubled, free, scratch[0], scratch[1]


class Rows:
    """Sums of rows on [eta, eta'] as combinations, weights (k, distinct), of distinct ones: first those that read eta alone.

    terms: each (k, 2n). still: (p, n), both: (s, 2n), of each an even number for each pass over the modes, zeros where there is
    no further row. at_once: rows of either kind in a pass. placed: the weights on the rows as the passes sum them, one after the
    other: still ones, then the others of the same pass.
    """

    def __init__(self, *terms: FloatArray) -> None:
        rows, n = np.vstack(terms), terms[0].shape[1] // 2
        share, row, chosen = shared_rows(rows)
        distinct = rows[chosen]
        moving = distinct[:, n:].any(axis=1)
        still, both = distinct[~moving][:, :n], distinct[moving]
        self.passes = next(k for k in range(1, len(distinct) + 2) if _even(len(still), k) + _even(len(both), k) <= AT_ONCE)
        self.at_once = _even(len(still), self.passes), _even(len(both), self.passes)
        self.still, self.both = (
            np.vstack([part, np.zeros((size * self.passes - len(part), part.shape[1]))])
            for part, size in zip((still, both), self.at_once, strict=True)
        )
        place = np.where(moving, self._places(1)[np.cumsum(moving) - 1], self._places(0)[np.cumsum(~moving) - 1])
        weights = np.zeros((len(rows), self.passes * sum(self.at_once)))
        read = share != 0
        weights[np.flatnonzero(read), place[row[read]]] = share[read]
        self.placed = weights.reshape(len(terms), -1, weights.shape[1]).sum(axis=0)

    def _places(self, kind: int) -> IntArray:
        """Where the sums of the rows of one kind stand; a last place for no row."""
        size, width = self.at_once[kind], sum(self.at_once)
        places = [turn * width + kind * self.at_once[0] + k for turn in range(self.passes) for k in range(size)]
        return np.array([*places, 0], dtype=np.int64)

    @property
    def whole(self) -> FloatArray:
        """(distinct, 2n) the rows as the passes sum them."""
        n, parts = self.both.shape[1] // 2, (self.still, self.both)
        still, both = (part.reshape(self.passes, -1, part.shape[1]) for part in parts)
        still = np.concatenate([still, np.zeros((*still.shape[:2], n))], axis=2)
        return np.concatenate([still, both], axis=1).reshape(-1, 2 * n)

    @property
    def cost(self) -> int:
        """Products a mode and sample."""
        return len(self.still) + 2 * len(self.both)

    @property
    def fit(self) -> bool:
        """True where reading them tile by tile is the faster way."""
        return 0 < len(self.still) + len(self.both) <= MOST_ROWS


def _even(rows: int, passes: int) -> int:
    """Rows in each of the passes: an even number."""
    each = -(-rows // passes)
    return each + each % 2
