"""The loop of sampled blocks in numpy, for functions that only Python can call and where numba is not installed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexplant.blocks.sampled import DEAD_ZONE, QUANTISER, RATE_LIMITER, SATURATION, USER, UserFunction
from flexplant.model.arrays import FloatArray, IntArray

STATE_SPACE = "state space"
KINDS = {SATURATION: 0, DEAD_ZONE: 1, QUANTISER: 2, RATE_LIMITER: 3, STATE_SPACE: 4, USER: 5}
FINITE = -1  # no failure


def sampled_steps(
    linear: tuple[FloatArray, ...],
    direct: tuple[FloatArray, ...],
    table: IntArray,
    bounds: FloatArray,
    flat: FloatArray,
    driven: FloatArray,
    seen: FloatArray,
    out: FloatArray,
    x: FloatArray,
    p: FloatArray,
    s: FloatArray,
    first: int,
    every: int,
    dt: float,
    functions: Sequence[UserFunction | None] | None,
) -> tuple[int, int]:
    """Samples `first`, first + 1, ...: q, the blocks in order, the outputs z, then x[k+1] = F x[k] + forced p + driven[k].

    linear: modes (4, n), A (m, m), from_modes (m, 2n), forced (N, np), rows of q and of z on x; direct: rows of q and z on p.
    table: a row a block: kind, q0, q1, p0, p1, s0, s1, first place in `flat`, period. seen: (nt, nz + nq). x, p, s change.
    Returns (sample, block) of the first input that is not finite, or FINITE twice.
    """
    modes, A, from_modes, forced, q_rows, z_rows = linear
    q_direct, z_direct = direct
    n, m, nz = modes.shape[1], A.shape[0], z_rows.shape[0]
    q = np.zeros(q_rows.shape[0])
    kept = (first + every - 1) // every
    for k in range(driven.shape[0]):
        for turn in range(2):  # outputs first, then the states of the digital systems, which may need later outputs
            for e in range(table.shape[0]):
                kind, q0, q1, p0, p1, s0, s1, place, period = table[e]
                if (first + k) % period != 0 or (turn == 1 and kind != 4):
                    continue
                q[q0:q1] = seen[k, nz + q0 : nz + q1] + q_rows[q0:q1] @ x + q_direct[q0:q1] @ p
                u = q[q0:q1]
                if not np.isfinite(u).all():
                    return k, e
                limited = np.minimum(np.maximum(u, bounds[0, p0:p1]), bounds[1, p0:p1]) if kind < 2 else u
                if kind == 0:
                    p[p0:p1] = limited
                elif kind == 1:
                    p[p0:p1] = u - limited
                elif kind == 2:
                    p[p0:p1] = bounds[0, p0:p1] * np.floor(u / bounds[0, p0:p1] + 0.5)
                elif kind == 3:
                    s[s0:s1] += np.minimum(np.maximum(u - s[s0:s1], bounds[0, p0:p1]), bounds[1, p0:p1])
                    p[p0:p1] = s[s0:s1]
                elif kind == 4:
                    width = s1 - s0 + q1 - q0
                    ABCD = flat[place : place + (s1 - s0 + p1 - p0) * width].reshape((s1 - s0 + p1 - p0, width))
                    found = ABCD @ np.concatenate((s[s0:s1], u))
                    if turn == 0:
                        p[p0:p1] = found[s1 - s0 :]
                    else:
                        s[s0:s1] = found[: s1 - s0]
                elif functions is not None and (function := functions[e]) is not None:
                    p[p0:p1], s[s0:s1] = function((first + k) * dt, u.copy(), s[s0:s1].copy())
        if (first + k) % every == 0:
            out[(first + k) // every - kept] += z_rows @ x + z_direct @ p
        after = driven[k] + forced @ p
        if n:
            after[:n] += modes[0] * x[:n] + modes[1] * x[n : 2 * n]
            after[n : 2 * n] += modes[2] * x[:n] + modes[3] * x[n : 2 * n]
        if m:
            after[2 * n :] += A @ x[2 * n :] + from_modes @ x[: 2 * n]
        x[:] = after
    return FINITE, FINITE
