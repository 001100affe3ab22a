"""Solutions with a supernodal factor, eight columns side by side in vector registers, sixteen where there are so many.

The factor is read once each way for all columns: with few of them memory takes the time, with sixteen arithmetic. Imported
only where numba is installed. See `multifrontal.Panels` for how the factor is stored.
"""

from __future__ import annotations

import numpy as np

from flexplant.numerics.compiled import compiled, inlined
from flexplant.numerics.lane_math import filled
from flexplant.numerics.lanes import WIDTH, add, load, spread, store, times, zero

QUAD = 4  # rows of the factor at a time
PAIR = 2 * WIDTH


@inlined
def dots(values, p, stride, count, x, wide, out, to):
    """out[to + k wide] = sum over j < count of values[p + k stride + j] x[j wide], of four k and eight columns."""
    q, r, s = p + stride, p + 2 * stride, p + 3 * stride
    a, b, c, d = zero(), zero(), zero(), zero()
    for j in range(count):
        v = load(x, j * wide + to % wide)
        a, b = add(spread(values, p + j), v, a), add(spread(values, q + j), v, b)
        c, d = add(spread(values, r + j), v, c), add(spread(values, s + j), v, d)
    store(out, to, a)
    store(out, to + wide, b)
    store(out, to + 2 * wide, c)
    store(out, to + 3 * wide, d)


@inlined
def dots_of_pair(values, p, stride, count, x, wide, out, to):
    """`dots` of sixteen columns."""
    q, r, s = p + stride, p + 2 * stride, p + 3 * stride
    a, b, c, d = zero(), zero(), zero(), zero()
    e, f, g, h = zero(), zero(), zero(), zero()
    for j in range(count):
        at = j * wide + to % wide
        v, w = load(x, at), load(x, at + WIDTH)
        one, two, three, four = spread(values, p + j), spread(values, q + j), spread(values, r + j), spread(values, s + j)
        a, b, c, d = add(one, v, a), add(two, v, b), add(three, v, c), add(four, v, d)
        e, f, g, h = add(one, w, e), add(two, w, f), add(three, w, g), add(four, w, h)
    store(out, to, a)
    store(out, to + WIDTH, e)
    store(out, to + wide, b)
    store(out, to + wide + WIDTH, f)
    store(out, to + 2 * wide, c)
    store(out, to + 2 * wide + WIDTH, g)
    store(out, to + 3 * wide, d)
    store(out, to + 3 * wide + WIDTH, h)


@inlined
def sums(values, p, stride, count, x, at, bt, ct, dt, wide, shift, out):
    """out[j wide] += sum over k of values[p + k stride + j] times row k of x, whose four rows begin at at, bt, ct and dt."""
    q, r, s = p + stride, p + 2 * stride, p + 3 * stride
    a, b, c, d = load(x, at + shift), load(x, bt + shift), load(x, ct + shift), load(x, dt + shift)
    for j in range(count):
        to = j * wide + shift
        v = add(spread(values, q + j), b, add(spread(values, p + j), a, load(out, to)))
        store(out, to, add(spread(values, s + j), d, add(spread(values, r + j), c, v)))


@inlined
def sums_of_pair(values, p, stride, count, x, at, bt, ct, dt, wide, shift, out):
    """`sums` of sixteen columns."""
    q, r, s, next_ = p + stride, p + 2 * stride, p + 3 * stride, shift + WIDTH
    a, b, c, d = load(x, at + shift), load(x, bt + shift), load(x, ct + shift), load(x, dt + shift)
    e, f, g, h = load(x, at + next_), load(x, bt + next_), load(x, ct + next_), load(x, dt + next_)
    for j in range(count):
        to = j * wide + shift
        one, two, three, four = spread(values, p + j), spread(values, q + j), spread(values, r + j), spread(values, s + j)
        v, w = add(two, b, add(one, a, load(out, to))), add(two, f, add(one, e, load(out, to + WIDTH)))
        store(out, to, add(four, d, add(three, c, v)))
        store(out, to + WIDTH, add(four, h, add(three, g, w)))


@compiled
def all_dots(values, p, stride, count, x, wide, out, to):
    """`dots` of all columns."""
    pairs = wide // PAIR * PAIR
    for shift in range(0, pairs, PAIR):
        dots_of_pair(values, p, stride, count, x, wide, out, to + shift)
    if pairs < wide:
        dots(values, p, stride, count, x, wide, out, to + pairs)


@compiled
def all_sums(values, p, stride, count, x, at, bt, ct, dt, wide, out):
    """`sums` of all columns."""
    pairs = wide // PAIR * PAIR
    for shift in range(0, pairs, PAIR):
        sums_of_pair(values, p, stride, count, x, at, bt, ct, dt, wide, shift, out)
    if pairs < wide:
        sums(values, p, stride, count, x, at, bt, ct, dt, wide, pairs, out)


@compiled
def corner_down(values, p, row, given, wide, solved):
    """Four rows of U^-T x: solved, the sums over earlier rows, and given, through the four rows' own triangle."""
    q, r, s, one = p + row + row + QUAD, p + row + 2 * (row + QUAD), p + row + 3 * (row + QUAD), filled(1.0)
    for at in range(row * wide, (row + 1) * wide, WIDTH):
        bt, ct, dt = at + wide, at + 2 * wide, at + 3 * wide
        a = times(spread(values, p + row), add(one, load(solved, at), load(given, at)))
        b = add(spread(values, q), a, add(one, load(solved, bt), load(given, bt)))
        b = times(spread(values, q + 1), b)
        c = add(spread(values, r), a, add(one, load(solved, ct), load(given, ct)))
        c = times(spread(values, r + 2), add(spread(values, r + 1), b, c))
        d = add(spread(values, s), a, add(one, load(solved, dt), load(given, dt)))
        d = times(spread(values, s + 3), add(spread(values, s + 2), c, add(spread(values, s + 1), b, d)))
        store(solved, at, a)
        store(solved, bt, b)
        store(solved, ct, c)
        store(solved, dt, d)


@compiled
def corner_up(values, p, row, wide, x):
    """Four rows of U^-1 x in place, those below being solved and taken into account."""
    q, r, s = p + row + row + QUAD, p + row + 2 * (row + QUAD), p + row + 3 * (row + QUAD)
    for at in range(row * wide, (row + 1) * wide, WIDTH):
        bt, ct, dt = at + wide, at + 2 * wide, at + 3 * wide
        d = times(spread(values, s + 3), load(x, dt))
        c = times(spread(values, r + 2), add(spread(values, s + 2), d, load(x, ct)))
        b = times(spread(values, q + 1), add(spread(values, r + 1), c, add(spread(values, s + 1), d, load(x, bt))))
        a = add(spread(values, q), b, add(spread(values, r), c, add(spread(values, s), d, load(x, at))))
        store(x, at, times(spread(values, p + row), a))
        store(x, bt, b)
        store(x, ct, c)
        store(x, dt, d)


@compiled
def forward(values, begin, first, start, rows, x, wide, given, solved):
    """x (n + 1, wide), in the factor's order, becomes U^-T x. given, solved: room for a supernode's rows, in fours."""
    few = np.empty(QUAD * wide)
    for s in range(first.size - 1):
        low, columns, p = first[s] * wide, first[s + 1] - first[s], begin[s]
        size = columns * wide
        given[:size] = x[low : low + size]
        given[size : size + QUAD * wide] = 0.0
        for row in range(0, columns, QUAD):
            all_dots(values, p, row + QUAD, row, solved, wide, solved, row * wide)
            corner_down(values, p, row, given, wide, solved)
            p += QUAD * (row + QUAD)
        for k in range(start[s], start[s + 1], QUAD):
            all_dots(values, p, columns, columns, solved, wide, few, 0)
            p += QUAD * columns
            for i in range(QUAD):
                at = rows[k + i] * wide
                for j in range(wide):
                    x[at + j] += few[i * wide + j]
        x[low : low + size] = solved[:size]


@compiled
def backward(values, begin, first, start, rows, x, wide, given):
    """x (n + 1, wide), in the factor's order, becomes U^-1 x. given: room as in `forward`."""
    x[first[-1] * wide :] = 0.0
    for s in range(first.size - 2, -1, -1):
        low, columns = first[s] * wide, first[s + 1] - first[s]
        size = columns * wide
        given[:size] = x[low : low + size]
        given[size : size + QUAD * wide] = 0.0
        p = begin[s + 1] - columns * (start[s + 1] - start[s])
        for k in range(start[s], start[s + 1], QUAD):
            a, b, c, d = rows[k] * wide, rows[k + 1] * wide, rows[k + 2] * wide, rows[k + 3] * wide
            all_sums(values, p, columns, columns, x, a, b, c, d, wide, given)
            p += QUAD * columns
        p = begin[s + 1] - columns * (start[s + 1] - start[s])
        for row in range((columns - 1) // QUAD * QUAD, -1, -QUAD):
            p -= QUAD * (row + QUAD)
            corner_up(values, p, row, wide, given)
            at = row * wide
            all_sums(values, p, row + QUAD, row, given, at, at + wide, at + 2 * wide, at + 3 * wide, wide, given)
        x[low : low + size] = given[:size]


@compiled
def one_column(values, begin, first, start, rows, x, given, solved):
    """x (n + 1,), in the factor's order, becomes U^-1 U^-T x; room for a supernode's rows, in fours."""
    for s in range(first.size - 1):
        low, columns, p = first[s], first[s + 1] - first[s], begin[s]
        given[:columns] = x[low : low + columns]
        given[columns : columns + QUAD] = 0.0
        for row in range(0, columns, QUAD):
            count = row + QUAD
            solved[row:count] = 0.0
            solved[row:count] = given[row:count] + np.dot(values[p : p + QUAD * count].reshape(QUAD, count), solved[:count])
            for k in range(row, count):
                at = p + (k - row) * count
                for j in range(row, k):
                    solved[k] += values[at + j] * solved[j]
                solved[k] *= values[at + k]
            p += QUAD * count
        below = np.dot(values[p : begin[s + 1]].reshape(start[s + 1] - start[s], columns), solved[:columns])
        for k in range(below.size):
            x[rows[start[s] + k]] += below[k]
        x[low : low + columns] = solved[:columns]
    x[first[-1]] = 0.0
    for s in range(first.size - 2, -1, -1):
        low, columns = first[s], first[s + 1] - first[s]
        p = begin[s + 1] - columns * (start[s + 1] - start[s])
        given[:columns] = x[low : low + columns]
        given[columns : columns + QUAD] = 0.0
        picked = x[rows[start[s] : start[s + 1]]]
        given[:columns] += np.dot(picked, values[p : begin[s + 1]].reshape(picked.size, columns))
        for row in range((columns - 1) // QUAD * QUAD, -1, -QUAD):
            count = row + QUAD
            p -= QUAD * count
            for k in range(count - 1, row - 1, -1):
                at = p + (k - row) * count
                given[k] *= values[at + k]
                for j in range(k):
                    given[j] += values[at + j] * given[k]
        x[low : low + columns] = given[:columns]
