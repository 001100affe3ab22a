"""One exact time step of a `Cascade`, modes and the rest together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from flexplant.errors import InputError
from flexplant.loop.cascade import Cascade
from flexplant.model.arrays import FloatArray
from flexplant.plant.discretize import Step, mode_steps, stacked_expm, step_of
from flexplant.plant.state_space import StateSpace


@dataclass(frozen=True, eq=False, kw_only=True)
class Stepper:
    """eta, eta' and l of the next sample: modes by `modes` (n, 2, 2), the rest by A (m, m) and from_modes (m, 2n).

    drive: (2 nw, 2 n + m) what w[k] and w[k+1] - w[k] add to [eta, eta', l] of the next sample. forced: (2, n, 2) what a modal
    force and its change over the step add to eta, eta'.
    """

    modes: FloatArray
    A: FloatArray
    from_modes: FloatArray
    drive: FloatArray
    forced: FloatArray


def stepper(cascade: Cascade, dt: float, hold: str) -> Stepper:
    """The step of dt seconds, exact for inputs constant ("zero") or linear ("first") over it.

    Modes: one small exponential each. The rest takes from mode i the exponential of [[mode i, 0], [coupling, A]], so the
    motion of the plant within the step is followed exactly, not sampled and held. A discrete cascade steps by its own matrices.
    """
    nw = cascade.B.shape[1]
    if cascade.dt is not None:
        return _own_step(cascade, dt)
    modes = mode_steps(cascade.omega, cascade.zeta, dt, hold)
    rest = _rest_step(cascade, dt, hold)
    transition, forced = _through_modes(cascade, dt)
    columns = [(modes.hold, rest.hold), (modes.ramp, rest.ramp)]
    drive = np.vstack([_drive_rows(cascade, *pair, forced[:, :, k], nw) for k, pair in enumerate(columns)])
    ramp = np.zeros_like(modes.hold) if modes.ramp is None else modes.ramp
    both = np.stack([modes.hold, ramp])
    return Stepper(modes=modes.transition, A=rest.transition, from_modes=transition, drive=drive, forced=both)


def _own_step(cascade: Cascade, dt: float) -> Stepper:
    if cascade.dt is None or abs(cascade.dt - dt) > 1e-6 * dt:
        raise InputError(f"the system has dt = {cascade.dt} s, but time advances by {dt:.9g} s; use a time axis of step dt")
    drive = np.vstack([cascade.B.T, np.zeros_like(cascade.B.T)])
    none = np.zeros((2, 0, 2))
    return Stepper(modes=none.reshape(0, 2, 2), A=cascade.A, from_modes=cascade.from_modes, drive=drive, forced=none)


def _rest_step(cascade: Cascade, dt: float, hold: str) -> Step:
    m, nw = cascade.B.shape
    inputs = [f"w{k}" for k in range(nw)]
    return step_of(StateSpace(cascade.A, cascade.B, np.zeros((0, m)), np.zeros((0, nw)), inputs, [], name="rest"), dt, hold)


def _drive_rows(cascade: Cascade, modal: FloatArray | None, rest: FloatArray | None, forced: FloatArray, nw: int) -> FloatArray:
    """(nw, 2n + m): effect of one input column (held value, or ramp) on all states of the next sample."""
    if modal is None or rest is None:
        return np.zeros((nw, cascade.n_states))
    F = cascade.shape_in
    return np.hstack([F.T * modal[:, 0], F.T * modal[:, 1], (rest + forced @ F).T])


def _through_modes(cascade: Cascade, dt: float) -> tuple[FloatArray, FloatArray]:
    """What the rest gains over dt from eta, eta' (m, 2n), and from a modal force held or ramped up (m, n, 2).

    States of the exponential: s eta, dt eta', dt^2 f, dt^2 ramp, l; s = max(1, omega dt) and a balanced A keep its norm near
    omega dt, and each mode's coupling is divided by its size first (the result is linear in it).
    """
    n, m = cascade.omega.size, cascade.A.shape[0]
    if not n or not m or not cascade.from_modes.any():
        return np.zeros((m, 2 * n)), np.zeros((m, n, 2))
    A, (scale, _) = scipy.linalg.matrix_balance(cascade.A, permute=False, separate=True)
    x = cascade.omega * dt
    s = np.maximum(1.0, x)
    coupling = np.stack([cascade.from_modes[:, :n] * dt / s, cascade.from_modes[:, n:]], axis=-1) / scale[:, None, None]
    size = abs(coupling).max(axis=(0, 2))
    size[size == 0] = 1.0
    matrix = np.zeros((n, m + 4, m + 4))
    matrix[:, 0, 1], matrix[:, 1, 0], matrix[:, 1, 1] = s, -(x**2) / s, -2 * cascade.zeta * x
    matrix[:, 1, 2] = matrix[:, 2, 3] = 1.0
    matrix[:, 4:, :2] = np.moveaxis(coupling, 0, 1) / size[:, None, None]
    matrix[:, 4:, 4:] = A * dt
    gained = stacked_expm(matrix)[:, 4:, :4] * size[:, None, None] * scale[None, :, None]
    gained = np.moveaxis(gained, 0, 1)
    transition = np.hstack([gained[:, :, 0] * s, gained[:, :, 1] * dt])
    return transition, gained[:, :, 2:] * dt**2


def transition_of(cascade: Cascade, dt: float, steps: int) -> Stepper:
    """The free motion over `steps` steps of dt: the exponential of the long step, or a matrix power in discrete time."""
    if cascade.dt is None:
        return stepper(cascade, steps * dt, "zero")
    one = _own_step(cascade, dt)
    return replace(one, A=np.linalg.matrix_power(one.A, steps))
