"""The compiled loops of `multifrontal`: what goes into a front, and its rows below solved with its triangle.

Imported only where numba is installed.
"""

from __future__ import annotations

from flexplant.numerics.compiled import compiled, inlined
from flexplant.numerics.factorization.panel_lanes import STRIP, triangle_down
from flexplant.numerics.lane_math import filled
from flexplant.numerics.lanes import WIDTH, add, load, store, times


@compiled
def placed(first, last, rows, place):
    """place: a front's columns first to last, then its rows below, counted from 0."""
    for j in range(first, last):
        place[j] = j - first
    for k in range(rows.size):
        place[rows[k]] = last - first + k


@compiled
def entered(square, below, height, first, last, rows, order, rank, indptr, indices, data, place):
    """Add the matrix's entries to a front: square (c, c), lower, and below (height, c), by columns; whether all had a place."""
    columns = last - first
    for j in range(first, last):
        for p in range(indptr[order[j]], indptr[order[j] + 1]):
            i = rank[indices[p]]
            if i >= last:
                k = place[i] - columns
                if k < 0 or k >= rows.size or rows[k] != i:
                    return False
                below[(j - first) * height + k] += data[p]
            elif i >= j:
                square[(j - first) * columns + i - first] += data[p]
    return True


@inlined
def added(target, at, source, p, to, first, last):
    """target[at + to[k]] += source[p + k]; to ascends, and often by ones."""
    k, one = first, filled(1.0)
    while k < last:
        if k + WIDTH <= last and to[k + WIDTH - 1] == to[k] + WIDTH - 1:
            store(target, at + to[k], add(one, load(source, p + k), load(target, at + to[k])))
            k += WIDTH
        else:
            target[at + to[k]] += source[p + k]
            k += 1


@inlined
def within(to, columns):
    """How many places are among a front's columns."""
    inside = 0
    while inside < to.size and to[inside] < columns:
        inside += 1
    return inside


@inlined
def stride(size):
    """Rows of an update, filled up."""
    return (size + STRIP - 1) // STRIP * STRIP


@compiled
def extended(square, below, columns, height, child, rows, place):
    """Add a child's update, lower and by columns, to its parent's columns."""
    to, size = place[rows], stride(rows.size)
    inside = within(to, columns)
    for a in range(inside):
        added(square, to[a] * columns, child, a * size, to, a, inside)
        added(below, to[a] * height - columns, child, a * size, to, inside, rows.size)


@compiled
def handed_on(update, columns, height, child, rows, place):
    """Add a child's update, lower and by columns, to what its parent hands on."""
    to, size = place[rows], stride(rows.size)
    for a in range(within(to, columns), rows.size):
        added(update, (to[a] - columns) * height - columns, child, a * size, to, a, rows.size)


@compiled
def packed(square, columns, values, p):
    """A lower triangle L, by columns, in strips from p on: -L, and 1 / L on the diagonal; ones where there are no more rows."""
    minus = filled(-1.0)
    for row in range(0, columns, STRIP):
        high = min(row + STRIP, columns)
        for j in range(row):
            if high == row + STRIP:
                store(values, p, times(minus, load(square, j * columns + row)))
            else:
                for i in range(row, row + STRIP):
                    values[p + i - row] = -square[j * columns + i] if i < high else 0.0
            p += STRIP
        for j in range(row, row + STRIP):
            for i in range(row, row + STRIP):
                values[p + i - row] = -square[j * columns + i] if j < i < high else 0.0
            values[p + j - row] = 1 / square[j * columns + j] if j < columns else 1.0
            p += STRIP


@compiled
def solved_below(values, triangle, p, columns, below, height, room, together):
    """below (height, columns), by columns, becomes below L^-T; its negative goes into strips from p on."""
    for first in range(0, height, together):
        wide = min(together, height - first)
        for j in range(columns):
            for i in range(0, wide, WIDTH):
                store(room, j * wide + i, load(below, j * height + first + i))
        room[columns * wide : (columns + STRIP) * wide] = 0.0
        triangle_down(values, triangle, columns, room, 0, wide)
        minus = filled(-1.0)
        for i in range(0, wide, WIDTH):
            for j in range(columns):
                x = load(room, j * wide + i)
                store(below, j * height + first + i, x)
                store(values, p, times(minus, x))
                p += STRIP
