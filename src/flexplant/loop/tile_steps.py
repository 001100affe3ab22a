"""The compiled steps of a cascade in tiles of four samples: the modes' motion, then the rows that read it, summed in registers.

Eight modes move over four samples at once, two such groups side by side, and are written down; the rows then sum them over all
modes in registers. What follows has few terms, and takes eight samples side by side. Imported only where numba is installed.
"""

from __future__ import annotations

from flexplant.numerics.compiled import compiled, inlined
from flexplant.numerics.lane_sums import no_sums, store_totals, weighted
from flexplant.numerics.lanes import add, delayed, load, spread, store, times, zero

LANES = 8
BLOCK = 32  # samples; what the rows read in them stays in the nearest cache
FIXED = 5 * LANES  # F00, F01, F10, F11 and b0 / b1 of eight modes


@inlined
def _weighed(drive, p, r, U, u, f0, f1, f2, f3, g0, g1, g2, g3):
    """Sums over the inputs but the first at four samples, weighted from drive[p] and from drive[r] on."""
    nu, samples = U.shape
    for _ in range(1, nu):
        u += samples
        w, z = load(drive, p), load(drive, r)
        value = spread(U, u)
        f0, g0 = add(value, w, f0), add(value, z, g0)
        value = spread(U, u + 1)
        f1, g1 = add(value, w, f1), add(value, z, g1)
        value = spread(U, u + 2)
        f2, g2 = add(value, w, f2), add(value, z, g2)
        value = spread(U, u + 3)
        f3, g3 = add(value, w, f3), add(value, z, g3)
        p += LANES
        r += LANES
    return f0, f1, f2, f3, g0, g1, g2, g3


@inlined
def _four_steps(drive, o, x, s, f0, f1, f2, f3, h0, h1, h2, h3, seen, place, moving):
    """Eight modes over four samples under the forces h on eta and f on eta'; what they were at each goes to seen."""
    a, b, c, d = load(drive, o), load(drive, o + LANES), load(drive, o + 2 * LANES), load(drive, o + 3 * LANES)
    q0, v0 = load(x, s), load(x, s + LANES)
    q1, v1 = add(a, q0, add(b, v0, h0)), add(c, q0, add(d, v0, f0))
    q2, v2 = add(a, q1, add(b, v1, h1)), add(c, q1, add(d, v1, f1))
    q3, v3 = add(a, q2, add(b, v2, h2)), add(c, q2, add(d, v2, f2))
    store(x, s, add(a, q3, add(b, v3, h3)))
    store(x, s + LANES, add(c, q3, add(d, v3, f3)))
    store(seen, place, q0)
    store(seen, place + LANES, q1)
    store(seen, place + 2 * LANES, q2)
    store(seen, place + 3 * LANES, q3)
    if moving:
        store(seen, place + 4 * LANES, v0)
        store(seen, place + 5 * LANES, v1)
        store(seen, place + 6 * LANES, v2)
        store(seen, place + 7 * LANES, v3)


@inlined
def pushed(table, x, i, P, count):
    """Add to eight modes what the impulses P (samples, np) of the last `count` <= 4 samples did. table: (groups, 4 np * 16)."""
    width = P.shape[1]
    o, s = (i + 1) * table.shape[1] - count * width * 2 * LANES, 2 * LANES * i
    q, v = load(x, s), load(x, s + LANES)
    for k in range(count * width):
        value = spread(P, k)
        q, v = add(value, load(table, o), q), add(value, load(table, o + LANES), v)
        o += 2 * LANES
    store(x, s, q)
    store(x, s + LANES, v)


@inlined
def _moved(drive, x, U, place, seen, twofold, moving, table, P, count):
    """The modes over four samples of U from U.flat[place] on; the unit of each mode is what the first input does to its eta'.

    Before, they take the impulses of `count` samples, see `pushed`.
    """
    groups, size = drive.shape
    kept = 8 * LANES if moving else 4 * LANES
    for i in range(0, groups, 2):
        o, s, to = i * size, 2 * LANES * i, kept * i
        p, r = o + FIXED, o + size + FIXED
        f0, f1, f2, f3 = spread(U, place), spread(U, place + 1), spread(U, place + 2), spread(U, place + 3)
        m, n = load(drive, p - LANES), load(drive, r - LANES)
        h0, h1, h2, h3 = times(m, f0), times(m, f1), times(m, f2), times(m, f3)
        k0, k1, k2, k3 = times(n, f0), times(n, f1), times(n, f2), times(n, f3)
        f0, f1, f2, f3, g0, g1, g2, g3 = _weighed(drive, p, r, U, place, f0, f1, f2, f3, f0, f1, f2, f3)
        if len(twofold):
            skip = (U.shape[0] - 1) * LANES
            h0, h1, h2, h3, k0, k1, k2, k3 = _weighed(drive, p + skip, r + skip, U, place, h0, h1, h2, h3, k0, k1, k2, k3)
        if len(twofold) == 0:
            h0, h1, h2, h3 = times(m, f0), times(m, f1), times(m, f2), times(m, f3)
            k0, k1, k2, k3 = times(n, g0), times(n, g1), times(n, g2), times(n, g3)
        if count:
            pushed(table, x, i, P, count)
            pushed(table, x, i + 1, P, count)
        _four_steps(drive, o, x, s, f0, f1, f2, f3, h0, h1, h2, h3, seen, to, moving)
        _four_steps(drive, o + size, x, s + 2 * LANES, g0, g1, g2, g3, k0, k1, k2, k3, seen, to + kept, moving)


@inlined
def _moved_singly(drive, x, U, place, count, seen, twofold, moving):
    """As `_moved`, over `count` < 4 samples."""
    (groups, size), (nu, samples) = drive.shape, U.shape
    kept = 8 * LANES if moving else 4 * LANES
    for i in range(groups):
        o, s, to = i * size, 2 * LANES * i, kept * i
        a, b, c, d = load(drive, o), load(drive, o + LANES), load(drive, o + 2 * LANES), load(drive, o + 3 * LANES)
        q, v = load(x, s), load(x, s + LANES)
        for t in range(count):
            p = o + FIXED
            f, m = spread(U, place + t), load(drive, p - LANES)
            h = times(m, f)
            for k in range(1, nu):
                value = spread(U, place + t + k * samples)
                f = add(value, load(drive, p), f)
                if len(twofold):
                    h = add(value, load(drive, p + (nu - 1) * LANES), h)
                p += LANES
            if len(twofold) == 0:
                h = times(m, f)
            store(seen, to + t * LANES, q)
            if moving:
                store(seen, to + (4 + t) * LANES, v)
            q, v = add(a, q, add(b, v, h)), add(c, q, add(d, v, f))
        store(x, s, q)
        store(x, s + LANES, v)


@inlined
def _read(rows, seen, Z, to, on_position, on_both):
    """The rows' sums over all modes at four samples go to Z[:, 0] = Z.flat[to] on. rows: (passes, groups, .)."""
    passes, groups, size = rows.shape
    width, moving = Z.shape[1], len(on_both) > 0
    kept = 8 * LANES if moving else 4 * LANES
    for turn in range(passes):
        still, both, p, s = no_sums(on_position), no_sums(on_both), turn * groups * size, 0
        for _ in range(groups):
            a, b, c, d = load(seen, s), load(seen, s + LANES), load(seen, s + 2 * LANES), load(seen, s + 3 * LANES)
            still = weighted(still, rows, p, a, b, c, d)
            if moving:
                o = p + LANES * len(on_position)
                both = weighted(both, rows, o, a, b, c, d)
                a, b, c = load(seen, s + 4 * LANES), load(seen, s + 5 * LANES), load(seen, s + 6 * LANES)
                d = load(seen, s + 7 * LANES)
                both = weighted(both, rows, o + LANES * len(on_both), a, b, c, d)
            p += size
            s += kept
        store_totals(still, Z, to, width)
        to += len(on_position) * width
        store_totals(both, Z, to, width)
        to += len(on_both) * width


@compiled
def _combined(weights, Z, terms, U, first, out, place, count):
    """out[r, place + t] = weights[r] . [Z[:terms, t], U[:, first + t]] for t < count, a multiple of 8; four eights overlap."""
    nu, samples, size, width = U.shape[0], U.shape[1], weights.shape[1], Z.shape[1]
    last = count - LANES
    b, c, d = min(LANES, last), min(2 * LANES, last), min(3 * LANES, last)
    for r in range(weights.shape[0]):
        f0, f1, f2, f3 = zero(), zero(), zero(), zero()
        w, z = r * size, 0
        for _ in range(terms):
            value = spread(weights, w)
            f0, f1 = add(value, load(Z, z), f0), add(value, load(Z, z + b), f1)
            f2, f3 = add(value, load(Z, z + c), f2), add(value, load(Z, z + d), f3)
            w += 1
            z += width
        u = first
        for _ in range(nu):
            value = spread(weights, w)
            f0, f1 = add(value, load(U, u), f0), add(value, load(U, u + b), f1)
            f2, f3 = add(value, load(U, u + c), f2), add(value, load(U, u + d), f3)
            w += 1
            u += samples
        o = r * out.shape[1] + place
        store(out, o, f0)
        store(out, o + b, f1)
        store(out, o + c, f2)
        store(out, o + d, f3)


@compiled
def _rest_moved(powers, free, G, later, Z, below, count):
    """The other states l[t + 1] = A l[t] + G[:, t] in the rows of Z from `below` on, whose first column holds l[0].

    Eight samples side by side: their sums double over 1, 2 and 4 samples, powers: (3, m, m) A, A^2, A^4; then what the first
    of the eight starts from is added, free: (m, m, 8) A^1 to A^8. G, later: (m, BLOCK), the latter scratch.
    """
    m, width = G.shape[0], Z.shape[1]
    for turn in range(3):
        for i in range(0, m * BLOCK, LANES):
            value = load(G, i)
            store(later, i, delayed(value, 1) if turn == 0 else delayed(value, 2) if turn == 1 else delayed(value, 4))
        for i in range(m):
            g = i * BLOCK
            f0, f1, f2, f3 = load(G, g), load(G, g + LANES), load(G, g + 2 * LANES), load(G, g + 3 * LANES)
            for j in range(m):
                value, s = spread(powers, (turn * m + i) * m + j), j * BLOCK
                f0, f1 = add(value, load(later, s), f0), add(value, load(later, s + LANES), f1)
                f2, f3 = add(value, load(later, s + 2 * LANES), f2), add(value, load(later, s + 3 * LANES), f3)
            store(G, g, f0)
            store(G, g + LANES, f1)
            store(G, g + 2 * LANES, f2)
            store(G, g + 3 * LANES, f3)
    for t in range(0, count, LANES):
        for i in range(m):
            value = load(G, i * BLOCK + t)
            for j in range(m):
                value = add(spread(Z, (below + j) * width + t), load(free, (i * m + j) * LANES), value)
            store(Z, (below + i) * width + t + 1, value)


@compiled
def tile_march(modes, rows, other, reading, U, first, out, place, count, valid):
    """`count` samples, a multiple of 8, under U[:, first:]; out[:, place:]: the outputs. The state moves over `valid` of them.

    modes: drive, x, seen, twofold. drive: (groups, .) for eight modes F00, F01, F10, F11, what the first input adds to eta where
    it adds 1 to eta' (any input adds in that ratio, if `twofold` is empty), what the others add to eta', and, if `twofold` is
    not empty, to eta. An even number of groups. x: eta and eta' of eight modes, of the next eight, ... seen: scratch.
    rows: (passes, groups, .) the rows that read eta alone, the eta part of the others, their eta' part; then two tuples as long
    as there are rows of either kind. other: into (m, .) on [rows, inputs], or on the inputs alone, then what `_rest_moved` needs.
    reading: weights on [rows, other states, inputs] and Z: (rows and other states, BLOCK + 8).
    """
    (drive, x, seen, twofold), (packed, on_position, on_both) = modes, rows
    (into, powers, free, G, later), (weights, Z) = other, reading
    m, moving = G.shape[0], len(on_both) > 0
    read = Z.shape[0] - m
    for block in range(0, count, BLOCK):
        here, left = min(BLOCK, count - block), max(0, min(BLOCK, valid - block))
        for t in range(0, here, 4):
            u = first + block + t
            if t + 4 <= left:
                _moved(drive, x, U, u, seen, twofold, moving, drive, weights, 0)
            else:
                _moved_singly(drive, x, U, u, max(0, left - t), seen, twofold, moving)
            _read(packed, seen, Z, t, on_position, on_both)
        if m:
            _combined(into, Z, into.shape[1] - U.shape[0], U, first + block, G, 0, here)
            _rest_moved(powers, free, G, later, Z, read, here)
        _combined(weights, Z, read + m, U, first + block, out, place + block, here)
        for i in range(read, read + m):
            Z[i, 0] = Z[i, left]
