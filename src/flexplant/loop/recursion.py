"""The time recursion of a `Cascade`, many pieces of the time axis at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexplant.loop.cascade import Cascade
from flexplant.loop.stepping import Stepper, stepper, transition_of
from flexplant.model.arrays import FloatArray


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


def _advance(one: Stepper, x: FloatArray, driven: FloatArray | None) -> FloatArray:
    """Next states (pieces, 2n + m), columns [eta, eta', l]."""
    n = one.modes.shape[0]
    q, v, rest = x[:, :n], x[:, n : 2 * n], x[:, 2 * n :]
    out = np.empty_like(x) if driven is None else driven @ one.drive
    if driven is None:
        out[:] = 0.0
    out[:, :n] += one.modes[:, 0, 0] * q
    out[:, :n] += one.modes[:, 0, 1] * v
    out[:, n : 2 * n] += one.modes[:, 1, 0] * q
    out[:, n : 2 * n] += one.modes[:, 1, 1] * v
    if rest.shape[1]:
        out[:, 2 * n :] += rest @ one.A.T + x[:, : 2 * n] @ one.from_modes.T
    return out


def _piece_starts(
    cascade: Cascade, one: Stepper, driven: FloatArray | None, long: Stepper, state: FloatArray, pieces: int, length: int
) -> FloatArray:
    added = np.zeros((pieces, cascade.n_states))
    if driven is not None:
        for j in range(length):
            added = _advance(one, added, driven[j])
    starts = np.empty((pieces, cascade.n_states))
    starts[0] = state
    for k in range(1, pieces):
        starts[k] = _advance(long, starts[k - 1 : k], None)[0] + added[k - 1]
    return starts


def _run(cascade: Cascade, one: Stepper, driven: FloatArray | None, x: FloatArray, nt: int, length: int) -> Trajectory:
    rows = np.hstack([cascade.C_modes, cascade.C]).T.copy()
    outputs = np.empty((x.shape[0], length, rows.shape[1]))
    final = np.empty(cascade.n_states)
    last_piece, last_step = divmod(nt - 1, length)
    for j in range(length):
        outputs[:, j] = x @ rows
        if j == last_step:
            final[np.r_[cascade.modal_states, cascade.other_states]] = x[last_piece]
        x = _advance(one, x, None if driven is None else driven[j])
    return Trajectory(outputs.reshape(-1, rows.shape[1])[:nt].T, final)
