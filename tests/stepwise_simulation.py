"""A plain time simulation by exact recursion, one step after the other: the peer of `flexplant.simulate` in the tests."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import xarray as xr

from flexplant.errors import InputError, nearest
from flexplant.model.arrays import FloatArray
from flexplant.plant.discretize import Step, mode_steps, step_of
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace, output_rows, state_space

Inputs: TypeAlias = npt.ArrayLike | Mapping[str, npt.ArrayLike] | xr.DataArray | None
BLOCK = 4096  # time steps whose modal forces and states are held at once


def simulate(
    plant: ModalPlant | StateSpace | Descriptor,
    time: npt.ArrayLike,
    inputs: Inputs = None,
    *,
    hold: str = "zero",
    initial_state: npt.ArrayLike | None = None,
) -> xr.Dataset:
    """Response to sampled inputs; exact for inputs constant ("zero") or linear ("first") between the samples.

    time: (nt,) uniform, seconds. inputs: (nu, nt) array; DataArray with dims input and time; a mapping from input names to
    (nt,) arrays or numbers (inputs left out are zero); or None. initial_state: [eta; eta'] of a ModalPlant, x of a StateSpace.
    Returns a Dataset: `outputs` (output, time), `inputs` (input, time), `final_state` (state,).
    A discrete StateSpace advances by its own recursion; its dt must be the step of `time`.
    Raises InputError for a time axis that is not uniform, unknown input names, wrong shapes, values that are not finite.
    """
    t, dt = _checked_time(time)
    u = _checked_inputs(inputs, plant.inputs, t.size)
    if isinstance(plant, ModalPlant) and plant.damping is None:
        outputs, state = _simulate_modal(plant, u, dt, hold, initial_state)
    else:
        outputs, state = _simulate_dense(state_space(plant), u, dt, hold, initial_state)
    return _dataset(plant, t, u, outputs, state)


def _checked_time(time: npt.ArrayLike) -> tuple[FloatArray, float]:
    t = np.asarray(time, dtype=float)
    if t.ndim != 1 or t.size < 2 or not np.isfinite(t).all():
        raise InputError(f"time must be a list of at least two finite instants in seconds, got shape {t.shape}")
    steps = np.diff(t)
    dt = float((t[-1] - t[0]) / (t.size - 1))
    worst = int(np.argmax(abs(steps - dt)))
    if dt <= 0 or abs(steps[worst] - dt) > 1e-6 * dt + 8 * np.finfo(float).eps * abs(t).max():
        raise InputError(
            f"time is not uniform and increasing: step {worst} is {steps[worst]:.9g} s, the mean step {dt:.9g} s; "
            "resample the inputs, for example with numpy.arange(n) * dt"
        )
    return t, dt


def _checked_inputs(inputs: Inputs, names: Any, nt: int) -> FloatArray:
    if isinstance(inputs, xr.DataArray):
        if set(inputs.dims) != {"input", "time"}:
            raise InputError(f"inputs: a DataArray needs the dims input and time, got {inputs.dims}")
        labels = [str(label) for label in inputs["input"].values] if "input" in inputs.coords else names
        inputs = dict(zip(labels, inputs.transpose("input", "time").values, strict=True))
    u = np.zeros((len(names), nt))
    if isinstance(inputs, Mapping):
        for name, values in inputs.items():
            if name not in names:
                raise InputError(f"inputs: no input {name!r}." + nearest(str(name), names))
            u[list(names).index(name)] = _checked_signal(values, nt, f"input {name!r}")
    elif inputs is not None:
        given = np.asarray(inputs, dtype=float)
        given = given[None, :] if given.ndim == 1 and len(names) == 1 else given
        if given.shape != u.shape:
            raise InputError(f"inputs have shape {given.shape}, but ({len(names)} inputs, {nt} instants) is needed")
        u[:] = given
    if not np.isfinite(u).all():
        raise InputError(f"inputs: {names[int(np.argwhere(~np.isfinite(u))[0, 0])]!r} has values that are not finite")
    return u


def _checked_signal(values: npt.ArrayLike, nt: int, what: str) -> FloatArray:
    signal = np.asarray(values, dtype=float)
    if signal.shape not in ((), (nt,)):
        raise InputError(f"{what} has shape {signal.shape}, but one number or ({nt},) values are needed")
    return signal


def _checked_state(state: npt.ArrayLike | None, n: int) -> FloatArray:
    x = np.zeros(n) if state is None else np.array(state, dtype=float)
    if x.shape != (n,) or not np.isfinite(x).all():
        raise InputError(f"initial_state must be {n} finite numbers, got shape {x.shape}")
    return x


def _drive(step: Step, u: FloatArray, start: int, stop: int) -> FloatArray:
    """(stop - start, ...) contribution of the inputs to x[k+1] for k = start .. stop - 1."""
    driven = u[:, start:stop].T @ step.hold.T
    return driven if step.ramp is None else driven + (u[:, start + 1 : stop + 1] - u[:, start:stop]).T @ step.ramp.T


def _simulate_dense(
    system: StateSpace, u: FloatArray, dt: float, hold: str, state: npt.ArrayLike | None
) -> tuple[FloatArray, FloatArray]:
    step = _dense_step(system, dt, hold)
    nt, x = u.shape[1], _checked_state(state, system.n_states)
    outputs = system.D @ u
    for start in range(0, nt, BLOCK):
        stop = min(start + BLOCK, nt)
        steps = min(stop, nt - 1) - start
        driven = _drive(step, u, start, start + steps)
        history = np.empty((stop - start, x.size))
        for k in range(stop - start):
            history[k] = x
            if k < steps:
                x = step.transition @ x + driven[k]
        outputs[:, start:stop] += system.C @ history.T
    return outputs, x


def _dense_step(system: StateSpace, dt: float, hold: str) -> Step:
    if system.dt is None:
        return step_of(system, dt, hold)
    if abs(system.dt - dt) > 1e-6 * dt:
        raise InputError(f"state space {system.name!r} has dt = {system.dt} s, but time advances by {dt:.9g} s")
    return Step(system.A, system.B, None)


def _simulate_modal(
    plant: ModalPlant, u: FloatArray, dt: float, hold: str, state: npt.ArrayLike | None
) -> tuple[FloatArray, FloatArray]:
    """Two-state recursions of all modes at once; one pass of the time loop costs four array operations."""
    steps = mode_steps(plant.omega, plant.zeta, dt, hold)
    position, velocity, direct = output_rows(plant)
    n, nt = plant.n_modes, u.shape[1]
    x = _checked_state(state, 2 * n).reshape(2, n)
    from_position, from_velocity = steps.transition[:, :, 0].T.copy(), steps.transition[:, :, 1].T.copy()
    outputs = direct @ u
    for start in range(0, nt, BLOCK):
        stop = min(start + BLOCK, nt)
        count = min(stop, nt - 1) - start
        force = (plant.shape_in @ u[:, start : start + count + 1]).T
        history = np.empty((count + 1, 2, n))
        history[0] = x
        history[1:] = _modal_drive(steps, force, count)
        for k in range(count):
            history[k + 1] += from_position * history[k, 0] + from_velocity * history[k, 1]
        x = history[count]
        here = history[: stop - start]
        outputs[:, start:stop] += position @ here[:, 0].T + velocity @ here[:, 1].T
    return outputs, x.ravel()


def _modal_drive(steps: Step, force: FloatArray, count: int) -> FloatArray:
    """(count, 2, n) contribution of the modal forces to the next state."""
    driven = force[:count, None, :] * steps.hold.T
    if steps.ramp is not None:
        driven += np.diff(force, axis=0)[:count, None, :] * steps.ramp.T
    return driven


def _dataset(
    plant: ModalPlant | StateSpace | Descriptor, t: FloatArray, u: FloatArray, outputs: FloatArray, state: FloatArray
) -> xr.Dataset:
    return xr.Dataset(
        {
            "outputs": (("output", "time"), outputs),
            "inputs": (("input", "time"), u),
            "final_state": (("state",), state),
        },
        coords={
            "time": ("time", t, {"units": "s"}),
            "output": list(plant.outputs),
            "input": list(plant.inputs),
            "output_units": ("output", list(plant.output_units)),
            "input_units": ("input", list(plant.input_units)),
        },
        attrs={"plant": plant.name},
    )
