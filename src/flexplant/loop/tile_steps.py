"""The compiled steps of a cascade whose modes few rows read: four samples at a time, the rows' sums kept in registers.

The modes are never written down sample by sample: eight modes move over four samples and are added to the sums of all rows at
once. What follows has few terms, and takes eight samples side by side. Imported only where numba is installed.
"""

from __future__ import annotations

from flexplant.numerics.compiled import compiled
from flexplant.numerics.lane_sums import no_sums, store_totals, weighted
from flexplant.numerics.lanes import add, load, spread, store, times, zero

LANES = 8
BLOCK = 32  # samples; what the rows read in them stays in the nearest cache


@compiled
def _read(packed, x, U, place, valid, Z, to, on_position, on_both):
    """Move the modes over `valid` <= 4 samples from U[:, 0] = U.flat[place] on; the rows' sums go to Z[:, 0] = Z.flat[to] on."""
    groups, size = packed.shape
    nu, samples, width = U.shape[0], U.shape[1], Z.shape[1]
    still, both = no_sums(on_position), no_sums(on_both)
    for i in range(groups):
        o, u = i * size, place
        f0, f1, f2, f3 = zero(), zero(), zero(), zero()
        p = o + 5 * LANES
        for _ in range(nu):
            w = load(packed, p)
            f0, f1 = add(spread(U, u), w, f0), add(spread(U, u + 1), w, f1)
            f2, f3 = add(spread(U, u + 2), w, f2), add(spread(U, u + 3), w, f3)
            p += LANES
            u += samples
        a, b, c, d = load(packed, o), load(packed, o + LANES), load(packed, o + 2 * LANES), load(packed, o + 3 * LANES)
        g, s = load(packed, o + 4 * LANES), 2 * LANES * i
        q0, v0 = load(x, s), load(x, s + LANES)
        q1, v1 = add(a, q0, add(b, v0, times(g, f0))), add(c, q0, add(d, v0, f0))
        q2, v2 = add(a, q1, add(b, v1, times(g, f1))), add(c, q1, add(d, v1, f1))
        q3, v3 = add(a, q2, add(b, v2, times(g, f2))), add(c, q2, add(d, v2, f2))
        still = weighted(still, packed, p, q0, q1, q2, q3)
        p += LANES * len(on_position)
        both = weighted(both, packed, p, q0, q1, q2, q3)
        p += LANES * len(on_both)
        both = weighted(both, packed, p, v0, v1, v2, v3)
        q, v = add(a, q3, add(b, v3, times(g, f3))), add(c, q3, add(d, v3, f3))
        if valid < 4:
            q, v = (q3, v3) if valid == 3 else (q2, v2) if valid == 2 else (q1, v1) if valid == 1 else (q0, v0)
        store(x, s, q)
        store(x, s + LANES, v)
    store_totals(still, Z, to, width)
    store_totals(both, Z, to + len(on_position) * width, width)


@compiled
def _combined(weights, Z, terms, U, first, out, place, count):
    """out[r, place + t] = weights[r] . [Z[:terms, t], U[:, first + t]] for t < count, a multiple of 8."""
    nu, samples, size = U.shape[0], U.shape[1], weights.shape[1]
    for r in range(weights.shape[0]):
        for t in range(0, count, LANES):
            value = zero()
            for k in range(terms):
                value = add(spread(weights, r * size + k), load(Z, k * Z.shape[1] + t), value)
            for k in range(nu):
                value = add(spread(weights, r * size + terms + k), load(U, k * samples + first + t), value)
            store(out, r * out.shape[1] + place + t, value)


@compiled
def _rest_moved(A, G, Z, below, rest, count):
    """Write the other states at `count` samples into Z below the modes' rows and move them on: rest = A rest + G[:, t]."""
    m = rest.size // 2
    for t in range(count):
        for i in range(m):
            Z[below + i, t] = rest[i]
            value = G[i, t]
            for j in range(m):
                value += A[i, j] * rest[j]
            rest[m + i] = value
        for i in range(m):
            rest[i] = rest[m + i]


@compiled
def tile_march(packed, x, on_position, on_both, A, into_rest, rest, weights, Z, G, U, first, out, place, count, valid):
    """`count` samples, a multiple of 8, under U[:, first:]; out[:, place:]: the outputs. The state moves over `valid` of them.

    packed: for eight modes F00, F01, F10, F11, b0 / b1, the modal forces of unit inputs times b1, the rows that read eta alone,
    the eta part of the others, their eta' part. x: eta and eta' of eight modes, of the next eight, ... The tuples on_position
    and on_both: as long as there are rows of either kind. into_rest, weights: on [rows, inputs] and [rows, rest, inputs].
    rest: the other states, then scratch. Z: (rows and other states, BLOCK), G: (m, BLOCK) scratch.
    """
    m = rest.size // 2
    rows = Z.shape[0] - m
    for block in range(0, count, BLOCK):
        here, left = min(BLOCK, count - block), valid - block
        for t in range(0, here, 4):
            _read(packed, x, U, first + block + t, min(4, max(0, left - t)), Z, t, on_position, on_both)
        if m:
            _combined(into_rest, Z, rows, U, first + block, G, 0, here)
            _rest_moved(A, G, Z, rows, rest, max(0, min(here, left)))
        _combined(weights, Z, rows + m, U, first + block, out, place + block, here)
