"""From a finished study to the content of its report."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import plotly.graph_objects as go

from flexplant.report import Item, Plot, Report, Section, StructureView, Tile
from flexplant.report.figures import (
    Mark,
    bode,
    frequency_comparison,
    mode_contributions,
    rms_over_speed,
    sensitivity,
    singular_values,
    spot,
    time_histories,
    transfer_function,
)
from flexplant.study.line_of_sight import CASES, SPOT
from flexplant.study.reductions import reductions_table, reductions_text
from flexplant.study.result import LineOfSightResult, StudyResult, TruthResult
from flexplant.study.summary import length
from flexplant.study.tables import modes_table, response_table

HALF_POWER_DB = -3.0103
ROUND_OFF = 1e-10  # of the response that two channels' modes could give together


def report(result: StudyResult, view: StructureView | None) -> Report:
    """The whole report; `view`: the structure in three dimensions, where the components bring a display mesh."""
    return Report(
        title=result.study.title,
        subtitle=", ".join(c.name for c in result.system.components) + f": {result.system.method} assembly",
        summary=result.summary,
        tiles=list(_tiles(result)),
        sections=list(_sections(result, view)),
        provenance=result.provenance,
        checks=result.checks,
    )


def _tiles(result: StudyResult) -> Iterator[Tile]:
    modes, checks = result.modes, result.checks
    yield Tile("Checks", f"{len(checks.checks) - len(checks.failed)} of {len(checks.checks)}", "", "passed", checks.passed)
    yield Tile("Rigid-body modes", modes.n_rigid, "", f"{result.study.verification.rigid_body_modes} expected")
    if len(modes) > modes.n_rigid:
        yield Tile("First flexible mode", _hz(float(modes.frequency_hz[modes.n_rigid])), "Hz")
    if result.compared is not None:
        worst, limit = result.compared.worst_percent, result.study.verification.reference
        passed = None if limit is None else worst <= 100 * limit.limit
        note = f"largest frequency error of the first {result.compared.held} modes"
        yield Tile("Against the reference", f"{worst:.2g}", "%", note, passed)
    if result.line_of_sight is not None:
        yield from _loop_tiles(result.line_of_sight)


def _loop_tiles(loop: LineOfSightResult) -> Iterator[Tile]:
    f = loop.figures[0]
    yield Tile("Closed-loop peak", round(f.peak_hz, 1), "Hz")
    yield Tile("-3 dB bandwidth", round(f.bandwidth_hz, 1), "Hz")
    yield Tile("Sensitivity -3 dB", round(f.rejection_hz, 1), "Hz")
    yield Tile("Phase margin", round(f.phase_margin_deg, 2), "deg", "very small: stable only without any delay", False)


def _hz(value: float) -> str:
    return f"{value:.1f}" if value >= 100 else f"{value:.4g}"


def _sections(result: StudyResult, view: StructureView | None) -> Iterator[Section]:
    yield Section("Modes", list(_mode_items(result, view)))
    yield Section("Transfer functions", list(_response_items(result)))
    if result.line_of_sight is not None:
        yield Section("Spot motion", list(_spot_items(result.line_of_sight)))
        yield Section("Control loop", list(_loop_items(result, result.line_of_sight)))
    if (reduced := reductions_table(result.study, result.system)) is not None:
        yield Section("Reductions", [reductions_text(result.study, result.system), reduced])
    yield Section("Checks of the coupled model", [result.checks])
    yield Section(
        "Checks of the components", [item for name, r in result.component_checks.items() for item in (f"Component {name}", r)]
    )


def _mode_items(result: StudyResult, view: StructureView | None) -> Iterator[Item]:
    if view is not None:
        yield view
    yield from (f"Note: {note}." for note in result.notes)
    if result.compared is None:
        yield modes_table(result.modes)
        return
    yield result.compared.table
    note = result.study.verification.reference.note if result.study.verification.reference is not None else ""
    yield f"Rigid-body modes are listed as a plain eigensolver leaves them; in the plant they are exactly zero. {note}"
    every = result.compared.every
    names = [str(row[0]) for row in every.table.rows]
    caption = (
        f"Error of all {every.error_percent.size} modes up to {every.reference_hz.max():.4g} Hz: truncation of the reduction."
    )
    yield Plot(frequency_comparison(names, every.error_percent), caption)
    yield every.table


def _response_items(result: StudyResult) -> Iterator[Item]:
    if result.truth is not None:
        yield Plot(_truth_figure(result, result.truth), _truth_caption(result.truth))
        yield result.truth.table
        yield (
            "By band: the median of the local difference of the plant, then the largest difference over the band's highest "
            "response: of the plant, of the plant without static correction, with its viscous damping, and from other components."
        )
        return
    if result.response["frequency"].size == 1:
        yield response_table(result.response)
    outputs, inputs = (result.response[d].values for d in ("output", "input"))
    curves = {str(result.plant.name): result.response}
    for output in outputs[: 6 if result.response["frequency"].size > 1 else 0]:
        if (largest := round_off_height(result, str(output), str(inputs[0]))) is not None:
            yield (
                f"{output} / {inputs[0]} is not drawn: it is at most {largest:.1e}, round-off of a response that is zero, as by "
                "symmetry."
            )
            continue
        yield Plot(transfer_function(curves, output=str(output), input=str(inputs[0]), title=f"{output} / {inputs[0]}"))


def round_off_height(result: StudyResult, output: str, given: str) -> float | None:
    """Largest magnitude of an entry whose modes' contributions are zero to round-off beside what the two channels could share.

    By Cauchy and Schwarz the sum of |phi_y phi_u| / (2 zeta w^2) is at most the product of both channels' norms in that weight.
    None for an entry that is there, and for rates, which have no displacement rows.
    """
    plant = result.plant
    assert plant.shape_out is not None
    flexible = slice(plant.n_rigid, None)
    weight = 1 / (np.maximum(plant.zeta[flexible], 1e-6) * plant.omega[flexible] ** 2)
    y = plant.shape_out[list(plant.outputs).index(output), flexible]
    u = plant.shape_in[flexible, list(plant.inputs).index(given)]
    shared = float(np.sqrt((weight * y**2).sum() * (weight * u**2).sum()))
    largest = float(abs(result.response.sel(output=output, input=given)).max())
    return largest if shared > 0 and largest < ROUND_OFF * shared else None


def _truth_figure(result: StudyResult, truth: TruthResult) -> go.Figure:
    curves = {"unreduced model": truth.direct, "plant": truth.plant, "plant without static correction": truth.uncorrected}
    if truth.second is not None:
        curves["plant, other components"] = truth.second
    title = f"{truth.direct['output'].values[0]} / {truth.direct['input'].values[0]}"
    return transfer_function(
        curves, title=title, reference="unreduced model", truncated_above_hz=result.study.plant.max_frequency_hz
    )


def _truth_caption(truth: TruthResult) -> str:
    return (
        f"The reduced plant over the explicit solution of the whole sparse model at {truth.direct['frequency'].size} "
        "frequencies, with the same structural damping on both sides, so that only reduction and truncation differ. Above "
        "the retained modes the plant rolls off to its static correction, and without it to the mass line. Near a resonance a "
        "relative frequency error e of the reduction shows as a difference of about e over the damping ratio."
        + ("" if truth.second is None else " The other components are those the study names for comparison.")
    )


def _spot_items(loop: LineOfSightResult) -> Iterator[Item]:
    for speed, cases in loop.histories.items():
        curves = {case: data["outputs"] for case, data in cases.items()}
        title = f"Spot at a wheel speed of {speed:g} Hz"
        yield Plot(
            time_histories(curves, outputs=list(SPOT), title=title, labels={"spot_x": "x", "spot_y": "y"}),
            f"RMS {length(loop.rms(speed, CASES[0]))} with the mirror at rest, {length(loop.rms(speed, CASES[1]))} closed loop.",
        )
        yield Plot(spot(curves, x="spot_x", y="spot_y", title=f"{title}: path on the sensor"))
    if loop.sweep is not None:
        rms = {case: loop.total_rms(case) for case in CASES}
        marks = [Mark(speed, f"{speed:g} Hz") for speed in loop.histories]
        caption = "Exact steady state at every speed; peaks are where a harmonic of the wheel meets a mode."
        yield Plot(rms_over_speed(rms, title="RMS spot over wheel speed", marks=marks), caption)
    yield next(t for t in loop.tables if t.title.startswith("Spot"))


def _loop_items(result: StudyResult, loop: LineOfSightResult) -> Iterator[Item]:
    f = loop.figures[0]
    marks = [Mark(hz, f"{case}: {hz:.4g} Hz", value) for case, (value, hz) in loop.peak_gain.items()]
    yield Plot(singular_values(loop.singular_values, unit="m per N or N m", marks=marks), _gain_caption(result, f.peak_hz))
    closed = [
        Mark(f.peak_hz, f"peak {f.peak_hz:.1f} Hz", _db(f.peak)),
        Mark(f.bandwidth_hz, f"{f.bandwidth_hz:.1f} Hz", HALF_POWER_DB),
    ]
    output, given = (str(loop.closed_loop[d].values[0]) for d in ("output", "input"))
    yield Plot(bode({"closed loop": loop.closed_loop}, output=output, input=given, marks=closed), _axis_caption(loop))
    output, given = (str(loop.sensitivity[d].values[0]) for d in ("output", "input"))
    crossing = [Mark(f.rejection_hz, f"{f.rejection_hz:.1f} Hz", HALF_POWER_DB)]
    yield Plot(sensitivity({"output sensitivity": loop.sensitivity}, output=output, input=given, marks=crossing))
    yield (
        f"The phase margin is only {f.phase_margin_deg:.2f} degrees: a proportional gain on a lightly damped mirror leaves the "
        f"loop stable, but any delay, lag or unmodelled phase of that size near {f.crossover_hz:.0f} Hz would make it unstable."
    )
    yield from (t for t in loop.tables if not t.title.startswith("Spot"))
    hz = result.plant.frequency_hz[result.plant.n_rigid :]
    caption = "How strongly each mode connects the wheel with the lens, per direction; an axial mode is absent from x and y."
    yield Plot(mode_contributions(hz, loop.contribution), caption)


def _gain_caption(result: StudyResult, peak_hz: float) -> str:
    limit = result.study.plant.max_frequency_hz
    text = (
        "From the six wheel inputs to the spot, the larger singular value solid and the smaller dotted. Below the first flexible "
        "mode the free body moves as a whole."
    )
    if limit is None or limit > peak_hz:
        return text
    return (
        f"{text} Above {limit:g} Hz the plant keeps only the static response of its truncated modes: the loop's own peak near "
        f"{peak_hz:.0f} Hz is real, but what the structure feeds into it there is not resolved."
    )


def _axis_caption(loop: LineOfSightResult) -> str:
    first, *others = loop.figures
    alike = [f.axis for f in others if math.isclose(f.peak_hz, first.peak_hz) and math.isclose(f.peak, first.peak)]
    return f"Axis {first.axis}" + (f"; axis {alike[0]} has the same loop." if alike else ".")


def _db(value: float) -> float:
    return 20 * math.log10(value)
