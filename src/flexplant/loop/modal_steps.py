"""The compiled steps of a cascade: modes eight by eight in registers over a short block of samples, then the rows that read them.

A block's row of the work space X holds, at one sample, [eta | eta' | inputs | other states], each part padded with zeros to a
whole number of lanes. Imported only where numba is installed.
"""

from __future__ import annotations

from flexplant.numerics.compiled import compiled
from flexplant.numerics.lanes import add, load, spread, store, times, total, zero

BLOCK = 16  # samples; their rows of X stay in the nearest cache
LANES = 8
PAIR = 16  # modes that advance together, which hides the latency of the recursion


@compiled
def _coefficients(modes, i, n):
    """F and b of eight modes; modes: the rows F00, F01, F10, F11, b0, b1, each (n,)."""
    a, b, c, d = load(modes, i), load(modes, n + i), load(modes, 2 * n + i), load(modes, 3 * n + i)
    return a, b, c, d, load(modes, 4 * n + i), load(modes, 5 * n + i)


@compiled
def _stepped(F, q, v, f):
    """eta and eta' one step later under the modal force f."""
    a, b, c, d, g, h = F
    return add(a, q, add(b, v, times(g, f))), add(c, q, add(d, v, times(h, f)))


@compiled
def _kept(X, place, n, q, v, with_velocity):
    store(X, place, q)
    if with_velocity:
        store(X, place + n, v)


@compiled
def _both_stepped(X, here, there, n, F, G, q, v, Q, V, f, g, with_velocity):
    """Two groups of modes written to X, and a sample later."""
    _kept(X, here, n, q, v, with_velocity)
    _kept(X, there, n, Q, V, with_velocity)
    q, v = _stepped(F, q, v, f)
    Q, V = _stepped(G, Q, V, g)
    return q, v, Q, V


@compiled
def _advanced(modes, phi, x, U, X, first, count, with_velocity):
    """Write the modes at `count` samples into X and move x on. modes: (6, n), phi: (nu, n), x: (2, n), U: (nu, samples)."""
    (nu, samples), n, width = U.shape, x.shape[1], X.shape[1]
    whole = count // 4 * 4
    for i in range(0, n, PAIR):
        j = i + LANES
        F, G = _coefficients(modes, i, n), _coefficients(modes, j, n)
        q, v, Q, V = load(x, i), load(x, n + i), load(x, j), load(x, n + j)
        for t in range(0, whole, 4):
            f0, f1, f2, f3 = zero(), zero(), zero(), zero()
            g0, g1, g2, g3 = zero(), zero(), zero(), zero()
            for k in range(nu):
                p, P = load(phi, k * n + i), load(phi, k * n + j)
                u = k * samples + first + t
                w = spread(U, u)
                f0, g0 = add(w, p, f0), add(w, P, g0)
                w = spread(U, u + 1)
                f1, g1 = add(w, p, f1), add(w, P, g1)
                w = spread(U, u + 2)
                f2, g2 = add(w, p, f2), add(w, P, g2)
                w = spread(U, u + 3)
                f3, g3 = add(w, p, f3), add(w, P, g3)
            o = t * width
            q, v, Q, V = _both_stepped(X, o + i, o + j, n, F, G, q, v, Q, V, f0, g0, with_velocity)
            o += width
            q, v, Q, V = _both_stepped(X, o + i, o + j, n, F, G, q, v, Q, V, f1, g1, with_velocity)
            o += width
            q, v, Q, V = _both_stepped(X, o + i, o + j, n, F, G, q, v, Q, V, f2, g2, with_velocity)
            o += width
            q, v, Q, V = _both_stepped(X, o + i, o + j, n, F, G, q, v, Q, V, f3, g3, with_velocity)
        for t in range(whole, count):
            f0, g0 = zero(), zero()
            for k in range(nu):
                w = spread(U, k * samples + first + t)
                f0, g0 = add(w, load(phi, k * n + i), f0), add(w, load(phi, k * n + j), g0)
            o = t * width
            q, v, Q, V = _both_stepped(X, o + i, o + j, n, F, G, q, v, Q, V, f0, g0, with_velocity)
        store(x, i, q)
        store(x, n + i, v)
        store(x, j, Q)
        store(x, n + j, V)


@compiled
def read_rows(X, place, step, count, R, Y):
    """Y[k, r] = R[r] . X[k step] from `place` on, for k < count; R: an even number of rows, Y: count + 3 rows."""
    skip, columns = step * X.shape[1], R.shape[1]
    for k in range(0, count, 4):
        a, b = place + k * skip, place + min(k + 1, count - 1) * skip
        c, d = place + min(k + 2, count - 1) * skip, place + min(k + 3, count - 1) * skip
        for r in range(0, R.shape[0], 2):
            s = r * columns
            f0, f1, f2, f3 = zero(), zero(), zero(), zero()
            g0, g1, g2, g3 = zero(), zero(), zero(), zero()
            for i in range(0, columns, LANES):
                m, n = load(R, s + i), load(R, s + columns + i)
                x = load(X, a + i)
                f0, g0 = add(m, x, f0), add(n, x, g0)
                x = load(X, b + i)
                f1, g1 = add(m, x, f1), add(n, x, g1)
                x = load(X, c + i)
                f2, g2 = add(m, x, f2), add(n, x, g2)
                x = load(X, d + i)
                f3, g3 = add(m, x, f3), add(n, x, g3)
            Y[k, r], Y[k + 1, r], Y[k + 2, r], Y[k + 3, r] = total(f0), total(f1), total(f2), total(f3)
            Y[k, r + 1], Y[k + 1, r + 1], Y[k + 2, r + 1], Y[k + 3, r + 1] = total(g0), total(g1), total(g2), total(g3)


@compiled
def _rest_advanced(X, place, count, A, G, rest):
    """Write the other states at `count` samples into X and move them on: rest = A rest + G[t]. A: (m, padded m), transposed."""
    width, padded = X.shape[1], rest.size
    for t in range(count):
        here = t * width + place
        for i in range(0, padded, LANES):
            store(X, here + i, load(rest, i))
        for i in range(0, padded, LANES):
            after = load(G, t * padded + i)
            for j in range(A.shape[0]):
                after = add(spread(X, here + j), load(A, j * padded + i), after)
            store(rest, i, after)


@compiled
def march(modal, other, reading, U, X, out, phase, every, count):
    """`count` samples of a cascade under the inputs U; out: the rows read at every `every`-th sample, the first being -phase.

    modal: modes (6, n), phi (nu, n), x (2, n). other: A, from [eta | eta' | inputs] (m, .), G scratch, rest (padded m,).
    reading: rows on the modes and scratch, rows on [inputs | rest] and scratch, and for each output its share and row of the
    first ones.
    """
    modes, phi, x = modal
    A, into_rest, G, rest = other
    on_modes, seen, on_tail, direct, share, row = reading
    tail, width, m = 2 * x.shape[1], X.shape[1], A.shape[0]
    with_velocity = m > 0 or on_modes.shape[1] == tail
    done = 0
    for first in range(0, count, BLOCK):
        here = min(BLOCK, count - first)
        _advanced(modes, phi, x, U, X, first, here, with_velocity)
        for t in range(here):
            for k in range(U.shape[0]):
                X[t, tail + k] = U[k, first + t]
        if m:
            read_rows(X, 0, 1, here, into_rest, G)
            _rest_advanced(X, width - rest.size, here, A, G, rest)
        start = -(phase + first) % every
        kept = max(0, (here - start + every - 1) // every)
        read_rows(X, start * width, every, kept, on_modes, seen)
        read_rows(X, start * width + tail, every, kept, on_tail, direct)
        for k in range(kept):
            for r in range(out.shape[1]):
                out[done + k, r] = share[r] * seen[k, row[r]] + direct[k, r]
        done += kept
