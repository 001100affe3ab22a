"""A cascade's recursion lifted over L steps: matrix products for everything within a block, a short recursion between blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexplant.loop.cascade import Cascade
from flexplant.loop.stepping import Stepper, transition_of
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.numerics.compiled import Kernel

CALL = 50_000  # multiply-adds that one turn of an interpreted loop costs
LONGEST = 128


@dataclass(frozen=True, eq=False, kw_only=True)
class Lifted:
    """x[L] = F^L x[0] + W received, outputs = x[0] seen + W direct, W the row [w[0], ..., w[L]] of one block, L = length.

    long: F^L. received: ((L+1) nw, N). seen: (N, kept nz), direct: ((L+1) nw, kept nz): the outputs of samples 0, every, ...
    """

    length: int
    every: int
    long: Stepper
    received: FloatArray
    seen: FloatArray
    direct: FloatArray


def block_length(cascade: Cascade, every: int) -> int:
    """Steps in a block: long enough to make the recursion between blocks cheap, short enough for the products within."""
    m = cascade.A.shape[0]
    nz, nw = cascade.D.shape
    best = np.sqrt((CALL + 4 * m * m) / max(nz * nw / every, 1))
    wanted = int(np.clip(best, 8, LONGEST))
    if every <= wanted:
        return wanted - wanted % every
    fitting = [k for k in range(8, LONGEST + 1) if every % k == 0]
    return min(fitting, key=lambda k: abs(k - wanted)) if fitting else every


def lifted(cascade: Cascade, one: Stepper, dt: float, every: int) -> Lifted:
    """The lifted recursion of the stepper `one` of dt seconds, with the outputs of every `every`-th sample."""
    length = block_length(cascade, every)
    nw = cascade.B.shape[1]
    held, ramp = one.drive[:nw] - one.drive[nw:], one.drive[nw:]
    offsets = np.arange(0, length, every)
    return Lifted(
        length=length,
        every=every,
        long=transition_of(cascade, dt, length),
        received=_received(one, held, ramp, length),
        seen=_seen(cascade, one, offsets),
        direct=_direct(cascade, one, held, ramp, offsets, length),
    )


def stepped(one: Stepper, states: FloatArray) -> FloatArray:
    """F x for each row x = [eta, eta', l] of `states`."""
    n = one.modes.shape[0]
    q, v, rest = states[:, :n], states[:, n : 2 * n], states[:, 2 * n :]
    M = one.modes
    modal = [q * M[:, 0, 0] + v * M[:, 0, 1], q * M[:, 1, 0] + v * M[:, 1, 1]]
    return np.hstack([*modal, states[:, : 2 * n] @ one.from_modes.T + rest @ one.A.T])


def _rows_stepped(one: Stepper, rows: FloatArray) -> FloatArray:
    """r F for each row r."""
    n = one.modes.shape[0]
    q, v, rest = rows[:, :n], rows[:, n : 2 * n], rows[:, 2 * n :]
    M = one.modes
    modal = np.hstack([q * M[:, 0, 0] + v * M[:, 1, 0], q * M[:, 0, 1] + v * M[:, 1, 1]])
    return np.hstack([modal + rest @ one.from_modes, rest @ one.A])


def _received(one: Stepper, held: FloatArray, ramp: FloatArray, length: int) -> FloatArray:
    """Row block k: F^(L-1-k) held + F^(L-k) ramp."""
    nw, N = held.shape
    out = np.zeros((length + 1, nw, N))
    out[length] = ramp
    for k in range(length - 1, -1, -1):
        out[k] += held
        if k:
            ramp = stepped(one, ramp)
            out[k] += ramp
            held = stepped(one, held)
    return out.reshape(-1, N)


def _seen(cascade: Cascade, one: Stepper, offsets: IntArray) -> FloatArray:
    rows, kept = np.hstack([cascade.C_modes, cascade.C]), []
    for k in range(int(offsets[-1]) + 1):
        if k in offsets:
            kept.append(rows)
        rows = _rows_stepped(one, rows)
    return np.ascontiguousarray(np.vstack(kept).T)


def _direct(cascade: Cascade, one: Stepper, held: FloatArray, ramp: FloatArray, offsets: IntArray, length: int) -> FloatArray:
    """Block (k, t): C F^(t-1-k) held for k < t, C F^(t-k) ramp for 1 <= k <= t, D for k = t."""
    rows = np.hstack([cascade.C_modes, cascade.C]).T
    nz, nw = cascade.D.shape
    after = np.zeros((length + 1, nw, nz))  # what w[0] adds to the output t samples later, inside a block
    ramps = np.zeros((length + 1, nw, nz))
    ramps[0] = ramp @ rows
    after[0] = cascade.D.T
    for t in range(1, int(offsets[-1]) + 1):
        after[t] = held @ rows
        held, ramp = stepped(one, held), stepped(one, ramp)
        ramps[t] = ramp @ rows
    out = np.zeros((length + 1, nw, offsets.size, nz))
    for column, t in enumerate(offsets):
        k = np.arange(t + 1)
        out[k, :, column] = after[t - k]
        out[k[1:], :, column] += ramps[t - k[1:]]
    return out.reshape((length + 1) * nw, -1)


def _starts_loops(modes, A_transposed, from_modes_transposed, driven, x, starts):  # type: ignore[no-untyped-def]
    """starts[j] = x, then x = F x + driven[j], block after block; x is left at the end of the last block."""
    n, m, N = modes.shape[0], A_transposed.shape[0], x.shape[0]
    after = np.empty(N)
    for j in range(driven.shape[0]):
        for i in range(N):
            starts[j, i] = x[i]
            after[i] = driven[j, i]
        for i in range(n):
            after[i] += modes[i, 0, 0] * x[i] + modes[i, 0, 1] * x[n + i]
            after[n + i] += modes[i, 1, 0] * x[i] + modes[i, 1, 1] * x[n + i]
        if m:
            for i in range(2 * n):
                for r in range(m):
                    after[2 * n + r] += from_modes_transposed[i, r] * x[i]
            for i in range(m):
                for r in range(m):
                    after[2 * n + r] += A_transposed[i, r] * x[2 * n + i]
        for i in range(N):
            x[i] = after[i]


def _starts_numpy(
    modes: FloatArray,
    A_transposed: FloatArray,
    from_modes_transposed: FloatArray,
    driven: FloatArray,
    x: FloatArray,
    starts: FloatArray,
) -> None:
    n = modes.shape[0]
    qq, qv, vq, vv = (np.ascontiguousarray(modes[:, i, j]) for i in (0, 1) for j in (0, 1))
    for j in range(driven.shape[0]):
        starts[j] = x
        q, v, rest = starts[j, :n], starts[j, n : 2 * n], starts[j, 2 * n :]
        x[:] = driven[j]
        x[:n] += qq * q + qv * v
        x[n : 2 * n] += vq * q + vv * v
        if rest.size:
            x[2 * n :] += starts[j, : 2 * n] @ from_modes_transposed + rest @ A_transposed


block_starts = Kernel(_starts_loops, _starts_numpy)
