"""Time simulation of plants, blocks and loops by their exact recursion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import xarray as xr

from flexplant.blocks.tones import Tones, summed, tone_signal
from flexplant.errors import InputError, expect_count, expect_function, nearest
from flexplant.loop.cascade import Cascade, Simulated, simulated
from flexplant.loop.labels import coordinates
from flexplant.loop.loop_recursion import recursion_of
from flexplant.loop.recursion import Progress, march
from flexplant.loop.runner import Initial, checked_cascade, initial_state, is_hybrid, runner_of
from flexplant.loop.signals import Signals, checked_time, sampled
from flexplant.loop.steady import input_amplitudes, output_amplitudes, steady_states
from flexplant.model.arrays import FloatArray
from flexplant.numerics.threads import one_thread
from flexplant.plant.channels import listed_names


@one_thread
def simulate(
    system: Simulated,
    time: npt.ArrayLike,
    inputs: Signals | Tones = None,
    *,
    outputs: Sequence[str] | None = None,
    initial: Initial = None,
    hold: str = "first",
    every: int = 1,
    progress: Progress = None,
    unstable: str = "error",
) -> xr.Dataset:
    """Response of a plant, a block or a whole Diagram, open or closed, at the instants `time` (uniform, seconds).

    inputs: (nw, nt) samples, a mapping input name -> (nt,) values or a number, a DataArray (input, time), or `Tones`; inputs
    left out are zero. Samples are joined by a hold: "first" (straight lines, error O(dt^2) for a smooth input) or "zero" (steps,
    O(dt)); the response to the held input is exact at any dt, rigid-body modes and the motion of a plant within the step
    included. Tones need no hold: their steady state is known in closed form and only the free motion is stepped.
    initial: None or "rest"; the state in the order of `close(diagram)` or `state_space(plant)`; or "steady_state" (Tones only):
    start on the harmonic steady state, so that no settling has to be simulated (rigid-body modes then do not drift).
    outputs: names to keep, all by default. every: keep each every-th sample of the outputs, counted from the first.
    progress: called with (samples done, samples) after each chunk of some thousand steps; what it raises stops the simulation.
    unstable: "error" refuses a system with a growing pole before time advances and names it; "allow" steps it until it overflows.

    A diagram with sampled blocks (nonlinear ones, digital controllers of their own sample time): each reads its inputs at its
    samples and holds its outputs in between; the linear rest moves exactly under them. Exact for digital blocks, first order
    in the step for a nonlinear block that stands for a continuous law. Tones are then sampled, and start from rest.

    BLAS is limited to one thread meanwhile, so that a result does not depend on how many there are.

    Returns a Dataset: `outputs` (output, time; or output_time where every > 1), `inputs` (input, time), `final_state` (state).
    Its attribute `stepping` says how a linear system moved: in modes of the structure, of the loop, or as a dense block, and why.
    Raises InputError for a time axis that is not uniform, unknown names, wrong shapes, a steady state that does not exist, an
    unstable system. Warns where samples are further apart than half a period of the fastest mode.
    """
    t, dt = checked_time(time)
    _check_every(every)
    expect_function(progress, "simulate: progress", "samples done, samples")
    names = list(simulated(system).inputs)
    kept = _kept(outputs, list(system.outputs))
    rows = [list(system.outputs).index(k) for k in kept]
    how: dict[str, str] = {}
    if isinstance(inputs, Tones) and not is_hybrid(system):
        cascade = checked_cascade(system, unstable)
        z, w, final = _under_tones(cascade, names, t, dt, inputs, initial, hold)
        z = z[:, ::every]
    else:
        w = _tone_samples(inputs, names, t) if isinstance(inputs, Tones) else sampled(inputs, names, t.size)
        runner = runner_of(system, dt, initial, hold, every, unstable)
        run = march(runner, w, t.size, (len(names), len(system.outputs)), every, progress)
        z, final = run.outputs, run.final_state
        how = {
            "stepping": getattr(runner, "stepping", ""),
            "called_in_python": ", ".join(getattr(runner, "called_in_python", [])),
        }
    z = z if rows == list(range(len(z))) else z[rows]
    result = _dataset(system, t, w, z, kept, final, every)
    result.attrs.update({key: text for key, text in how.items() if text})
    return result


def _check_every(every: int) -> None:
    expect_count(every, "every (keep each every-th sample)", least=1)


def _tone_samples(tones: Tones, names: list[str], t: FloatArray) -> FloatArray:
    return tone_signal(Tones(frequency_hz=tones.frequency_hz, amplitude=input_amplitudes(tones, names), inputs=names), t)


def _under_tones(
    cascade: Cascade, names: list[str], t: FloatArray, dt: float, tones: Tones, initial: Initial, hold: str
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Outputs, inputs and final state: the steady state, plus the free motion of what the start is off it."""
    amplitude = input_amplitudes(tones, names)
    states = steady_states(cascade, tones.frequency_hz, amplitude)
    order = np.r_[cascade.modal_states, cascade.other_states]
    first, last = np.zeros((2, cascade.n_states))
    for state, instant in ((first, t[0]), (last, t[-1])):
        state[order] = (states * np.exp(2j * np.pi * tones.frequency_hz * instant)).real.sum(axis=1)
    z = summed(output_amplitudes(cascade, states, amplitude), tones.frequency_hz, t)
    if not (isinstance(initial, str) and initial == "steady_state"):
        recursion = recursion_of(cascade, dt, initial_state(cascade.n_states, initial) - first, hold)
        free = march(recursion, None, t.size, (len(names), cascade.D.shape[0]))
        z, last = z + free.outputs, last + free.final_state
    return z, summed(amplitude, tones.frequency_hz, t), last


def _kept(outputs: Sequence[str] | None, known: list[str]) -> list[str]:
    kept = known if outputs is None else [outputs] if isinstance(outputs, str) else listed_names(outputs, "simulate: outputs")
    for name in kept:
        if name not in known:
            raise InputError(f"simulate: no output {name!r:.60}." + nearest(name, known))
    return kept


def _dataset(
    system: Simulated, t: FloatArray, w: FloatArray, z: FloatArray, kept: list[str], final: FloatArray, every: int
) -> xr.Dataset:
    units = dict(zip(system.outputs, system.output_units, strict=True))
    at = "time" if every == 1 else "output_time"
    times: dict[str, npt.ArrayLike] = {"time": t} if every == 1 else {"time": t, "output_time": t[::every]}
    labels = {**times, "output": kept, "input": list(system.inputs)}
    return xr.Dataset(
        {"outputs": (("output", at), z), "inputs": (("input", "time"), w), "final_state": (("state",), final)},
        coords=coordinates([units[name] for name in kept], system.input_units, **labels),
        attrs={"plant": system.name},
    )
