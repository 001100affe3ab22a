"""The compiled loop of sampled blocks: at each sample the blocks, then the modes and the other states under their outputs.

The work space X is that of `modal_steps`, with one row more: a row holds the state itself at its sample, and the next row the
state it moves to. Its inputs are [w, p]: from outside, and the outputs of the sampled blocks. Only where numba is installed.
"""

from __future__ import annotations

import numpy as np

from flexplant.loop.modal_steps import BLOCK, LANES, read_rows
from flexplant.numerics.compiled import compiled, inlined
from flexplant.numerics.lanes import add, call_at, load, spread, store, times, total, zero

FINITE = -1


@inlined
def _dot(R, row, X, place):
    """R[row] . X from `place` on; four sums, so that their additions overlap."""
    columns = R.shape[1]
    first, a, b, c, d = row * columns, zero(), zero(), zero(), zero()
    whole = columns // (4 * LANES) * (4 * LANES)
    for i in range(0, whole, 4 * LANES):
        r, x = first + i, place + i
        a = add(load(R, r), load(X, x), a)
        b = add(load(R, r + LANES), load(X, x + LANES), b)
        c = add(load(R, r + 2 * LANES), load(X, x + 2 * LANES), c)
        d = add(load(R, r + 3 * LANES), load(X, x + 3 * LANES), d)
    for i in range(whole, columns, LANES):
        a = add(load(R, first + i), load(X, place + i), a)
    return (total(a) + total(b)) + (total(c) + total(d))


@inlined
def _modes_moved(modes, phi, nw, X, here):
    """Write the modes of the next sample into the next row. modes: F00, F01, F10, F11, then b of w and b of p, two rows each."""
    n, width = phi.shape[1], X.shape[1]
    inputs = here + 2 * n
    for i in range(0, n, LANES):
        f, g = zero(), zero()
        for k in range(nw):
            f = add(spread(X, inputs + k), load(phi, k * n + i), f)
        for k in range(nw, phi.shape[0]):
            g = add(spread(X, inputs + k), load(phi, k * n + i), g)
        q, v = load(X, here + i), load(X, here + n + i)
        forced = add(load(modes, 4 * n + i), f, times(load(modes, 6 * n + i), g))
        store(X, here + width + i, add(load(modes, i), q, add(load(modes, n + i), v, forced)))
        forced = add(load(modes, 5 * n + i), f, times(load(modes, 7 * n + i), g))
        store(X, here + width + n + i, add(load(modes, 2 * n + i), q, add(load(modes, 3 * n + i), v, forced)))


@inlined
def _rest_moved(A, into_rest, driven, k, X, row):
    """Write the other states of the next sample into the next row."""
    m, padded = A.shape
    width = X.shape[1]
    here = row * width
    place = here + width - padded
    for i in range(0, padded, LANES):
        moved = zero()
        for j in range(m):
            moved = add(spread(X, place + j), load(A, j * padded + i), moved)
        store(X, place + width + i, moved)
    for j in range(m):
        X[row + 1, width - padded + j] += driven[k, j] + _dot(into_rest, j, X, here)


@inlined
def _law(kind, u, low, high, s):
    """y and the new state of one channel of a law without memory or with one state."""
    if kind == 0:
        return min(max(u, low), high), s
    if kind == 1:
        return u - min(max(u, low), high), s
    if kind == 2:
        return low * np.floor(u / low + 0.5), s
    s += min(max(u - s, low), high)
    return s, s


@inlined
def _digital(flat, place, first, count, s, s0, s1, q, q0, q1, out, to):
    """Rows `first` to `first + count` of [[A, B], [C, D]] on [s[s0:s1], q[q0:q1]]."""
    for r in range(count):
        value, row = 0.0, place + (first + r) * (s1 - s0 + q1 - q0)
        for j in range(s1 - s0):
            value += flat[row + j] * s[s0 + j]
        for j in range(q1 - q0):
            value += flat[row + s1 - s0 + j] * q[q0 + j]
        out[to + r] = value


@inlined
def _gathered(base, direct, q0, q1, p, q):
    """Inputs q of one block: what the linear system gives it, and outputs of blocks that reach it directly."""
    for r in range(q0, q1):
        value = base[r]
        for j in range(p.size):
            value += direct[r, j] * p[j]
        q[r] = value


@inlined
def _due(table, e, k):
    period = table[e, 8]
    return period == 1 or k % period == 0


@inlined
def _evaluated(table, bounds, flat, direct, functions, base, q, p, s, k, t):
    """All blocks that are due at sample k; the row of a block whose input is not finite or whose function fails, else FINITE."""
    for e in range(table.shape[0]):
        if not _due(table, e, k):
            continue
        kind, q0, q1, p0, s0 = table[e, 0], table[e, 1], table[e, 2], table[e, 3], table[e, 5]
        _gathered(base, direct, q0, q1, p, q)
        for r in range(q0, q1):
            if not np.isfinite(q[r]):
                return e
        if kind < 3:
            for r in range(q1 - q0):
                p[p0 + r] = _law(kind, q[q0 + r], bounds[0, p0 + r], bounds[1, p0 + r], 0.0)[0]
        elif kind == 3:
            for r in range(q1 - q0):
                p[p0 + r], s[s0 + r] = _law(kind, q[q0 + r], bounds[0, p0 + r], bounds[1, p0 + r], s[s0 + r])
        elif kind == 4:
            s1 = table[e, 6]
            _digital(flat, table[e, 7], s1 - s0, table[e, 4] - p0, s, s0, s1, q, q0, q1, p, p0)
        elif call_at(functions[e], t, q, q0, s, s0, p, p0) != 1:
            return e
    return FINITE


@inlined
def _digital_moved(table, flat, direct, base, q, p, s, scratch, k):
    """The next states of digital systems, which may need the outputs of later blocks."""
    for e in range(table.shape[0]):
        if table[e, 0] != 4 or not _due(table, e, k):
            continue
        q0, q1, s0, s1 = table[e, 1], table[e, 2], table[e, 5], table[e, 6]
        _gathered(base, direct, q0, q1, p, q)
        _digital(flat, table[e, 7], 0, s1 - s0, s, s0, s1, q, q0, q1, scratch, s0)
        for j in range(s0, s1):
            s[j] = scratch[j]


@compiled
def sampled_march(modal, other, reading, asking, blocks, functions, W, driven, seen, X, memory, out, first, every, dt):
    """Samples first, first + 1, ... under W (nt, nw); (sample, block) of the first failure, or (FINITE, FINITE).

    driven: (nt, m), seen: (nt, nz + nq) what modes stepped beforehand add to the other states and to z and q.
    asking: rows of q on the modes and on [w, p, other states].
    memory: p, s, then scratch for q, base (q without p) and s. The state is in X[0] at the start and at the end.
    """
    modes, phi, _ = modal
    A, into_rest, _, _ = other
    on_modes, z_modes, on_tail, z_tail, share, row = reading
    q_modes, q_tail = asking
    table, bounds, flat, direct = blocks
    p, s, q, base, scratch = memory
    nt, nw = W.shape
    nz, tail, width, done = out.shape[1], 2 * phi.shape[1], X.shape[1], 0
    for start in range(0, nt, BLOCK):
        here = min(BLOCK, nt - start)
        for t in range(here):
            k = start + t
            for j in range(nw):
                X[t, tail + j] = W[k, j]
            for j in range(p.size):
                X[t, tail + nw + j] = 0.0
            for r in range(base.size):
                base[r] = seen[k, nz + r] + _dot(q_modes, r, X, t * width) + _dot(q_tail, r, X, t * width + tail)
            failed = _evaluated(table, bounds, flat, direct, functions, base, q, p, s, first + k, (first + k) * dt)
            if failed != FINITE:
                return k, failed
            _digital_moved(table, flat, direct, base, q, p, s, scratch, first + k)
            for j in range(p.size):
                X[t, tail + nw + j] = p[j]
            _modes_moved(modes, phi, nw, X, t * width)
            _rest_moved(A, into_rest, driven, k, X, t)
        skip = -(first + start) % every
        kept = max(0, (here - skip + every - 1) // every)
        read_rows(X, skip * width, every, kept, on_modes, z_modes)
        read_rows(X, skip * width + tail, every, kept, on_tail, z_tail)
        for k in range(kept):
            for r in range(nz):
                out[done + k, r] = share[r] * z_modes[k, row[r]] + z_tail[k, r] + seen[start + skip + k * every, r]
        done += kept
        for j in range(width):
            X[0, j] = X[here, j]
    return FINITE, FINITE
