"""The compiled loop of sampled blocks around modes: tiles of four samples, in which the blocks hear of each other's outputs.

The modes move over a tile as if the blocks put out nothing, and the rows sum them; what an output of the blocks adds to the rows
one, two and three samples later is a few numbers, and what it adds to the modes at the end of the tile is added there. So the
modes are read and written once in four samples, and the result is that of stepping one by one, in another order of sums.
Imported only where numba is installed.
"""

from __future__ import annotations

from flexplant.loop.sampled_lanes import FINITE, _digital_moved, _evaluated
from flexplant.loop.tile_steps import BLOCK, LANES, _combined, _moved, _moved_singly, _read, pushed
from flexplant.numerics.compiled import compiled, inlined

TILE = 4


@inlined
def _weighed(weights, r, Z, terms, t, W, k):
    """weights[r] . [Z[:, t], W[:, k]], rows of Z from `terms` on left out."""
    value, inputs = 0.0, Z.shape[0]
    for j in range(W.shape[0]):
        value += weights[r, inputs + j] * W[j, k]
    for j in range(terms):
        value += weights[r, j] * Z[j, t]
    return value


@inlined
def _rest_moved(into, Z, read, m, t, W, k, rest):
    """The other states one sample later, from the rows, themselves, the blocks' outputs and the inputs."""
    for i in range(m):
        rest[i] = _weighed(into, i, Z, Z.shape[0], t, W, k)
    for i in range(m):
        Z[read + i, t + 1] = rest[i]


@compiled
def tiled_march(modes, rows, other, reading, asking, blocks, functions, W, memory, out, first, every, dt):
    """Samples first, first + 1, ... under W (nw, nt); (sample, block) of the first failure, or (FINITE, FINITE).

    modes, rows: as in `tile_steps.tile_march`, driven by W alone. other: into (m, .) on [rows, other states, p, W]; echo
    (3, rows, np) what p adds to the rows one, two, three samples later; push: see `tile_steps.pushed`. reading: weights of z on
    [rows, other states, p, W], and Z (rows, other states and p; BLOCK + 8), whose first column holds the other states at the
    start and the end. asking: weights of q, those of p being zero. blocks: as in `sampled_lanes`.
    memory: p, s, then scratch for q, base, s, p of a tile (4, np), the other states and the outputs (nz, BLOCK).
    """
    (drive, x, seen, twofold), (packed, on_position, on_both) = modes, rows
    (into, echo, push), (weights, Z) = other, reading
    table, bounds, flat, direct = blocks
    p, s, q, base, scratch, P, rest, Y = memory
    nt, nz, m, moving = W.shape[1], out.shape[1], rest.size, len(on_both) > 0
    read = Z.shape[0] - m - p.size
    below, done, waiting = read + m, 0, 0
    for block in range(0, nt, BLOCK):
        here = min(BLOCK, nt - block)
        for tile in range(0, here, TILE):
            count = min(TILE, here - tile)
            if count == TILE:
                _moved(drive, x, W, block + tile, seen, twofold, moving, push, P, waiting)
            else:
                for i in range(drive.shape[0]):
                    pushed(push, x, i, P, waiting)
                _moved_singly(drive, x, W, block + tile, count, seen, twofold, moving)
            _read(packed, seen, Z, tile, on_position, on_both)
            for c in range(count):
                t = tile + c
                k = block + t
                for lag in range(c):
                    for r in range(read):
                        for j in range(p.size):
                            Z[r, t] += echo[c - lag - 1, r, j] * P[lag, j]
                for j in range(p.size):
                    Z[below + j, t] = 0.0
                for r in range(base.size):
                    base[r] = _weighed(asking, r, Z, below, t, W, k)
                failed = _evaluated(table, bounds, flat, direct, functions, base, q, p, s, first + k, (first + k) * dt)
                if failed != FINITE:
                    return k, failed
                _digital_moved(table, flat, direct, base, q, p, s, scratch, first + k)
                for j in range(p.size):
                    P[c, j] = p[j]
                    Z[below + j, t] = p[j]
                _rest_moved(into, Z, read, m, t, W, k, rest)
            waiting = count
        whole = min(BLOCK, (here + LANES - 1) // LANES * LANES)
        if block + whole <= nt:
            _combined(weights, Z, Z.shape[0], W, block, Y, 0, whole)
        else:
            for r in range(nz):
                for t in range(here):
                    Y[r, t] = _weighed(weights, r, Z, Z.shape[0], t, W, block + t)
        for t in range(-(first + block) % every, here, every):
            for r in range(nz):
                out[done, r] = Y[r, t]
            done += 1
        for i in range(m):
            Z[read + i, 0] = Z[read + i, here]
    for i in range(drive.shape[0]):
        pushed(push, x, i, P, waiting)
    return FINITE, FINITE
