"""The compiled loop of sampled blocks around modes: tiles of four samples, in which the blocks hear of each other's outputs.

The modes move over a tile as if the blocks put out nothing, and the rows sum them; what an output of the blocks adds to the rows
one, two and three samples later is a few numbers, and what it adds to the modes at the end of the tile is added there. So the
modes are read and written once in four samples, and the result is that of stepping one by one, in another order of sums.
Imported only where numba is installed.
"""

from __future__ import annotations

from flexplant.loop.sampled_lanes import FINITE, _digital_moved, _evaluated
from flexplant.loop.tile_steps import BLOCK, LANES, TILE, combined, one_tile, pushed, taken
from flexplant.numerics.compiled import compiled, inlined
from flexplant.numerics.lanes import start


@inlined
def _weighed(weights, r, Z, terms, t):
    """weights[r] . Z[:terms, t]."""
    value = 0.0
    for j in range(terms):
        value += weights[r, j] * Z[j, t]
    return value


@inlined
def _rest_moved(into, Z, read, m, t, rest):
    """The other states one sample later, from the rows, themselves, the inputs and the blocks' outputs."""
    for i in range(m):
        rest[i] = _weighed(into, i, Z, Z.shape[0], t)
    for i in range(m):
        Z[read + i, t + 1] = rest[i]


@compiled
def tiled_march(modes, other, reading, asking, blocks, functions, W, memory, out, first, every, dt):
    """Samples first, first + 1, ... under W (nw, nt); (sample, block) of the first failure, or (FINITE, FINITE).

    modes: as in `tile_steps.tile_march`, driven by W alone. other: into (m, .) on [rows, other states, W, p]; echo
    (3, rows, np) what p adds to the rows one, two, three samples later; push: see `tile_steps.pushed`. reading: terms of z on
    [rows, other states, W, p], see `tile_steps.combined`, and Z (rows, other states, W and p; BLOCK + 8), whose first column
    holds the other states at the start and the end. asking: weights of q on all but p. blocks: as in `sampled_lanes`.
    memory: p, s, then scratch for q, base, s, p of a tile (4, np), the other states and the outputs (nz, BLOCK).
    """
    (table, kinds, passes, before), (into, echo, push), (terms, Z) = modes, other, reading
    laws, bounds, flat, direct = blocks
    p, s, q, base, scratch, P, rest, Y = memory
    (nw, nt), nz, m = W.shape, out.shape[1], rest.size
    below, (weights, places, ends), width, z = Z.shape[0] - p.size, terms, Z.shape[1], start(Z)
    shape, heard = (table.shape[0], table.shape[1], passes), below - nw
    read, done, waiting = heard - m, 0, 0
    for block in range(0, nt, BLOCK):
        here = min(BLOCK, nt - block)
        taken(start(W), nw, nt, block, here, z, width, heard)
        for tile in range(0, here, TILE):
            count = min(TILE, here - tile)
            inputs, impulses = (nw, heard * width + tile, tile), (start(push), start(P), p.size, waiting)
            one_tile(start(table), shape, kinds, z, width, *inputs, *impulses, count, start(before))
            for c in range(count):
                t = tile + c
                k = block + t
                for lag in range(c):
                    for r in range(read):
                        for j in range(p.size):
                            Z[r, t] += echo[c - lag - 1, r, j] * P[lag, j]
                for r in range(base.size):
                    base[r] = _weighed(asking, r, Z, below, t)
                failed = _evaluated(laws, bounds, flat, direct, functions, base, q, p, s, first + k, (first + k) * dt)
                if failed != FINITE:
                    return k, failed
                _digital_moved(laws, flat, direct, base, q, p, s, scratch, first + k)
                for j in range(p.size):
                    P[c, j] = p[j]
                    Z[below + j, t] = p[j]
                _rest_moved(into, Z, read, m, t, rest)
            waiting = count
        whole = (here + LANES - 1) // LANES * LANES
        combined(start(weights), start(places), start(ends), nz, z, width, start(Y), BLOCK, 0, whole)
        for t in range(-(first + block) % every, here, every):
            for r in range(nz):
                out[done, r] = Y[r, t]
            done += 1
        for i in range(read, heard):
            Z[i, 0] = Z[i, here]
    for i in range(table.shape[0]):
        pushed(start(table), i * table.shape[1], start(push), i, start(P), p.size, waiting)
    return FINITE, FINITE
