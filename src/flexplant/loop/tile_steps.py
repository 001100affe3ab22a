"""The compiled steps of a cascade in tiles of four samples: the modes' motion, and the sums over them that the rows read.

Eight modes move over four samples at once, two such groups side by side. Few rows are summed as the modes move; more of them, for
whose sums the registers do not suffice, from what the modes have written down. Imported only where numba is installed.
"""

from __future__ import annotations

from flexplant.numerics.compiled import compiled, inlined
from flexplant.numerics.lane_sums import no_sums, store_totals, weighted
from flexplant.numerics.lanes import add, delayed, load, spread, start, store, zero

LANES = 8
TILE = 4  # samples
BLOCK = 32  # samples; what the rows read in them stays in the nearest cache
DRIVEN = 6 * LANES  # where a group's table tells what the inputs add, behind eta, eta' and the four coefficients


@inlined
def _forces(table, p, r, Z, width, u, inputs):
    """Sums over the inputs, Z from u on, at four samples: the first, and the others weighted from table[p] and [r] on."""
    f0, f1, f2, f3 = spread(Z, u), spread(Z, u + 1), spread(Z, u + 2), spread(Z, u + 3)
    g0, g1, g2, g3 = f0, f1, f2, f3
    for _ in range(1, inputs):
        u += width
        w, z = load(table, p), load(table, r)
        value = spread(Z, u)
        f0, g0 = add(value, w, f0), add(value, z, g0)
        value = spread(Z, u + 1)
        f1, g1 = add(value, w, f1), add(value, z, g1)
        value = spread(Z, u + 2)
        f2, g2 = add(value, w, f2), add(value, z, g2)
        value = spread(Z, u + 3)
        f3, g3 = add(value, w, f3), add(value, z, g3)
        p += LANES
        r += LANES
    return f0, f1, f2, f3, g0, g1, g2, g3


@inlined
def _four_steps(table, o, f0, f1, f2, f3, h0, h1, h2, h3, twofold):
    """Eight modes over four samples under the forces f on eta', and, if `twofold`, h on eta: eta and eta' at each of them."""
    q0, v0, a, b = load(table, o), load(table, o + LANES), load(table, o + 2 * LANES), load(table, o + 3 * LANES)
    c, d = load(table, o + 4 * LANES), load(table, o + 5 * LANES)
    if len(twofold):
        q1, v1 = add(a, q0, add(b, v0, h0)), add(c, q0, add(d, v0, f0))
        q2, v2 = add(a, q1, add(b, v1, h1)), add(c, q1, add(d, v1, f1))
        q3, v3 = add(a, q2, add(b, v2, h2)), add(c, q2, add(d, v2, f2))
        store(table, o, add(a, q3, add(b, v3, h3)))
    else:
        q1, v1 = add(a, q0, add(b, f0, v0)), add(c, q0, add(d, v0, f0))
        q2, v2 = add(a, q1, add(b, f1, v1)), add(c, q1, add(d, v1, f1))
        q3, v3 = add(a, q2, add(b, f2, v2)), add(c, q2, add(d, v2, f2))
        store(table, o, add(a, q3, add(b, f3, v3)))
    store(table, o + LANES, add(c, q3, add(d, v3, f3)))
    return q0, q1, q2, q3, v0, v1, v2, v3


@inlined
def _seen(table, o, kinds, still, both, q0, q1, q2, q3, v0, v1, v2, v3):
    """Sum the rows over eight modes of four samples, from table[o] on, or write down there what they read."""
    _, mixed, summed, read = kinds
    if len(mixed):
        r = load(table, o - LANES)
        v0, v1, v2, v3 = add(r, v0, q0), add(r, v1, q1), add(r, v2, q2), add(r, v3, q3)
    still = weighted(still, table, o, q0, q1, q2, q3)
    p = o + LANES * len(summed[0])
    if len(mixed) == 0:
        both = weighted(both, table, p, q0, q1, q2, q3)
        p += LANES * len(summed[1])
    both = weighted(both, table, p, v0, v1, v2, v3)
    if len(read[0]) + len(read[1]):
        store(table, o, q0)
        store(table, o + LANES, q1)
        store(table, o + 2 * LANES, q2)
        store(table, o + 3 * LANES, q3)
    if len(read[1]):
        store(table, o + 4 * LANES, v0)
        store(table, o + 5 * LANES, v1)
        store(table, o + 6 * LANES, v2)
        store(table, o + 7 * LANES, v3)
    return still, both


@inlined
def pushed(table, o, push, i, P, width, count):
    """Add to the eight modes of group i, table from o on, what the impulses P (samples, width) of `count` <= 4 samples did.

    push: (groups, 4 width, 16).
    """
    place = ((i + 1) * TILE - count) * width * 2 * LANES
    q, v = load(table, o), load(table, o + LANES)
    for k in range(count * width):
        value = spread(P, k)
        q, v = add(value, load(push, place), q), add(value, load(push, place + LANES), v)
        place += 2 * LANES
    store(table, o, q)
    store(table, o + LANES, v)


@inlined
def _behind(kinds, inputs):
    """Where a group's table tells what rows read, behind what the inputs add, and the ratio of `mixed`."""
    twofold, mixed, _, _ = kinds
    place = DRIVEN + (inputs - 1) * LANES
    if len(twofold):
        place += (inputs - 1) * LANES
    if len(mixed):
        place += LANES
    return place


@inlined
def _tile(table, shape, kinds, Z, width, inputs, u, t, push, P, outputs, count):
    """The modes over four samples of the inputs, Z from u on; the rows' sums go to Z[:, t]. See `tile_march`.

    Before, they take the impulses of `count` samples, see `pushed`.
    """
    (groups, size, _), (twofold, _, summed, _) = shape, kinds
    skip, read = (inputs - 1) * LANES, _behind(kinds, inputs)
    still, both = no_sums(summed[0]), no_sums(summed[1])
    for i in range(0, groups - 1, 2):
        o = i * size
        r = o + size
        f0, f1, f2, f3, g0, g1, g2, g3 = _forces(table, o + DRIVEN, r + DRIVEN, Z, width, u, inputs)
        h0, h1, h2, h3, k0, k1, k2, k3 = f0, f1, f2, f3, g0, g1, g2, g3
        if len(twofold):
            h0, h1, h2, h3, k0, k1, k2, k3 = _forces(table, o + DRIVEN + skip, r + DRIVEN + skip, Z, width, u, inputs)
        if count:
            pushed(table, o, push, i, P, outputs, count)
            pushed(table, r, push, i + 1, P, outputs, count)
        states = _four_steps(table, o, f0, f1, f2, f3, h0, h1, h2, h3, twofold)
        still, both = _seen(table, o + read, kinds, still, both, *states)
        states = _four_steps(table, r, g0, g1, g2, g3, k0, k1, k2, k3, twofold)
        still, both = _seen(table, r + read, kinds, still, both, *states)
    if groups % 2:
        o = (groups - 1) * size
        f0, f1, f2, f3, _, _, _, _ = _forces(table, o + DRIVEN, o + DRIVEN, Z, width, u, inputs)
        h0, h1, h2, h3 = f0, f1, f2, f3
        if len(twofold):
            h0, h1, h2, h3, _, _, _, _ = _forces(table, o + DRIVEN + skip, o + DRIVEN + skip, Z, width, u, inputs)
        if count:
            pushed(table, o, push, groups - 1, P, outputs, count)
        states = _four_steps(table, o, f0, f1, f2, f3, h0, h1, h2, h3, twofold)
        still, both = _seen(table, o + read, kinds, still, both, *states)
    store_totals(still, Z, t, width)
    store_totals(both, Z, t + len(summed[0]) * width, width)
    _read(table, shape, kinds, read, Z, width, t)


@inlined
def _read(table, shape, kinds, place, Z, width, to):
    """The rows' sums over what the modes have written down of four samples go to Z[:, to:]."""
    (groups, size, passes), (_, mixed, _, (on_position, on_both)) = shape, kinds
    if len(on_position) + len(on_both) == 0:
        return
    moving = len(on_both) > 0
    each = len(on_position) + (len(on_both) if len(mixed) else 2 * len(on_both))
    for turn in range(passes):
        still, both, s = no_sums(on_position), no_sums(on_both), place
        p = place + (8 * LANES if moving else 4 * LANES) + turn * each * LANES
        for _ in range(groups):
            a, b, c, d = load(table, s), load(table, s + LANES), load(table, s + 2 * LANES), load(table, s + 3 * LANES)
            still = weighted(still, table, p, a, b, c, d)
            if moving:
                o = p + LANES * len(on_position)
                if len(mixed) == 0:
                    both = weighted(both, table, o, a, b, c, d)
                    o += LANES * len(on_both)
                a, b, c = load(table, s + 4 * LANES), load(table, s + 5 * LANES), load(table, s + 6 * LANES)
                d = load(table, s + 7 * LANES)
                both = weighted(both, table, o, a, b, c, d)
            p += size
            s += size
        store_totals(still, Z, to, width)
        to += len(on_position) * width
        store_totals(both, Z, to, width)
        to += len(on_both) * width


@compiled
def one_tile(table, shape, kinds, Z, width, inputs, u, t, push, P, outputs, count, left, before):
    """As `_tile`, the state moving over `left` <= 4 samples only. before: scratch (groups, 16)."""
    if left < TILE:
        for i in range(shape[0]):
            pushed(table, i * shape[1], push, i, P, outputs, count)
        count = 0
        _kept(table, shape, before)
    _tile(table, shape, kinds, Z, width, inputs, u, t, push, P, outputs, count)
    if left < TILE:
        _moved_singly(table, shape, kinds, Z, width, inputs, u, left, before)


@inlined
def _kept(table, shape, before):
    """before (groups, 16) = the state."""
    for i in range(shape[0]):
        store(before, 2 * LANES * i, load(table, i * shape[1]))
        store(before, 2 * LANES * i + LANES, load(table, i * shape[1] + LANES))


@inlined
def _moved_singly(table, shape, kinds, Z, width, inputs, u, count, before):
    """The modes over `count` < 4 samples from the state before, read by no row."""
    (groups, size, _), (twofold, _, _, _) = shape, kinds
    for i in range(groups):
        o, s = i * size, 2 * LANES * i
        q, v, a, b = load(before, s), load(before, s + LANES), load(table, o + 2 * LANES), load(table, o + 3 * LANES)
        c, d = load(table, o + 4 * LANES), load(table, o + 5 * LANES)
        for t in range(count):
            p, f = o + DRIVEN, spread(Z, u + t)
            h = f
            for k in range(1, inputs):
                value = spread(Z, u + t + k * width)
                f = add(value, load(table, p), f)
                if len(twofold):
                    h = add(value, load(table, p + (inputs - 1) * LANES), h)
                p += LANES
            if len(twofold):
                q, v = add(a, q, add(b, v, h)), add(c, q, add(d, v, f))
            else:
                q, v = add(a, q, add(b, f, v)), add(c, q, add(d, v, f))
        store(table, o, q)
        store(table, o + LANES, v)


@compiled
def taken(U, inputs, samples, first, count, Z, width, row):
    """Z[row + k, :count] = U[k, first : first + count] for each of the inputs."""
    whole = count // LANES * LANES
    for k in range(inputs):
        source, target = k * samples + first, (row + k) * width
        for t in range(0, whole, LANES):
            store(Z, target + t, load(U, source + t))
        for t in range(whole, count):
            Z[target + t] = U[source + t]


@compiled
def combined(weights, places, ends, rows, Z, width, out, columns, place, count):
    """out[r, place + t] = the sum of weights[k] Z[places[k], t] over ends[r] <= k < ends[r + 1], t < count, a multiple of 8.

    Four eights of samples side by side, which overlap where there are fewer.
    """
    last = count - LANES
    b, c, d = min(LANES, last), min(2 * LANES, last), min(3 * LANES, last)
    for r in range(rows):
        f0, f1, f2, f3 = zero(), zero(), zero(), zero()
        for k in range(ends[r], ends[r + 1]):
            value, z = spread(weights, k), places[k] * width
            f0, f1 = add(value, load(Z, z), f0), add(value, load(Z, z + b), f1)
            f2, f3 = add(value, load(Z, z + c), f2), add(value, load(Z, z + d), f3)
        o = r * columns + place
        store(out, o, f0)
        store(out, o + b, f1)
        store(out, o + c, f2)
        store(out, o + d, f3)


@compiled
def _rest_moved(powers, free, coupled, m, G, later, Z, width, below, count):
    """The other states l[t + 1] = A l[t] + G[:, t] in the rows of Z from `below` on, whose first column holds l[0].

    Eight samples side by side: their sums double over 1, 2 and 4 samples, powers: (3, m, m) A, A^2, A^4; then what the first
    of the eight starts from is added, free: (m, m, 8) A^1 to A^8. coupled: (m, m) where any of them is not zero. G, later:
    (m, BLOCK), the latter scratch.
    """
    for turn in range(3):
        for i in range(0, m * BLOCK, LANES):
            value = load(G, i)
            store(later, i, delayed(value, 1) if turn == 0 else delayed(value, 2) if turn == 1 else delayed(value, 4))
        for i in range(m):
            g = i * BLOCK
            f0, f1, f2, f3 = load(G, g), load(G, g + LANES), load(G, g + 2 * LANES), load(G, g + 3 * LANES)
            for j in range(m):
                if coupled[i * m + j]:
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
                if coupled[i * m + j]:
                    value = add(spread(Z, (below + j) * width + t), load(free, (i * m + j) * LANES), value)
            store(Z, (below + i) * width + t + 1, value)


@compiled
def _block(table, shape, kinds, Z, width, heard, inputs, count, valid, before):
    """The rows' sums at `count` <= BLOCK samples; the modes' state moves over `valid` of them."""
    for t in range(0, count, TILE):
        u = heard * width + t
        if t + TILE > valid:
            _kept(table, shape, before)
        _tile(table, shape, kinds, Z, width, inputs, u, t, Z, Z, 0, 0)
        if t + TILE > valid:
            _moved_singly(table, shape, kinds, Z, width, inputs, u, max(0, valid - t), before)


@compiled
def tile_march(modes, other, reading, Z, U, first, out, place, count, valid):
    """`count` samples, a multiple of 8, under U[:, first:]; out[:, place:]: the outputs. The state moves over `valid` of them.

    modes: table, kinds, passes, before. table: (groups, .) eta and eta' of eight modes, then F00, what the first input adds to
    eta (any input adds in that ratio), F10, F11, what the others add to eta'. Eta' is counted in what the first input adds to
    it, and eta in what that adds to the next eta, so that both are 1. kinds: twofold, mixed, summed, read. If `twofold` is not
    empty: F00, F01, F10, F11, what the others add to eta' and to eta, each counted in what the first one adds.
    Behind them the rows: what they read is written down, where `read` is not empty; then the rows that read eta alone, the eta
    part of the others, their eta' part, for each of the passes; or, if `mixed` is not empty, first r, and then weights of
    w = eta + r eta'. summed, read: two tuples as long as there are rows of either kind, summed as the modes move, or read from
    what they write down; one is empty. before: scratch (groups, 16).
    other: terms of G, powers, free, coupled, G, later of `_rest_moved`. reading: terms, see `combined`. Z: [rows, other states,
    inputs] at the samples of a block; its first column holds the other states at the start and the end.
    """
    (table, kinds, passes, before), (into, powers, free, coupled, G, later), m = modes, other, other[4].shape[0]
    (inputs, samples), (all_rows, width), (rows, columns) = U.shape, Z.shape, out.shape
    shape, heard, z = (table.shape[0], table.shape[1], passes), all_rows - inputs, start(Z)
    for block in range(0, count, BLOCK):
        here, left = min(BLOCK, count - block), max(0, min(BLOCK, valid - block))
        taken(start(U), inputs, samples, first + block, here, z, width, heard)
        _block(start(table), shape, kinds, z, width, heard, inputs, here, left, start(before))
        if m:
            combined(start(into[0]), start(into[1]), start(into[2]), m, z, width, start(G), BLOCK, 0, here)
            fixed = start(powers), start(free), start(coupled), m
            _rest_moved(*fixed, start(G), start(later), z, width, heard - m, here)
        terms = start(reading[0]), start(reading[1]), start(reading[2]), rows
        combined(*terms, z, width, start(out), columns, place + block, here)
        for i in range(heard - m, heard):
            Z[i, 0] = Z[i, left]
