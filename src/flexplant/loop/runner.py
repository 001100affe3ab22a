"""Preparing a simulation: the recursion of a system, its initial state, and what is refused or warned of before time advances."""

from __future__ import annotations

import warnings

import numpy as np
import numpy.typing as npt

from flexplant.errors import InputError, expect_choice
from flexplant.loop.cascade import Cascade, Simulated, cascade_of
from flexplant.loop.diagram import Diagram
from flexplant.loop.hybrid import hybrid_of
from flexplant.loop.hybrid_recursion import HybridRecursion
from flexplant.loop.loop_recursion import loop_poles, recursion_of
from flexplant.loop.monodromy import refuse_growing
from flexplant.loop.recursion import Runner
from flexplant.model.arrays import FloatArray, real_values
from flexplant.numerics.threads import one_thread

Initial = str | npt.ArrayLike | None
GROWTH = 1e-6  # real part (or distance from the unit circle) relative to the largest pole, below which round-off may cause it


def is_hybrid(system: Simulated) -> bool:
    """True for a diagram that is stepped sample by sample."""
    return isinstance(system, Diagram) and system.is_sampled


@one_thread
def runner_of(system: Simulated, dt: float, initial: Initial, hold: str, every: int, unstable: str) -> Runner:
    """The resumable recursion of a system from its initial state; see `simulate` for what is refused."""
    if isinstance(system, Diagram) and system.is_sampled:
        hybrid = hybrid_of(system)
        _check_choice(unstable)
        if unstable == "error":
            refuse_growing(hybrid, dt, system.name, GROWTH)
        warn_if_unresolved(hybrid.linear, dt)
        start = np.r_[np.zeros(hybrid.linear.n_states), hybrid.initial]
        given = initial_state(start.size, initial, start)
        return HybridRecursion(hybrid, dt, given, hold, every)
    cascade = checked_cascade(system, unstable)
    warn_if_unresolved(cascade, dt)
    return recursion_of(cascade, dt, initial_state(cascade.n_states, initial), hold, every)


def checked_cascade(system: Simulated, unstable: str) -> Cascade:
    """The cascade of a linear system; InputError with the pole for one that grows, unless unstable is "allow"."""
    _check_choice(unstable)
    cascade = cascade_of(system)
    if unstable == "error":
        _refuse_growth(cascade, system.name)
    return cascade


def _check_choice(unstable: str) -> None:
    expect_choice(unstable, ("error", "allow"), "unstable")


def _refuse_growth(cascade: Cascade, name: str) -> None:
    if not cascade.A.size:
        return
    poles = loop_poles(cascade)
    excess = poles.real if cascade.dt is None else abs(poles) - 1
    worst = int(np.argmax(excess))
    if excess[worst] <= GROWTH * abs(poles).max():
        return
    pole = poles[worst]
    if cascade.dt is None:
        hz, doubling = abs(pole.imag) / (2 * np.pi), np.log(2) / pole.real
        what = f"{pole.real:.6g} {abs(pole.imag):+.6g}i rad/s ({hz:.6g} Hz, doubles every {doubling:.3g} s)"
    else:
        what = f"z = {pole.real:.6g} {abs(pole.imag):+.6g}i, outside the unit circle"
    raise InputError(f"simulate: {name!r} is unstable: pole {what}; lower a gain, or set unstable='allow' to see it grow")


def warn_if_unresolved(cascade: Cascade, dt: float) -> None:
    """UserWarning where a mode turns by more than half a period in a step: the result is exact, but its motion is not seen."""
    omega = np.concatenate([cascade.omega, *(part.omega for part in cascade.inner)])
    fastest = float(omega.max(initial=0.0)) / (2 * np.pi)
    if fastest * dt > 0.5:
        warnings.warn(
            f"simulate: the time step {dt:.4g} s does not resolve the fastest mode ({fastest:.6g} Hz); its motion aliases: use"
            f" a step below {0.5 / fastest:.4g} s, or keep fewer modes",
            UserWarning,
            stacklevel=4,
        )


def initial_state(size: int, initial: Initial, rest: FloatArray | None = None) -> FloatArray:
    """(size,) initial state: "rest" (zeros, or the blocks' own), or the given one; InputError otherwise."""
    if initial is None or (isinstance(initial, str) and initial == "rest"):
        return np.zeros(size) if rest is None else rest
    if isinstance(initial, str):
        if initial == "steady_state":
            raise InputError(
                "initial='steady_state' needs a linear system and its inputs as Tones (see wheel_tones); samples have none"
            )
        raise InputError(f"initial={initial!r:.60}; use 'rest', 'steady_state' or an array of states")
    state = np.array(real_values(initial, "initial state"))
    if state.shape != (size,) or not np.isfinite(state).all():
        raise InputError(f"initial state of shape {state.shape}; {size} finite values are needed")
    return state
