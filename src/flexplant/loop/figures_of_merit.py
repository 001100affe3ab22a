"""What a loop's curves are read for: resonance peak, bandwidth, where a curve crosses a level, margins per axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.optimize

from flexplant.errors import InputError, nearest
from flexplant.loop.frequency import Linear, frequency_response
from flexplant.loop.line_of_sight import LineOfSight, closed_loop_transfer, loop_gain, output_sensitivity
from flexplant.model.arrays import FloatArray

HALF_POWER = np.sqrt(0.5)  # what "-3 dB" means in a bandwidth: -3.0103 dB
GRID_PER_DECADE = 400
ACCURACY = 1e-12


def magnitude_peak(system: Linear, output: str, input_name: str, band_hz: tuple[float, float]) -> tuple[float, float]:
    """(frequency in Hz, magnitude) of the largest |G| of one channel in the band; refined beyond the grid to about 1e-8."""
    grid = _grid(band_hz)
    value = _channel(system, output, input_name)
    k = int(np.argmax(value(grid)))
    low, high = grid[max(k - 1, 0)], grid[min(k + 1, grid.size - 1)]
    found = scipy.optimize.minimize_scalar(
        lambda x: -float(value(np.array([x]))[0]), bounds=(low, high), method="bounded", options={"xatol": 1e-9 * high}
    )
    return float(found.x), -float(found.fun)


def level_crossings(system: Linear, output: str, input_name: str, level: float, band_hz: tuple[float, float]) -> FloatArray:
    """Frequencies in Hz, ascending, where |G| of one channel passes `level` in the band; empty if it never does.

    Bracketed on a logarithmic grid of 400 points a decade, then refined; a pair of crossings inside one grid step is missed.
    """
    grid = _grid(band_hz)
    value = _channel(system, output, input_name)
    above = value(grid) >= level
    found = [
        scipy.optimize.brentq(lambda x: float(value(np.array([x]))[0]) - level, grid[k], grid[k + 1], xtol=ACCURACY * grid[k])
        for k in np.flatnonzero(above[1:] != above[:-1])
    ]
    return np.array(found, dtype=float)


def _grid(band_hz: tuple[float, float]) -> FloatArray:
    low, high = band_hz
    if not 0 < low < high < np.inf:
        raise InputError(f"frequency band {band_hz!r} Hz; give (low, high) with 0 < low < high")
    return np.geomspace(low, high, int(GRID_PER_DECADE * np.log10(high / low)) + 2)


def _channel(system: Linear, output: str, input_name: str) -> Callable[[FloatArray], npt.NDArray[np.float64]]:
    for name, known, side in ((output, list(system.outputs), "output"), (input_name, list(system.inputs), "input")):
        if name not in known:
            raise InputError(f"no {side} {name!r}." + nearest(name, known))
    row, column = list(system.outputs).index(output), list(system.inputs).index(input_name)
    return lambda hz: np.asarray(abs(frequency_response(system, hz).values[row, column]))


@dataclass(frozen=True, kw_only=True)
class LoopFigures:
    """One axis of the line-of-sight loop in numbers.

    peak_hz, peak: largest closed-loop magnitude. bandwidth_hz: last crossing of half power (-3 dB) by the closed loop.
    rejection_hz: first one by the output sensitivity, which stays below up to there. crossover_hz: |L| = 1.
    phase_margin_deg: 180 + phase of L there, the smallest of several.
    NaN where a curve does not cross half power.
    """

    axis: str
    peak_hz: float
    peak: float
    bandwidth_hz: float
    rejection_hz: float
    crossover_hz: float
    phase_margin_deg: float


def loop_figures(los: LineOfSight) -> list[LoopFigures]:
    """The figures of each axis, read from the curves of `closed_loop_transfer`, `output_sensitivity` and `loop_gain`.

    Raises InputError for a loop gain that never reaches one (no crossover), where these figures mean nothing.
    """
    return [_axis_figures(los, k, axis) for k, axis in enumerate(los.axes)]


def _axis_figures(los: LineOfSight, k: int, axis: str) -> LoopFigures:
    omega, gain = np.asarray(los.mirror_omega)[k], np.asarray(los.gain)[k]
    natural_hz = omega * np.sqrt(1 + abs(gain)) / (2 * np.pi)
    band = (1e-3 * natural_hz, 1e2 * natural_hz)
    L, T, S = loop_gain(los), closed_loop_transfer(los), output_sensitivity(los)
    crossover = level_crossings(L, f"angle_{axis}", f"error_{axis}", 1.0, band)
    if not crossover.size:
        raise InputError(f"line of sight, axis {axis}: the loop gain never reaches one (Kp = {gain:g}); raise the gain")
    peak_hz, peak = magnitude_peak(T, f"angle_{axis}", f"command_{axis}", band)
    at_crossover = frequency_response(L, crossover).values[k, k]
    margins = np.degrees(np.angle(-at_crossover))  # 180 + phase, folded to (-180, 180]
    return LoopFigures(
        axis=axis,
        peak_hz=peak_hz,
        peak=peak,
        bandwidth_hz=_at(level_crossings(T, f"angle_{axis}", f"command_{axis}", HALF_POWER, band), -1),
        rejection_hz=_at(level_crossings(S, f"spot_{axis}", f"displacement_{axis}", HALF_POWER, band), 0),
        crossover_hz=float(crossover[-1]),
        phase_margin_deg=float(margins[np.argmin(abs(margins))]),
    )


def _at(values: FloatArray, k: int) -> float:
    return float(values[k]) if values.size else float("nan")
