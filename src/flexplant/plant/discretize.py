"""Exact discretisation with zero- or first-order hold, rigid-body modes included."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from flexplant.errors import InputError, expect_choice
from flexplant.model.arrays import FloatArray, is_finite
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace, channels_of, output_rows, state_space

HOLDS = ("zero", "first")


@dataclass(frozen=True, eq=False)
class Step:
    """x[k+1] = transition x[k] + hold u[k] + ramp (u[k+1] - u[k]); ramp is None for a zero-order hold.

    Dense: (n, n), (n, nu), (n, nu). Per mode, x = (eta, eta') under the modal force: (n, 2, 2), (n, 2), (n, 2).
    """

    transition: FloatArray
    hold: FloatArray
    ramp: FloatArray | None


def discretize(plant: ModalPlant | StateSpace | Descriptor, dt: float, *, hold: str = "zero") -> StateSpace:
    """The plant sampled every dt seconds, exact for inputs that are constant ("zero") or linear ("first") between samples.

    x[k+1] = F x[k] + G0 u[k] + G1 (u[k+1] - u[k]) from the exponential of the augmented matrix
    [[A, B, 0], [0, 0, I], [0, 0, 0]] dt, so poles at 0 need no special case. With "first" the state is x - G1 u, which makes
    the result causal: (F, G0 + F G1 - G1, C, D + C G1). Modal plants: states [eta; eta'].
    Raises InputError for dt <= 0, an unknown hold, a plant that is discrete already, or a descriptor with a singular E.
    Source: Van Loan 1978; Franklin, Powell and Workman, Digital Control of Dynamic Systems, section 6.3.
    """
    if isinstance(plant, ModalPlant) and plant.damping is None:
        return _assembled(plant, checked_dt(dt), hold)
    system = state_space(plant)
    step = step_of(system, checked_dt(dt), hold)
    return _causal(system, step, dt)


def checked_dt(dt: float) -> float:
    """dt as a float; InputError unless it is positive and finite."""
    if not (is_finite(dt) and dt > 0):
        raise InputError(f"dt = {dt!r:.60}: the sample time must be a positive, finite number of seconds")
    return float(dt)


def check_hold(hold: str) -> None:
    """InputError for an unknown hold."""
    expect_choice(hold, HOLDS, "hold")


def step_of(system: StateSpace, dt: float, hold: str) -> Step:
    """The dense one-step recursion of a continuous state space; InputError if it is discrete already."""
    check_hold(hold)
    if system.dt is not None:
        raise InputError(f"state space {system.name!r} is discrete already (dt = {system.dt} s); give the continuous one")
    n, nu = system.B.shape
    size = n + nu * (2 if hold == "first" else 1)
    augmented = np.zeros((size, size))
    augmented[:n, :n], augmented[:n, n : n + nu] = system.A * dt, system.B * dt
    if hold == "first":
        augmented[n : n + nu, n + nu :] = np.eye(nu)
    exponential = balanced_expm(augmented)
    ramp = exponential[:n, n + nu :] if hold == "first" else None
    return Step(exponential[:n, :n], exponential[:n, n : n + nu], ramp)


def balanced_expm(matrix: FloatArray) -> FloatArray:
    """exp(matrix) after scaling by powers of two, which keeps scaling and squaring accurate for entries of very unequal size."""
    if not matrix.size:
        return matrix
    balanced, (scale, _) = scipy.linalg.matrix_balance(matrix, permute=False, separate=True)
    exponential: FloatArray = scale[:, None] * scipy.linalg.expm(balanced) / scale[None, :]
    return exponential


PADE_NORM = 5.371920351148152  # 1-norm up to which the [13/13] approximant is exact to round-off
PADE = np.array([math.comb(13, j) / math.perm(26, j) for j in range(14)])


def stacked_expm(matrices: FloatArray) -> FloatArray:
    """exp of each of many small matrices (k, n, n) at once, by the [13/13] Pade approximant with scaling and squaring.

    Source: Higham, The scaling and squaring method for the matrix exponential revisited, SIAM J. Matrix Anal. Appl. 26, 2005.
    """
    norm = abs(matrices).sum(axis=1).max(axis=1, initial=0.0)
    halvings = np.ceil(np.log2(np.maximum(norm / PADE_NORM, 1.0))).astype(int)
    A = matrices / 2.0 ** halvings[:, None, None]
    A2 = A @ A
    A4 = A2 @ A2
    A6 = A4 @ A2
    powers = (np.broadcast_to(np.eye(A.shape[1]), A.shape), A2, A4, A6)

    def polynomial(coefficients: FloatArray) -> FloatArray:
        """Of A2, degrees 0 to 6: those above 3 times A6."""
        low, high = coefficients[:4], coefficients[4:]
        top: FloatArray = np.sum([c * p for c, p in zip(high, powers[1:], strict=True)], axis=0)
        whole: FloatArray = A6 @ top + np.sum([c * p for c, p in zip(low, powers, strict=True)], axis=0)
        return whole

    even, odd = polynomial(PADE[::2]), A @ polynomial(PADE[1::2])
    out: FloatArray = np.linalg.solve(even - odd, even + odd)
    for k in range(int(halvings.max(initial=0))):
        again = halvings > k
        out[again] = out[again] @ out[again]
    return out


def mode_steps(omega: FloatArray, zeta: FloatArray, dt: float, hold: str) -> Step:
    """The one-step recursion of each mode eta'' + 2 zeta omega eta' + omega^2 eta = f.

    Exponential of the 3x3 (zero) or 4x4 (first) augmented matrix of all modes at once, in the states (s eta, dt eta') with
    s = max(1, omega dt): the norm then grows with omega dt, not with its square, and omega = 0 is an ordinary case.
    """
    check_hold(hold)
    size = 4 if hold == "first" else 3
    x = omega * dt
    s = np.maximum(1.0, x)
    augmented = np.zeros((omega.size, size, size))
    augmented[:, 0, 1], augmented[:, 1, 0], augmented[:, 1, 1] = s, -(x**2) / s, -2 * zeta * x
    augmented[:, 1, 2] = 1.0
    if hold == "first":
        augmented[:, 2, 3] = 1.0
    e = stacked_expm(augmented)
    unit = np.stack([1 / s, np.full_like(s, 1 / dt)], axis=1)
    columns = [e[:, :2, k] * unit * dt**2 for k in range(2, size)]
    return Step(mode_transitions(omega, zeta, dt), columns[0], columns[1] if hold == "first" else None)


def mode_transitions(omega: FloatArray, zeta: FloatArray, dt: float) -> FloatArray:
    """(n, 2, 2) exp([[0, 1], [-omega^2, -2 zeta omega]] dt) to the last digit or two: its error adds up over all steps.

    With x = omega dt and theta^2 = x^2 (1 - zeta^2): e^(-zeta x) [[c + zeta x s, dt s], [-omega x s, c - zeta x s]], where
    c = cos theta and s = sin theta / theta (cosh and sinh above critical damping), so nothing divides by omega or 1 - zeta.
    """
    x = omega * dt
    decay = zeta * x
    theta = x * np.sqrt(abs((1 - zeta) * (1 + zeta)))
    over = (zeta > 1) & (theta > 0)
    fast = np.where(over, np.exp(-theta - decay), 1.0)
    twice = np.where(over, 2 * theta, 1.0)
    slow = np.where(over, np.exp(-(x**2) / np.where(over, decay + theta, 1.0)), 1.0)
    growth = np.where(twice < 1, np.expm1(np.minimum(twice, 1.0)) * fast, slow - fast) / twice
    s = np.where(over, growth, np.exp(-decay) * np.sinc(theta / np.pi))
    c = np.where(over, 0.5 * (slow + fast), np.exp(-decay) * np.cos(theta))
    return np.stack([np.stack([c + decay * s, dt * s], -1), np.stack([-omega * x * s, c - decay * s], -1)], axis=1)


def _assembled(plant: ModalPlant, dt: float, hold: str) -> StateSpace:
    steps = mode_steps(plant.omega, plant.zeta, dt, hold)
    transition = np.block([[np.diag(steps.transition[:, i, j]) for j in (0, 1)] for i in (0, 1)])
    ramp = None if steps.ramp is None else _stacked(steps.ramp, plant.shape_in)
    dense = Step(transition, _stacked(steps.hold, plant.shape_in), ramp)
    position, velocity, D = output_rows(plant)
    empty = np.zeros((2 * plant.n_modes, len(plant.inputs)))
    rows = StateSpace(np.zeros_like(transition), empty, np.hstack([position, velocity]), D, **channels_of(plant))
    return _causal(rows, dense, dt)


def _stacked(column: FloatArray, shape_in: FloatArray) -> FloatArray:
    return np.vstack([column[:, i, None] * shape_in for i in (0, 1)])


def _causal(system: StateSpace, step: Step, dt: float) -> StateSpace:
    """Drop u[k+1] from the recursion by the change of state x - ramp u."""
    F, G, D = step.transition, step.hold, system.D
    if step.ramp is not None:
        G, D = G + F @ step.ramp - step.ramp, D + system.C @ step.ramp
    return StateSpace(F, G, system.C, D, dt=float(dt), **channels_of(system))
