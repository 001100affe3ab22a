"""The exact map of a diagram with digital blocks over a time after which their samples repeat."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexplant.loop.hybrid import Hybrid
from flexplant.loop.stepping import Stepper, stepper
from flexplant.model.arrays import FloatArray
from flexplant.plant.state_space import StateSpace


class PeriodMap(NamedTuple):
    """x+ = F x + held w + ramp (w+ - w), z = C x + D w, where x holds the continuous states, then those of the digital blocks.

    The continuous states stand in the order of `close`; z is read, and w begins to act, at the first sample of the period.
    """

    F: FloatArray
    held: FloatArray
    ramp: FloatArray
    C: FloatArray
    D: FloatArray


def period_map(hybrid: Hybrid, dt: float, steps: int, hold: str = "zero") -> PeriodMap:
    """Stepped `steps` times dt from each unit vector of the states and of the inputs, all blocks due at the first sample."""
    linear, nw, nz, one = hybrid.linear, hybrid.nw, hybrid.nz, stepper(hybrid.linear, dt, hold)
    size, states, np_ = linear.n_states, hybrid.initial.size, linear.B.shape[1] - hybrid.nw
    unit = np.eye(size + states + 2 * nw)
    x, s, p = unit[:size], unit[size : size + states], np.zeros((np_, len(unit)))
    w, change = unit[size + states : size + states + nw], unit[size + states + nw :] / steps
    rows, z = np.hstack([linear.C_modes, linear.C]), np.zeros((nz, len(unit)))
    for k in range(steps):
        seen = rows @ x + linear.D[:, :nw] @ w
        due = [(e, e.block) for e in hybrid.elements if k % e.period(dt) == 0 and isinstance(e.block, StateSpace)]
        for e, block in due:
            asked = seen[nz:][e.inputs] + linear.D[nz:, nw:][e.inputs] @ p
            p[e.outputs] = block.C @ s[e.states] + block.D @ asked
        after = s.copy()
        for e, block in due:
            asked = seen[nz:][e.inputs] + linear.D[nz:, nw:][e.inputs] @ p
            after[e.states] = block.A @ s[e.states] + block.B @ asked
        if k == 0:
            z = seen[:nz] + linear.D[:nz, nw:] @ p
        s, x = after, _stepped(one, x, np.vstack([w, p, change, np.zeros_like(p)]))
        w = w + change
    order = np.argsort(np.r_[linear.modal_states, linear.other_states, size + np.arange(states)])
    moved, width = np.vstack([x, s])[order], size + states
    by_w = slice(width, width + nw)
    return PeriodMap(F=moved[:, order], held=moved[:, by_w], ramp=moved[:, width + nw :], C=z[:, order], D=z[:, by_w])


def _stepped(one: Stepper, x: FloatArray, driven: FloatArray) -> FloatArray:
    n, columns = len(one.modes), x.shape[1]
    modes = np.einsum("nij,jnk->ink", one.modes, x[: 2 * n].reshape(2, n, columns)).reshape(2 * n, columns)
    return np.asarray(np.vstack([modes, one.from_modes @ x[: 2 * n] + one.A @ x[2 * n :]]) + one.drive.T @ driven)
