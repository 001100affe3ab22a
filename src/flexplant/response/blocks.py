"""Which blocks of frequencies a sum over modes takes: those of least work, near modes one by one, the others by their series."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from flexplant.model.arrays import FloatArray, IntArray
from flexplant.numerics.compiled import Kernel
from flexplant.response.tiles import ROWS, STRIP

RHO = 10 ** (15 / STRIP)
REACH = 0.5 * (RHO + 1 / RHO)  # half the width of the ellipse of size RHO, where the block is two wide
TABLE = 2.5  # work of a receptance, beside that of adding it to ROWS rows


def work_blocks(w: FloatArray, poles: FloatArray, tiles: int) -> IntArray:
    """(nb, 6) blocks of ascending w (groups, nf >= STRIP) that cost least, with poles ascending.

    Columns: start and stop in w as one list, first and last near mode, first and last row of the group, ROWS x tiles a group.
    Blocks are halved as long as that saves work (counted in modes added to ROWS rows at STRIP frequencies); one whose modes are
    all near is summed plainly.
    """
    halvings = _halvings(w.shape[1])
    blocks = np.empty((w.shape[0] * ((halvings[0].size + 1) // 2), 6), dtype=np.int64)
    return blocks[: _chosen(np.ascontiguousarray(w), poles, float(tiles), *halvings, blocks)]


@lru_cache(maxsize=64)
def _halvings(count: int) -> tuple[IntArray, IntArray, IntArray]:
    """Start, stop and size in strips of the blocks of `count` frequencies: all, its halves, their halves, ... (heap order)."""
    strips = -(-count // STRIP)
    edges = [(strips * np.arange(2**level + 1)) >> level for level in range(strips.bit_length())]
    first, last = (np.concatenate([e[part] for e in edges]) for part in (slice(None, -1), slice(1, None)))
    return np.minimum(first * STRIP, count - STRIP), np.minimum(last * STRIP, count), last - first


def _choose_loops(w, poles, tiles, start, stop, size, blocks):  # type: ignore[no-untyped-def]
    """Writes `work_blocks` of each group in turn and returns how many; node k is the union of 2 k + 1 and 2 k + 2."""
    n, row, count, nodes, found = poles.size, tiles + TABLE, w.shape[1], start.size, 0
    best, near, divided = np.empty(nodes), np.empty((nodes, 2), np.int64), np.empty(nodes, np.bool_)
    for g in range(w.shape[0]):
        for k in range(nodes - 1, -1, -1):
            low, high, plain = w[g, start[k]], w[g, stop[k] - 1], size[k] * n * row
            margin = 0.5 * (REACH - 1) * (high - low)
            for side in range(2):  # the first pole from low - margin on, and the first beyond high + margin
                first, last = 0, n
                while first < last:
                    middle = (first + last) // 2
                    below = poles[middle] <= high + margin if side else poles[middle] < low - margin
                    first, last = (middle + 1, last) if below else (first, middle)
                near[k, side] = first
            smooth = size[k] * ((near[k, 1] - near[k, 0]) * row + STRIP * (tiles + 1)) + n * row + STRIP * tiles
            if plain <= smooth or high <= low:
                near[k, 0], near[k, 1], smooth = 0, n, plain
            inner = 2 * k + 2 < nodes
            divided[k] = inner and best[2 * k + 1] + best[2 * k + 2] < smooth
            best[k] = best[2 * k + 1] + best[2 * k + 2] if divided[k] else smooth
        k = 0
        while k >= 0:  # all nodes that are not divided, from left to right
            if divided[k]:
                k = 2 * k + 1
                continue
            blocks[found, 0], blocks[found, 1] = g * count + start[k], g * count + stop[k]
            blocks[found, 2], blocks[found, 3] = near[k, 0], near[k, 1]
            blocks[found, 4], blocks[found, 5] = g * tiles * ROWS, (g + 1) * tiles * ROWS
            found += 1
            while k and k % 2 == 0:
                k = (k - 1) // 2
            k = k + 1 if k else -1
    return found


def _choose_numpy(
    w: FloatArray, poles: FloatArray, tiles: float, start: IntArray, stop: IntArray, size: IntArray, blocks: IntArray
) -> int:
    """The same for all groups at once, level by level."""
    n, row = poles.size, tiles + TABLE
    low, high = w[:, start], w[:, stop - 1]
    margin = 0.5 * (REACH - 1) * (high - low)
    first, last = np.searchsorted(poles, low - margin), np.searchsorted(poles, high + margin, side="right")
    interpolated = size * ((last - first) * row + STRIP * (tiles + 1)) + n * row + STRIP * tiles
    plainly = (size * n * row <= interpolated) | (high <= low)
    group, node = _cheapest(np.where(plainly, size * n * row, interpolated))
    all_near = plainly[group, node]
    near = (np.where(all_near, 0, first[group, node]), np.where(all_near, n, last[group, node]))
    at, rows = group * w.shape[1], group * tiles * ROWS
    blocks[: group.size] = np.stack([at + start[node], at + stop[node], *near, rows, rows + tiles * ROWS], axis=1)
    return int(group.size)


_chosen = Kernel(_choose_loops, _choose_numpy)


def _cheapest(cost: FloatArray) -> tuple[IntArray, IntArray]:
    """(group, node) of the blocks of least cost; node k (heap order) is the union of 2 k + 1 and 2 k + 2."""
    best, chosen = cost.copy(), np.zeros(cost.shape, dtype=bool)
    levels = [slice(2**k - 1, 2 ** (k + 1) - 1) for k in range((cost.shape[1] + 1).bit_length() - 1)]
    for level, below in zip(levels[-2::-1], levels[:0:-1], strict=True):
        np.minimum(cost[:, level], best[:, below][:, ::2] + best[:, below][:, 1::2], out=best[:, level])
    reached = np.ones((cost.shape[0], 1), dtype=bool)
    for level in levels:
        whole = best[:, level] == cost[:, level]
        chosen[:, level] = reached & whole
        reached = np.repeat(reached & ~whole, 2, axis=1)
    group, node = np.nonzero(chosen)
    return group, node
