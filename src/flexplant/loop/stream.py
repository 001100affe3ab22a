"""Long simulations in pieces: bounded memory, whatever the consumer does with each piece."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import xarray as xr

from flexplant.blocks.tones import Tones, tone_signal
from flexplant.errors import InputError, expect_count, expect_function
from flexplant.loop.cascade import Simulated, simulated
from flexplant.loop.recursion import Progress, Runner, chunks
from flexplant.loop.runner import Initial, runner_of
from flexplant.loop.signals import Signals, sampled
from flexplant.loop.steady import input_amplitudes
from flexplant.model.arrays import FloatArray, is_finite

Source = Tones | Callable[[FloatArray], Signals] | None


def simulate_stream(
    system: Simulated,
    *,
    dt: float,
    samples: int,
    inputs: Source = None,
    start: float = 0.0,
    initial: Initial = None,
    hold: str = "first",
    every: int = 1,
    piece: int = 100_000,
    progress: Progress = None,
    unstable: str = "error",
) -> Iterator[xr.Dataset]:
    """The simulation of `simulate` at start + k dt, k < samples, yielded piece by piece: memory does not grow with its length.

    inputs: a function of the instants (nt,) of a piece that gives what `simulate` takes ((nw, nt) samples, a mapping, a
    DataArray), or Tones (sampled). It is asked for one instant beyond each piece, for the first-order hold. piece: input samples
    a Dataset covers, rounded up to a multiple of `every`. Each Dataset: `outputs` (output, time) at the kept samples,
    `final_state` (state) at the instant `final_time`, where the next piece begins (after the last: at its last sample).
    `write_results` takes the pieces as they come; progress is called with (samples done, samples) after each. Stop by leaving
    the loop or by Ctrl-C; what was yielded is complete. A linear system goes on from there with start=float(piece.final_time),
    initial=piece.final_state.values.
    Raises InputError as `simulate` does, before the first piece where it can.
    """
    names = list(simulated(system).inputs)
    if not (is_finite(dt) and dt > 0 and is_finite(start)):
        raise InputError(f"simulate_stream: dt = {dt!r:.60} must be positive and start = {start!r:.60} finite, seconds")
    for name, count, least in (("samples", samples, 2), ("every", every, 1), ("piece", piece, 1)):
        expect_count(count, f"simulate_stream: {name}", least=least)
    runner = runner_of(system, dt, initial, hold, every, unstable)
    expect_function(progress, "simulate_stream: progress", "samples done, samples")
    source = _source(inputs, names)
    piece = -(-piece // every) * every
    return _reported(_pieces(system, runner, source, dt, samples, start, every, piece), piece, samples, progress)


def _reported(pieces: Iterator[xr.Dataset], piece: int, samples: int, progress: Progress) -> Iterator[xr.Dataset]:
    """The pieces; each is said to be done when the next one is asked for, so that it is out of the consumer's hands."""
    for number, found in enumerate(pieces, 1):
        yield found
        if progress is not None:
            progress(min(number * piece, samples), samples)


def _pieces(
    system: Simulated,
    runner: Runner,
    source: Callable[[FloatArray], FloatArray],
    dt: float,
    samples: int,
    start: float,
    every: int,
    piece: int,
) -> Iterator[xr.Dataset]:
    for first, stop in chunks(samples, piece):
        last = stop == samples
        t: FloatArray = start + dt * np.arange(first, stop if last else stop + 1, dtype=float)
        w = source(t)
        parts = []
        for a, b in chunks(t.size - 1, runner.chunk):
            parts.append(runner.run(w[a : b + 1], b - a))
        if last and (samples - 1) % every == 0:
            parts.append(runner.last(w[-1])[None])
        kept = t[: stop - first : every]
        yield xr.Dataset(
            {
                "outputs": (("output", "time"), np.vstack(parts).T),
                "final_state": (("state",), runner.whole_state),
                "final_time": ((), t[-1], {"units": "s"}),
            },
            coords={
                "time": ("time", kept, {"units": "s"}),
                "output": list(system.outputs),
                "output_units": ("output", list(system.output_units)),
            },
            attrs={"plant": system.name},
        )


def _source(inputs: Source, names: list[str]) -> Callable[[FloatArray], FloatArray]:
    """Instants -> (nt, nw) samples."""
    if isinstance(inputs, Tones):
        tones = Tones(frequency_hz=inputs.frequency_hz, amplitude=input_amplitudes(inputs, names), inputs=names)
        return lambda t: tone_signal(tones, t).T
    if inputs is not None and not callable(inputs):
        raise InputError("simulate_stream: inputs must be a function of the instants, Tones or None; arrays fit `simulate`")
    return lambda t: sampled(None if inputs is None else inputs(t), names, t.size).T
