"""Blocks evaluated sample by sample: saturation, dead zone, quantiser, rate limiter, and a function of the user's own.

In a simulation every such block reads its inputs at a sample and holds its outputs until the next one it is evaluated at
(every step, or every `dt` seconds). That is exact for a digital device of that sample time; for a block that stands for a
continuous law the error is of first order in the step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from flexplant.errors import InputError, expect_count, expect_text
from flexplant.model.arrays import FloatArray, is_finite, real_values
from flexplant.numerics.compiled import is_compiled, with_checked_indices
from flexplant.plant.fields import checked_names, checked_units

UserFunction = Callable[[float, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
SATURATION, DEAD_ZONE, QUANTISER, RATE_LIMITER, USER = "saturation", "dead zone", "quantiser", "rate limiter", "function"
MAX_CHANNELS = 1_000_000
FAULTS = (ArithmeticError, AssertionError, AttributeError, LookupError, NameError, RuntimeError, TypeError, ValueError)


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledBlock:
    """y = law(u, state) at its samples, held in between.

    kind: one of the laws above. low, high: (ny,) limits of each channel (quantiser: low is the step; rate limiter: change per
    second). function: (t, u, state) -> (y, new state), for kind "function"; own: what it was made of, (t, u) -> y or, with
    takes_state, (t, u, state) -> (y, new state). initial: state at the start. dt: seconds between evaluations, or None for every
    step. inputs, outputs: distinct names. Raises ModelError for names or units that do not fit.
    """

    kind: str
    inputs: Sequence[str]
    outputs: Sequence[str]
    low: FloatArray
    high: FloatArray
    function: UserFunction | None = None
    own: Callable[..., object] | None = None
    takes_state: bool = False
    initial: FloatArray
    dt: float | None = None
    name: str = "block"
    input_units: Sequence[str] = ()
    output_units: Sequence[str] = ()

    def __post_init__(self) -> None:
        expect_text(self.name, f"{self.kind}: name")
        owner = f"{self.kind} {self.name!r:.60}"
        for side in ("inputs", "outputs"):
            names = checked_names(getattr(self, side), side, owner)
            object.__setattr__(self, side, names)
            units = f"{side[:-1]}_units"
            object.__setattr__(self, units, checked_units(getattr(self, units), len(names), units, owner))
        if self.dt is not None and not (is_finite(self.dt) and self.dt > 0):
            raise InputError(f"{owner}: dt = {self.dt!r:.60}; use None for every step, or a positive number of seconds")

    @property
    def n_states(self) -> int:
        """Number of states."""
        return int(self.initial.size)


def saturation(
    low: npt.ArrayLike, high: npt.ArrayLike, *, channels: int = 1, name: str = "saturation", unit: str = ""
) -> SampledBlock:
    """y = min(max(u, low), high) a channel. Ports "u", "y", or "u1", ... "y1", ... InputError for low > high."""
    return _law(SATURATION, low, high, channels, name, unit)


def dead_zone(
    low: npt.ArrayLike, high: npt.ArrayLike, *, channels: int = 1, name: str = "dead_zone", unit: str = ""
) -> SampledBlock:
    """y = 0 for low <= u <= high, u - high above, u - low below. Ports as for `saturation`. InputError for low > high."""
    return _law(DEAD_ZONE, low, high, channels, name, unit)


def quantiser(
    step: npt.ArrayLike, *, channels: int = 1, dt: float | None = None, name: str = "quantiser", unit: str = ""
) -> SampledBlock:
    """y = step * floor(u / step + 1/2), at every step or every dt seconds. InputError for a step that is not positive."""
    size = real_values(step, f"quantiser {name!r:.60}: step")
    if not (np.isfinite(size) & (size > 0)).all():
        raise InputError(f"quantiser {name!r:.60}: step {step!r:.60} must be positive and finite")
    return _law(QUANTISER, step, step, channels, name, unit, dt=dt)


def rate_limiter(
    fall: npt.ArrayLike, rise: npt.ArrayLike, *, channels: int = 1, name: str = "rate_limiter", unit: str = ""
) -> SampledBlock:
    """y follows u from 0, by at most `rise` up and `fall` (negative) down per second. InputError unless fall < 0 < rise."""
    down, up = (real_values(value, f"rate limiter {name!r:.60}: fall and rise") for value in (fall, rise))
    if not ((down < 0).all() and (up > 0).all()):
        raise InputError(
            f"rate limiter {name!r:.60}: fall {fall!r:.60} and rise {rise!r:.60}; give fall < 0 < rise, units per second"
        )
    return _law(RATE_LIMITER, fall, rise, channels, name, unit, remembers=True)


def user_block(
    function: Callable[..., object],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    initial: npt.ArrayLike | None = None,
    dt: float | None = None,
    name: str = "function",
    input_units: Sequence[str] = (),
    output_units: Sequence[str] = (),
) -> SampledBlock:
    """y = function(t, u); with `initial`, (y, new state) = function(t, u, state). u, y, state are 1-D arrays; t is in seconds.

    A function that is decorated with numba.njit is compiled into the loop; so is, in each run of thousands of samples, any other
    that numba can compile (it must not change anything outside itself). The rest is called in Python at each of its samples, tens
    of microseconds a call; the result's attribute `called_in_python` names those. Compiled or not, indices are checked against
    the arrays (in compiled functions that it calls, numba checks them only where they ask for it). Raises InputError naming the
    block and the instant where the function raises an error, or returns a wrong shape or values that are not finite.
    """
    if not callable(function):
        raise InputError(f"user block {name!r:.60}: {function!r:.60} cannot be called; give function(t, u) -> y")
    outputs = checked_names(outputs, "outputs", f"user block {name!r:.60}")
    state = np.zeros(0) if initial is None else np.atleast_1d(np.array(real_values(initial, f"user block {name!r:.60}: initial")))
    if state.ndim != 1 or not np.isfinite(state).all():
        raise InputError(f"user block {name!r:.60}: initial of shape {state.shape}; a list of finite numbers is needed")
    stateless = initial is None
    law = _checked_law(function) if is_compiled(function) else function

    def respond(t: float, u: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        try:
            found = (law(t, u), x) if stateless else law(t, u, x)
        except FAULTS as error:
            raise InputError(
                f"user block {name!r} at t = {t:.9g} s: the function raised {type(error).__name__}: {error}"
            ) from error
        return _checked_response(found, (len(outputs), x.size), name, t)

    none = np.zeros(len(outputs))
    return SampledBlock(
        kind=USER,
        inputs=inputs,
        outputs=outputs,
        low=none,
        high=none,
        function=respond,
        own=law,
        takes_state=not stateless,
        initial=state,
        dt=dt,
        name=name,
        input_units=input_units,
        output_units=output_units,
    )


_checked_law = lru_cache(maxsize=64)(with_checked_indices)  # so that blocks of one function share what is compiled


def _checked_response(found: object, sizes: tuple[int, int], name: str, t: float) -> tuple[FloatArray, FloatArray]:
    if not isinstance(found, tuple) or len(found) != 2:
        raise InputError(f"user block {name!r} at t = {t:.9g} s: return (y, new state), got {type(found).__name__}")
    if found[0] is None or found[1] is None:
        raise InputError(f"user block {name!r} at t = {t:.9g} s: the function returned None; return values on every path")
    y, x = (np.atleast_1d(real_values(part, f"user block {name!r} at t = {t:.9g} s: returned")) for part in found)
    if (y.shape, x.shape) != ((sizes[0],), (sizes[1],)):
        raise InputError(
            f"user block {name!r} at t = {t:.9g} s: shapes {y.shape}, {x.shape} for ({sizes[0]},) outputs, ({sizes[1]},) states"
        )
    if not (np.isfinite(y).all() and np.isfinite(x).all()):
        raise InputError(f"user block {name!r} at t = {t:.9g} s: returned values that are not finite: {y}")
    return y, x


def _law(
    kind: str,
    low: npt.ArrayLike,
    high: npt.ArrayLike,
    channels: int,
    name: str,
    unit: str,
    *,
    remembers: bool = False,
    dt: float | None = None,
) -> SampledBlock:
    owner = f"{kind} {name!r:.60}"
    expect_count(channels, f"{owner}: channels", least=1, most=MAX_CHANNELS)
    given = [real_values(value, f"{owner}: limits") for value in (low, high)]
    if any(value.shape not in ((), (1,), (channels,)) for value in given):
        raise InputError(f"{owner}: limits {low!r:.60}, {high!r:.60} for {channels} channels; give one value or one a channel")
    bounds = [np.broadcast_to(value, (channels,)).copy() for value in given]
    if np.isnan(bounds).any() or (bounds[0] > bounds[1]).any():
        raise InputError(f"{owner}: limits {low!r:.60} to {high!r:.60}; the lower one must not exceed the upper one")
    ports = [""] if channels == 1 else [str(k) for k in range(1, channels + 1)]
    return SampledBlock(
        kind=kind,
        inputs=[f"u{k}" for k in ports],
        outputs=[f"y{k}" for k in ports],
        low=bounds[0],
        high=bounds[1],
        initial=np.zeros(channels if remembers else 0),
        dt=dt,
        name=name,
        input_units=[unit] * channels,
        output_units=[unit] * channels,
    )
