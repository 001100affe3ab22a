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
SUMMED = 4  # such rows where the modes move as well
MOST_ROWS = 24  # distinct rows up to which reading the modes tile by tile is the faster way
MOST_REST = 16  # other states, which are stepped one by one
FAINT = 1e-30  # stands for an effect of nothing, relative to the largest one
LEAST = 1e-150  # the unit of a mode that no input drives


@dataclass(frozen=True, eq=False)
class Drive:
    """How n modes move: [eta, eta'][k+1] = F [eta, eta'][k] + G w[k], counted in what w[0] adds; see `tile_steps.tile_march`.

    table: (., n) F00, F01 or what the first input adds to eta, F10, F11, what the others add to eta', and, if `twofold`, to eta;
    else every input adds to eta in the ratio of the first. unit: (2, n) of eta and eta'.
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
    rate = np.where(shape_in.any(axis=1), through * first, LEAST)
    F = one.modes
    way = _not_zero(F[:, 0, 1], np.ones(len(F)))
    moved = [F[:, 0, 0], b[:, 0] / through / way, F[:, 1, 0] * way, F[:, 1, 1]]
    return Drive(np.vstack([*moved, shape_in[:, 1:].T / first]), np.stack([way * rate, rate]), twofold=False)


def blocks_driven(transition: FloatArray, G: FloatArray) -> Drive:
    """Blocks of two states, transition (n, 2, 2), under any G (n, 2, nw)."""
    largest = abs(G).max(axis=(1, 2))
    eta, rate = unit = np.stack([np.where(largest > 0, _not_zero(G[:, k, 0], largest), LEAST) for k in (0, 1)])
    moved = [transition[:, 0, 0], transition[:, 0, 1] * (rate / eta), transition[:, 1, 0] * (eta / rate), transition[:, 1, 1]]
    return Drive(np.vstack([*moved, G[:, 1, 1:].T / rate, G[:, 0, 1:].T / eta]), unit, twofold=True)


def _not_zero(values: FloatArray, largest: FloatArray) -> FloatArray:
    """The values, or where they are nothing beside the largest, what is nothing beside it and can be divided by."""
    least = np.where(largest > 0, FAINT * largest, 1.0)
    return np.where(abs(values) > least, values, least)


class Tiles:
    """The compiled steps' view of modes and rows, `modes` (see `tile_steps`), and the state in it: enter and leave."""

    def __init__(self, drive: Drive, rows: Rows) -> None:
        self._unit, (_, self._n) = drive.unit, drive.unit.shape
        self._groups, mixed = -(-self._n // LANES), rows.ratio is not None
        sizes, none = tuple((0,) * size for size in rows.at_once), ((), ())
        summed = sum(rows.at_once) <= SUMMED and rows.passes == 1 and not drive.twofold
        ratio = [] if rows.ratio is None else [rows.ratio * drive.unit[1] / drive.unit[0]]
        state, seen = np.zeros((2, self._n)), np.zeros((0 if summed else 8 if rows.at_once[1] else 4, self._n))
        self._table = self._lanes(np.vstack([state, drive.table, *ratio, seen, *self._in_passes(rows)]))
        kinds = (0,) * drive.twofold, (0,) * mixed, *((sizes, none) if summed else (none, sizes))
        self.modes = self._table, kinds, rows.passes, aligned((self._groups, 2 * LANES))
        self._state = self._table[:, : 2 * LANES].reshape(self._groups, 2, LANES)

    def _lanes(self, table: FloatArray) -> FloatArray:
        """(groups, . * 8) of a table (., n)."""
        each = padded(table, (len(table), self._groups * LANES))
        out = aligned((self._groups, len(table), LANES))
        out[:] = each.reshape(-1, self._groups, LANES).swapaxes(0, 1)
        return out.reshape(self._groups, -1)

    def _in_passes(self, rows: Rows) -> list[FloatArray]:
        """Rows as they are read, (., n) each: those of the first pass, of the next, ..."""
        kinds = [rows.still, *np.split(rows.both, rows.both.shape[1] // self._n, axis=1)]
        scaled = [kind * unit for kind, unit in zip(kinds, self._unit[[0, 0, 1]], strict=False)]
        return [part for turn in range(rows.passes) for part in (np.split(kind, rows.passes)[turn] for kind in scaled)]

    def pushes(self, added: FloatArray) -> FloatArray:
        """(groups, k * 16) what k impulses add to [eta, eta'], (k, 2n), in lanes."""
        return self._lanes((added.reshape(-1, 2, self._n) / self._unit).reshape(-1, self._n))

    def enter(self, state: FloatArray) -> None:
        """Take [eta, eta'] (2n,)."""
        flat = np.zeros((2, self._groups * LANES))
        flat[:, : self._n] = state.reshape(2, self._n) / self._unit
        self._state[:] = flat.reshape(2, -1, LANES).swapaxes(0, 1)

    def leave(self) -> FloatArray:
        """(2n,) [eta, eta']."""
        flat: FloatArray = self._state.swapaxes(0, 1).reshape(2, -1)[:, : self._n] * self._unit
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
        self._tiles, self._modal, m = Tiles(drive, rows), drive.unit.size, len(A)
        block = int(importlib.import_module("flexplant.loop.tile_steps").BLOCK)
        self._Z = aligned((weights.shape[1] + m + into.shape[1], block + LANES))
        self._rest = self._Z[weights.shape[1] : weights.shape[1] + m, 0]
        self._other = terms(np.hstack([weights[:m], np.zeros((m, m)), into])), *_rest_layout(A, block)
        self._reading = terms(np.hstack([weights[m:], C, D]))
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
        march(self._tiles.modes, self._other, self._reading, self._Z, w, first, out, place, count, valid)


def _rest_layout(A: FloatArray, block: int) -> tuple[FloatArray | IntArray, ...]:
    """A, A^2 and A^4; A^1 to A^8 as lanes; where any of them is not zero; scratch. See `tile_steps`."""
    powers = [A]
    for _ in range(LANES - 1):
        powers.append(A @ powers[-1])
    free, doubled = np.ascontiguousarray(np.stack(powers, axis=-1)), np.stack([powers[k] for k in (0, 1, 3)])
    scratch = aligned((2, len(A), block))
    coupled: IntArray = (free != 0).any(axis=2).astype(np.int64)
    return doubled, free, coupled, scratch[0], scratch[1]


def terms(weights: FloatArray) -> tuple[FloatArray | IntArray, ...]:
    """The weights that are not zero, row after row, their columns, and where each row starts and the last one ends."""
    rows, places = (np.ascontiguousarray(part) for part in np.nonzero(weights))
    return weights[rows, places], places, np.searchsorted(rows, np.arange(len(weights) + 1))


class Rows:
    """Sums of rows on [eta, eta'] as combinations, weights (k, distinct), of distinct ones: first those that read eta alone.

    terms: each (k, 2n). still: (p, n), both: (s, 2n), of each an even number for each pass over the modes, zeros where there is
    no further row. ratio: (n,) where all of the latter read eta + ratio eta' of a mode, both then being their weights (s, n) of
    that; else None. at_once: rows of either kind in a pass. placed: the weights on the rows as the passes sum them, one after
    the other: still ones, then the others of the same pass.
    """

    def __init__(self, *terms: FloatArray) -> None:
        rows, n = np.vstack(terms), terms[0].shape[1] // 2
        share, row, chosen = shared_rows(rows)
        distinct = rows[chosen]
        moving = distinct[:, n:].any(axis=1)
        still, (both, self.ratio) = distinct[~moving][:, :n], _mixed(distinct[moving])
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
        self.placed = weights.reshape(len(terms), len(terms[0]), weights.shape[1]).sum(axis=0)

    def _places(self, kind: int) -> IntArray:
        """Where the sums of the rows of one kind stand; a last place for no row."""
        size, width = self.at_once[kind], sum(self.at_once)
        places = [turn * width + kind * self.at_once[0] + k for turn in range(self.passes) for k in range(size)]
        return np.array([*places, 0], dtype=np.int64)

    @property
    def whole(self) -> FloatArray:
        """(distinct, 2n) the rows as the passes sum them."""
        both = self.both if self.ratio is None else np.hstack([self.both, self.both * self.ratio])
        still = np.hstack([self.still, np.zeros_like(self.still)])
        each = [part.reshape(self.passes, -1, part.shape[1]) for part in (still, both) if part.size]
        return np.concatenate(each, axis=1).reshape(-1, each[0].shape[2])

    @property
    def cost(self) -> int:
        """Products a mode and sample."""
        return len(self.still) + (2 * len(self.both) if self.ratio is None else len(self.both) + 1)

    @property
    def fit(self) -> bool:
        """True where reading them tile by tile is the faster way."""
        return 0 < len(self.still) + len(self.both) <= MOST_ROWS


def _mixed(rows: FloatArray) -> tuple[FloatArray, FloatArray | None]:
    """Weights (s, n) and ratio (n,) of rows (s, 2n) that all are weight [1, ratio] in a mode, to the last digits; or the rows.

    A mode of which they read eta' alone has a ratio beside which eta is nothing.
    """
    n = rows.shape[1] // 2
    eta, rate = rows[:, :n], rows[:, n:]
    if not len(rows):
        return rows, None
    lead = np.where(rate.any(axis=0), abs(rate).argmax(axis=0), abs(eta).argmax(axis=0)), np.arange(n)
    alone = abs(eta[lead]) <= FAINT * abs(rate[lead])
    ratio = np.where(alone, np.sign(rate[lead]) / FAINT, rate[lead] / np.where(alone, 1.0, eta[lead]))
    weights = np.where(alone, FAINT * np.sign(rate[lead]) * rate, eta)
    shared = abs(weights * ratio - rate) <= 8 * np.finfo(float).eps * abs(rate)
    return (weights, ratio) if (shared & (~alone | (abs(eta) <= FAINT * abs(rate)))).all() else (rows, None)


def _even(rows: int, passes: int) -> int:
    """Rows in each of the passes: an even number."""
    each = -(-rows // passes)
    return each + each % 2
