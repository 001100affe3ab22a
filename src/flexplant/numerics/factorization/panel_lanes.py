"""Solutions with a supernodal factor, sixteen columns side by side in vector registers.

The factor is read once each way for all columns: with few of them memory takes the time, with many arithmetic. Imported only
where numba is installed. See `multifrontal.Panels` for how the factor is stored. The last strip of a triangle may reach into
the rows of the next supernode; it holds ones on the diagonal there and zeros else, so that they stay as they are.
"""

from __future__ import annotations

import numpy as np

from flexplant.numerics.compiled import compiled, inlined
from flexplant.numerics.lane_math import filled
from flexplant.numerics.lanes import WIDTH, add, load, spread, store, times, total, zero
from flexplant.numerics.strip_lanes import (
    ahead,
    blank,
    corner_down,
    corner_up,
    gathered,
    inner,
    outer,
    put,
    scattered,
    taken,
    totals,
)

STRIP = 8  # rows of the factor at a time
PAIR = 2 * WIDTH
SOON = 32 * STRIP  # values ahead that are asked for: memory answers late


@inlined
def strip_down(values, p, row, x, low, wide, shift, m):
    """Eight rows of L^-1 x, those above being solved."""
    sums = taken(x, low + row * wide + shift, wide, m)
    for j in range(row):
        ahead(values, p + STRIP * j + SOON)
        sums = outer(values, p + STRIP * j, 1, x, low + j * wide + shift, sums)
    put(x, low + row * wide + shift, wide, corner_down(values, p + STRIP * row, sums))


@inlined
def strip_up(values, p, row, x, low, wide, shift, m):
    """Eight rows of L^-T x, those below being solved, and what they take from the rows above."""
    held = corner_up(values, p + STRIP * row, taken(x, low + row * wide + shift, wide, m))
    put(x, low + row * wide + shift, wide, held)
    for j in range(row):
        ahead(values, p + STRIP * j + SOON)
        inner(values, p + STRIP * j, 1, x, low + j * wide + shift, held)


@inlined
def below_down(values, p, columns, x, low, rows, k, wide, shift, m):
    """What a supernode's solution takes from eight rows below it."""
    sums = blank(m)
    for j in range(columns):
        ahead(values, p + STRIP * j + SOON)
        sums = outer(values, p + STRIP * j, 1, x, low + j * wide + shift, sums)
    scattered(x, rows, k, wide, shift, sums)


@inlined
def below_up(values, p, columns, x, low, rows, k, wide, shift, m):
    """What eight rows below take from a supernode's right side."""
    held = gathered(x, rows, k, wide, shift, m)
    for j in range(columns):
        ahead(values, p + STRIP * j + SOON)
        inner(values, p + STRIP * j, 1, x, low + j * wide + shift, held)


@compiled
def triangle_down(values, p, columns, x, low, wide):
    """Rows low // wide on of x (., wide) become L^-1 x, of the triangle at p."""
    pairs = wide // PAIR * PAIR
    for row in range(0, columns, STRIP):
        for shift in range(0, pairs, PAIR):
            strip_down(values, p, row, x, low, wide, shift, 2)
        if pairs < wide:
            strip_down(values, p, row, x, low, wide, pairs, 1)
        p += STRIP * (row + STRIP)


@compiled
def forward(values, begin, first, start, rows, x, wide):
    """x (n + 8, wide), in the factor's order, becomes L^-1 x. What has no force yet is passed over."""
    pairs = wide // PAIR * PAIR
    for s in range(first.size - 1):
        low, columns = first[s] * wide, first[s + 1] - first[s]
        if not x[low : low + columns * wide].any():
            continue
        triangle_down(values, begin[s], columns, x, low, wide)
        p = begin[s + 1] - columns * (start[s + 1] - start[s])
        for k in range(start[s], start[s + 1], STRIP):
            for shift in range(0, pairs, PAIR):
                below_down(values, p, columns, x, low, rows, k, wide, shift, 2)
            if pairs < wide:
                below_down(values, p, columns, x, low, rows, k, wide, pairs, 1)
            p += STRIP * columns


@compiled
def backward(values, begin, first, start, rows, x, wide):
    """x (n + 8, wide), in the factor's order, becomes L^-T x."""
    pairs = wide // PAIR * PAIR
    for s in range(first.size - 2, -1, -1):
        low, columns = first[s] * wide, first[s + 1] - first[s]
        top = p = begin[s + 1] - columns * (start[s + 1] - start[s])
        for k in range(start[s], start[s + 1], STRIP):
            for shift in range(0, pairs, PAIR):
                below_up(values, p, columns, x, low, rows, k, wide, shift, 2)
            if pairs < wide:
                below_up(values, p, columns, x, low, rows, k, wide, pairs, 1)
            p += STRIP * columns
        for row in range((columns - 1) // STRIP * STRIP, -1, -STRIP):
            top -= STRIP * (row + STRIP)
            for shift in range(0, pairs, PAIR):
                strip_up(values, top, row, x, low, wide, shift, 2)
            if pairs < wide:
                strip_up(values, top, row, x, low, wide, pairs, 1)


@inlined
def column_down(values, p, count, x, low):
    """Eight sums over the columns of a strip times x."""
    a, b = zero(), zero()
    for j in range(0, count - 1, 2):
        ahead(values, p + STRIP * j + SOON)
        ahead(values, p + STRIP * j + SOON + STRIP)
        a = add(load(values, p + STRIP * j), spread(x, low + j), a)
        b = add(load(values, p + STRIP * j + STRIP), spread(x, low + j + 1), b)
    if count % 2:
        a = add(load(values, p + STRIP * (count - 1)), spread(x, low + count - 1), a)
    return add(filled(1.0), a, b)


@inlined
def column_up(values, p, count, x, low, held):
    """Add the sums over a strip's rows times `held` to x."""
    one = filled(1.0)
    for j in range(0, count // STRIP * STRIP, STRIP):
        for k in range(STRIP):
            ahead(values, p + STRIP * (j + k) + SOON)
        store(x, low + j, add(one, load(x, low + j), totals(values, p + STRIP * j, held)))
    for j in range(count // STRIP * STRIP, count):
        x[low + j] += total(times(load(values, p + STRIP * j), held))


@compiled
def one_column(values, begin, first, start, rows, x):
    """x (n + 8,), in the factor's order, becomes L^-T L^-1 x."""
    few, one = np.zeros(STRIP), filled(1.0)
    for s in range(first.size - 1):
        low, columns, p = first[s], first[s + 1] - first[s], begin[s]
        for row in range(low, low + columns, STRIP):
            store(x, row, add(one, load(x, row), column_down(values, p, row - low, x, low)))
            p += STRIP * (row - low)
            for j in range(STRIP):
                x[row + j] *= values[p + (STRIP + 1) * j]
                for i in range(j + 1, STRIP):
                    x[row + i] += values[p + STRIP * j + i] * x[row + j]
            p += STRIP * STRIP
        for k in range(start[s], start[s + 1], STRIP):
            store(few, 0, column_down(values, p, columns, x, low))
            for i in range(STRIP):
                x[rows[k + i]] += few[i]
            p += STRIP * columns
    for s in range(first.size - 2, -1, -1):
        low, columns = first[s], first[s + 1] - first[s]
        top = p = begin[s + 1] - columns * (start[s + 1] - start[s])
        for k in range(start[s], start[s + 1], STRIP):
            for i in range(STRIP):
                few[i] = x[rows[k + i]]
            column_up(values, p, columns, x, low, load(few, 0))
            p += STRIP * columns
        for row in range(low + (columns - 1) // STRIP * STRIP, low - 1, -STRIP):
            top -= STRIP * (row - low + STRIP)
            corner = top + STRIP * (row - low)
            for k in range(STRIP - 1, -1, -1):
                for i in range(k + 1, STRIP):
                    x[row + k] += values[corner + STRIP * k + i] * x[row + i]
                x[row + k] *= values[corner + (STRIP + 1) * k]
            column_up(values, top, row - low, x, low, load(x, row))
