"""The time recursion of a `Cascade`, many pieces of the time axis at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flexplant.loop.cascade import Cascade
from flexplant.loop.stepping import Stepper, stepper, transition_of
from flexplant.model.arrays import FloatArray

BLOCK = 16  # steps whose states are held at once


@dataclass(frozen=True, eq=False)
class Trajectory:
    """outputs: (nz, nt) without the direct part D w. final_state: in the order of the whole system's states."""

    outputs: FloatArray
    final_state: FloatArray


def march(cascade: Cascade, dt: float, w: FloatArray | None, nt: int, state: FloatArray, hold: str) -> Trajectory:
    """nt samples from `state` under the inputs w (nw, nt), or None for free motion.

    The recursion x[k+1] = F x[k] + G w is linear, so the time axis is cut into about sqrt(nt) pieces that advance side by side:
    first each from rest, to learn what the inputs add over a piece; then the starts of the pieces follow one another by F^L;
    then each piece runs again from its true start. The arithmetic is that of stepping one by one, in another order.
    """
    length = max(1, int(np.sqrt(nt / 2)))
    pieces = -(-nt // length)
    one = stepper(cascade, dt, hold)
    driven = None if w is None else _pieces(w, pieces, length)
    starts = _piece_starts(cascade, one, driven, transition_of(cascade, dt, length), _sorted(cascade, state), pieces, length)
    return _run(cascade, one, driven, starts, nt, length)


def _sorted(cascade: Cascade, state: FloatArray) -> FloatArray:
    return state[np.r_[cascade.modal_states, cascade.other_states]]


def _pieces(w: FloatArray, pieces: int, length: int) -> FloatArray:
    """(length, pieces, 2 nw): w[k] and w[k+1] - w[k] at step j of each piece; the last value stays beyond the end."""
    padded = np.pad(w, ((0, 0), (0, pieces * length + 1 - w.shape[1])), mode="edge")
    both = np.vstack([padded[:, :-1], np.diff(padded)])
    return np.ascontiguousarray(both.reshape(both.shape[0], pieces, length).transpose(2, 1, 0))


def _histories(one: Stepper, x: FloatArray, driven: FloatArray | None, length: int) -> Iterator[tuple[int, FloatArray]]:
    """(first step, states (count + 1, pieces, 2n + m)) for BLOCK steps at a time; the last row begins the next block.

    Products with the inputs and with the modes are made for the whole block at once: few large ones instead of many small ones,
    which a threaded BLAS on a busy machine would slow down many times.
    """
    n, N = one.modes.shape[0], x.shape[1]
    for start in range(0, length, BLOCK):
        count = min(BLOCK, length - start)
        history = np.zeros((count + 1, *x.shape))
        history[0] = x
        if driven is not None:
            inputs = driven[start : start + count]
            np.matmul(inputs.reshape(-1, inputs.shape[2]), one.drive, out=history[1:].reshape(-1, N))
        if n:
            _step_modes(one, history)
        if 2 * n < N:
            _step_rest(one, history)
        x = history[count]
        yield start, history


def _step_modes(one: Stepper, history: FloatArray) -> None:
    n = one.modes.shape[0]
    (qq, qv), (vq, vv) = np.ascontiguousarray(one.modes.transpose(1, 2, 0))
    for now, after in pairwise(history):
        q, v = now[:, :n], now[:, n : 2 * n]
        after[:, :n] += qq * q
        after[:, :n] += qv * v
        after[:, n : 2 * n] += vq * q
        after[:, n : 2 * n] += vv * v


def _step_rest(one: Stepper, history: FloatArray) -> None:
    modal = 2 * one.modes.shape[0]
    count, pieces, N = history.shape
    if modal:
        gained = history[:-1].reshape(-1, N)[:, :modal] @ one.from_modes.T
        history[1:, :, modal:] += gained.reshape(count - 1, pieces, -1)
    for now, after in pairwise(history):
        after[:, modal:] += now[:, modal:] @ one.A.T


def _piece_starts(
    cascade: Cascade, one: Stepper, driven: FloatArray | None, long: Stepper, state: FloatArray, pieces: int, length: int
) -> FloatArray:
    added = np.zeros((pieces, cascade.n_states))
    if driven is not None:
        for _, history in _histories(one, added, driven, length):
            added = history[-1]
    starts = np.empty((pieces, cascade.n_states))
    starts[0] = state
    for k in range(1, pieces):
        _, history = next(_histories(long, starts[k - 1 : k], None, 1))
        starts[k] = history[1, 0] + added[k - 1]
    return starts


def _run(cascade: Cascade, one: Stepper, driven: FloatArray | None, x: FloatArray, nt: int, length: int) -> Trajectory:
    rows = np.vstack([cascade.C_modes.T, cascade.C.T])
    pieces, nz = x.shape[0], rows.shape[1]
    outputs = np.empty((pieces, length, nz))
    final = np.empty(cascade.n_states)
    last_piece, last_step = divmod(nt - 1, length)
    for start, history in _histories(one, x, driven, length):
        states = history[:-1]
        values = (states.reshape(-1, x.shape[1]) @ rows).reshape(-1, pieces, nz)
        outputs[:, start : start + states.shape[0]] = values.transpose(1, 0, 2)
        if start <= last_step < start + states.shape[0]:
            final[np.r_[cascade.modal_states, cascade.other_states]] = states[last_step - start, last_piece]
    return Trajectory(outputs.reshape(-1, nz)[:nt].T, final)
