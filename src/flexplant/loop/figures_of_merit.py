"""What the curves of the line-of-sight loop are read for: resonance peak, bandwidth, rejection, margins, axis by axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexplant.errors import InputError
from flexplant.loop.line_of_sight import LineOfSight, closed_loop_transfer, loop_gain, output_sensitivity
from flexplant.model.arrays import FloatArray
from flexplant.response.margins import crossing_hz, margins

HALF_POWER_DB = 10 * np.log10(0.5)  # what "-3 dB" means in a bandwidth: -3.0103


@dataclass(frozen=True, kw_only=True)
class LoopFigures:
    """One axis of the line-of-sight loop in numbers.

    peak_hz, peak: largest closed-loop magnitude. bandwidth_hz: last crossing of half power (-3 dB) by the closed loop.
    rejection_hz: frequency up to which the output sensitivity stays below half power. crossover_hz: |L| = 1, the last one.
    phase_margin_deg: 180 + phase of L there, the smallest in size of several. NaN where a curve has no such point.
    """

    axis: str
    peak_hz: float
    peak: float
    bandwidth_hz: float
    rejection_hz: float
    crossover_hz: float
    phase_margin_deg: float


def loop_figures(los: LineOfSight) -> list[LoopFigures]:
    """The figures of each axis, read from `loop_gain`, `closed_loop_transfer` and `output_sensitivity`; exact, not from a grid.

    Raises InputError for a loop gain that never reaches one (no crossover), where these figures mean nothing.
    """
    if not isinstance(los, LineOfSight):
        raise InputError(f"loop_figures needs a LineOfSight, got {type(los).__name__}; loop_response takes any Diagram")
    return [_axis_figures(_one_axis(los, k)) for k in range(len(los.axes))]


def _one_axis(los: LineOfSight, k: int) -> LineOfSight:
    gain, omega, zeta = (np.asarray(values)[k] for values in (los.gain, los.mirror_omega, los.mirror_zeta))
    return LineOfSight(focal_length=los.focal_length, gain=gain, mirror_omega=omega, mirror_zeta=zeta, axes=[los.axes[k]])


def _axis_figures(los: LineOfSight) -> LoopFigures:
    axis = los.axes[0]
    loop = margins(loop_gain(los))
    crossover = loop.loops[0].gain_crossings_hz
    if not crossover.size:
        gain = float(np.asarray(los.gain)[0])
        raise InputError(f"line of sight, axis {axis}: the loop gain never reaches one (Kp = {gain:g}); raise the gain")
    return LoopFigures(
        axis=axis,
        peak_hz=loop.complementary_peak.frequency_hz,
        peak=loop.complementary_peak.value,
        bandwidth_hz=_at(crossing_hz(closed_loop_transfer(los), HALF_POWER_DB), -1),
        rejection_hz=_rejection(los),
        crossover_hz=float(crossover[-1]),
        phase_margin_deg=loop.phase_margin_deg,
    )


def _rejection(los: LineOfSight) -> float:
    """First crossing by 1 / (1 + L), if it starts below at 0 Hz, where L = Kp."""
    starts_below = 1 / abs(1 + np.asarray(los.gain)[0]) < np.sqrt(0.5)
    return _at(crossing_hz(output_sensitivity(los), HALF_POWER_DB), 0) if starts_below else float("nan")


def _at(values: FloatArray, k: int) -> float:
    return float(values[k]) if values.size else float("nan")
