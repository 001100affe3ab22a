"""Figures 7 to 9: what the wheel does to the spot, open and closed loop."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flexplant.blocks.wheel import Wheel, wheel_tones
from flexplant.errors import StudyError, nearest
from flexplant.loop.diagram import Diagram
from flexplant.loop.figures_of_merit import LoopFigures, loop_figures
from flexplant.loop.frequency import frequency_response
from flexplant.loop.harmonic import wheel_speed_sweep
from flexplant.loop.line_of_sight import LineOfSight, closed_loop_transfer, line_of_sight_diagram, output_sensitivity
from flexplant.loop.simulate import simulate
from flexplant.model.arrays import FloatArray
from flexplant.plant.modal import ModalPlant, select
from flexplant.response.norms import singular_values
from flexplant.study.grid import frequency_grid
from flexplant.study.result import LineOfSightResult
from flexplant.study.schema_line_of_sight import LineOfSightSpec, SweepSpec
from flexplant.verification import Table

CASES = ("open loop", "closed loop")
SPOT = ("spot_x", "spot_y")
LOOP_BAND = (0.95, 1.05)  # times the loop's own peak frequency


def line_of_sight(spec: LineOfSightSpec, plant: ModalPlant) -> LineOfSightResult:
    """Singular values, loop curves, time histories and the sweep over wheel speed."""
    parameters = LineOfSight(
        focal_length=spec.optics.focal_length_m,
        gain=spec.controller.proportional_gain,
        mirror_omega=spec.optics.mirror_omega_rad_s,
        mirror_zeta=spec.optics.mirror_zeta,
    )
    wheel = _wheel(spec, plant)
    seen = select(plant, inputs=list(wheel.inputs), outputs=[spec.optics.x, spec.optics.y])
    loops = {case: line_of_sight_diagram(parameters, seen, closed=case == "closed loop") for case in CASES}
    figures = loop_figures(parameters)
    hz = frequency_grid(spec.frequency, seen, also=tuple((f.peak_hz, 1 / (2 * f.peak)) for f in figures))
    gains = {case: singular_values(frequency_response(loop, hz)) for case, loop in loops.items()}
    histories = _histories(spec, wheel, loops)
    whole, own = _flexible_band(seen, hz), (LOOP_BAND[0] * figures[0].peak_hz, LOOP_BAND[1] * figures[0].peak_hz)
    peaks = {case: _peak(values, whole) for case, values in gains.items()}
    loop_peaks = {case: _peak(values, own) for case, values in gains.items()}
    contribution = contributions(plant, list(wheel.inputs), spec)
    return LineOfSightResult(
        parameters=parameters,
        wheel=wheel,
        singular_values=gains,
        peak_gain=peaks,
        loop_peak_gain=loop_peaks,
        closed_loop=frequency_response(closed_loop_transfer(parameters), hz),
        sensitivity=frequency_response(output_sensitivity(parameters), hz),
        histories=histories,
        sweep=None if spec.sweep is None else _sweep(spec.sweep, wheel, loops),
        flexible_hz=plant.frequency_hz[plant.n_rigid :],
        contribution=contribution,
        figures=figures,
        tables=(
            _loop_table(figures),
            _spot_table(histories),
            _peak_table(peaks, whole, loop_peaks, own),
            _contribution_table(plant, contribution),
        ),
    )


def _wheel(spec: LineOfSightSpec, plant: ModalPlant) -> Wheel:
    inputs = [f"{spec.wheel.node}.{direction}" for direction in range(1, 7)]
    for name in inputs:
        if name not in plant.inputs:
            raise StudyError(f"line_of_sight.wheel.node: the plant has no input {name!r}." + nearest(name, plant.inputs))
    rotation = np.eye(3) if spec.wheel.orientation is None else np.array(spec.wheel.orientation, dtype=float).T
    return Wheel(
        amplitude=np.array(spec.wheel.amplitude),
        harmonics=np.array(spec.wheel.harmonics),
        phase_rad=np.radians(spec.wheel.phases_deg),
        rotation=rotation,
        inputs=inputs,
    )


def _histories(spec: LineOfSightSpec, wheel: Wheel, loops: dict[str, Diagram]) -> dict[float, dict[str, xr.Dataset]]:
    """Spot over time at each wheel speed, on the harmonic steady state: the limit cycle, without drift of the free body."""
    time = np.arange(round(spec.time.duration_s / spec.time.step_s) + 1) * spec.time.step_s
    return {
        speed: {
            case: simulate(loop, time, wheel_tones(wheel, speed), outputs=SPOT, initial="steady_state")
            for case, loop in loops.items()
        }
        for speed in spec.wheel.speeds_hz
    }


def _sweep(spec: SweepSpec, wheel: Wheel, loops: dict[str, Diagram]) -> xr.Dataset:
    return wheel_speed_sweep(loops, wheel, np.linspace(spec.from_hz, spec.to_hz, spec.points))


def _flexible_band(plant: ModalPlant, hz: FloatArray) -> tuple[float, float]:
    """From half the first flexible mode to the end of the curve: below, the free body as a whole moves without bound."""
    flexible = plant.frequency_hz[plant.n_rigid :]
    return (max(0.5 * float(flexible[0]), float(hz[0])) if flexible.size else float(hz[0])), float(hz[-1])


def _peak(values: xr.DataArray, band: tuple[float, float]) -> tuple[float, float]:
    """(largest singular value of the curve in the band, Hz); NaN where the curve has no point in it."""
    hz, largest = values["frequency"].values, values.isel(index=0).values
    inside = np.flatnonzero((hz >= band[0]) & (hz <= band[1]))
    if not inside.size:
        return float("nan"), float("nan")
    place = inside[int(np.argmax(largest[inside]))]
    return float(largest[place]), float(hz[place])


def contributions(plant: ModalPlant, inputs: list[str], spec: LineOfSightSpec) -> dict[str, FloatArray]:
    """Output -> |output shape| |input shapes| of every flexible mode (its residue), over the largest of all outputs and modes."""
    columns = [list(plant.inputs).index(name) for name in inputs]
    names = [spec.optics.x, spec.optics.y, *([spec.optics.axial] if spec.optics.axial else [])]
    drive = np.linalg.norm(plant.shape_in[:, columns], axis=1)
    assert plant.shape_out is not None
    rows = {name: abs(plant.shape_out[list(plant.outputs).index(name)]) * drive for name in names}
    flexible = slice(plant.n_rigid, None)
    largest = max(float(row[flexible].max()) for row in rows.values())
    return {name: row[flexible] / largest for name, row in rows.items()}


def _loop_table(figures: list[LoopFigures]) -> Table:
    rows = tuple(
        (f.axis, f.peak_hz, f.bandwidth_hz, f.rejection_hz, f.crossover_hz, f.phase_margin_deg, 20 * float(np.log10(f.peak)))
        for f in figures
    )
    columns = (
        "axis",
        "closed-loop peak [Hz]",
        "-3 dB bandwidth [Hz]",
        "sensitivity -3 dB [Hz]",
        "crossover [Hz]",
        "phase margin [deg]",
        "peak [dB]",
    )
    return Table("Line-of-sight loop", columns, rows)


def _spot_table(histories: dict[float, dict[str, xr.Dataset]]) -> Table:
    rows = []
    for speed, cases in histories.items():
        for case, data in cases.items():
            motion = 1e9 * data["outputs"].sel(output=list(SPOT)).values
            radius = float(np.sqrt((motion**2).sum(axis=0)).max())
            rows.append((speed, case, *(float(np.sqrt((row**2).mean())) for row in motion), radius))
    columns = ("wheel [Hz]", "case", "RMS x [nm]", "RMS y [nm]", "largest radius [nm]")
    return Table("Spot motion on the sensor", columns, tuple(rows))


def _peak_table(
    peaks: dict[str, tuple[float, float]],
    band: tuple[float, float],
    loop_peaks: dict[str, tuple[float, float]],
    own: tuple[float, float],
) -> Table:
    """The heights of the plotted curves, rigid-body motion in them as everywhere."""
    rows = tuple((case, *peaks[case], *loop_peaks[case]) for case in peaks)
    ranges = [f"{low:.4g} to {high:.4g} Hz" for low, high in (band, own)]
    columns = (
        "case",
        f"largest singular value, {ranges[0]}",
        "at [Hz]",
        f"near the loop's own peak, {ranges[1]}",
        "there at [Hz]",
    )
    return Table("Wheel to spot, m per N or N m", columns, rows)


def _contribution_table(plant: ModalPlant, contribution: dict[str, FloatArray], count: int = 6) -> Table:
    hz = plant.frequency_hz[plant.n_rigid :]
    rows = tuple((float(hz[i]), *(float(values[i]) for values in contribution.values())) for i in range(min(count, hz.size)))
    return Table("Residue of the first flexible modes over the largest", ("Hz", *contribution), rows)
