"""A finished study in plain words, and the tables that are printed."""

from __future__ import annotations

from collections.abc import Iterator

from flexplant.study.line_of_sight import CASES
from flexplant.study.result import LineOfSightResult, StudyResult
from flexplant.study.verification import Compared
from flexplant.verification import Table


def summary(result: StudyResult, compared: Compared | None) -> tuple[str, ...]:
    """Paragraphs for the top of the report and the terminal."""
    parts = [result.study.statement, _model(result), _reference(result, compared), _plant(result), _truth(result)]
    if result.line_of_sight is not None:
        parts += _line_of_sight(result.line_of_sight)
    return tuple(p for p in parts if p)


def _model(result: StudyResult) -> str:
    system, modes = result.system, result.modes
    sizes = ", ".join(f"{c.name} ({c.n_boundary} boundary and {c.n_modal} modal DOF)" for c in system.components)
    flexible = modes.frequency_hz[modes.n_rigid :]
    first = f", the first flexible one at {flexible[0]:.4g} Hz" if flexible.size else ""
    checks = result.checks
    verdict = "All checks passed." if checks.passed else f"{len(checks.failed)} of {len(checks.checks)} checks failed."
    return (
        f"Components: {sizes}. Coupled by {system.n_constraints} constraints ({system.method}): "
        f"{modes.n_rigid} rigid-body modes and {flexible.size} flexible modes{first}. {verdict}"
    )


def _reference(result: StudyResult, compared: Compared | None) -> str:
    if compared is None or result.study.verification.reference is None:
        return ""
    every = abs(compared.every.error_percent)
    mac = "" if compared.lowest_mac is None else f", shapes with a MAC of at least {compared.lowest_mac:.5f}"
    return (
        f"Against {result.study.verification.reference.name}: the first {compared.held} flexible frequencies agree within "
        f"{compared.worst_percent:.2g} %{mac}; all {every.size} up to "
        f"{compared.every.reference_hz.max():.4g} Hz within {every.max():.2g} %."
    )


def _plant(result: StudyResult) -> str:
    plant, damping = result.plant, result.study.damping
    ratio = "the damping of the components" if damping is None else f"a damping ratio of {damping.ratio} on the {damping.on}"
    corrected = "with" if plant.static_correction is not None else "without"
    return (
        f"Plant: {plant.n_modes} modes up to {plant.frequency_hz.max():.4g} Hz, {len(plant.inputs)} inputs, "
        f"{len(plant.outputs)} outputs, {ratio}, {corrected} static correction of the truncated modes."
    )


def _truth(result: StudyResult) -> str:
    if result.truth is None:
        return ""
    low, high, median, largest = result.truth.below_limit
    return (
        f"Against the unreduced model, solved at {result.truth.direct['frequency'].size} frequencies with the same structural "
        f"damping: between {low:.4g} and {high:.4g} Hz the plant's response differs by {median:.2g} % in the median and by at "
        f"most {largest:.2g} % of the highest resonance."
    )


def _line_of_sight(loop: LineOfSightResult) -> Iterator[str]:
    f = loop.figures[0]
    yield (
        f"Loop: closed-loop peak at {f.peak_hz:.1f} Hz, -3 dB bandwidth {f.bandwidth_hz:.1f} Hz, output sensitivity below -3 dB "
        f"up to {f.rejection_hz:.1f} Hz. The phase margin is {f.phase_margin_deg:.2f} degrees: a small delay or "
        "lag would make this loop unstable."
    )
    for speed in loop.histories:
        opened, closed = (1e6 * loop.rms(speed, case) for case in CASES)
        change = f"{opened / closed:.3g} times less" if closed < opened else "more: the loop amplifies here"
        yield (
            f"Wheel at {speed:g} Hz: the spot moves {opened:.3g} um RMS with the mirror at rest and {closed:.3g} um with the "
            f"loop closed, {change}."
        )


def study_tables(result: StudyResult, compared: Compared | None) -> tuple[Table, ...]:
    """The tables that are printed and stored."""
    tables = [] if compared is None else [compared.table]
    tables += [t for t in result.checks.tables if t.title.startswith("Mass properties")]
    tables += [] if result.truth is None else [result.truth.table]
    tables += [] if result.line_of_sight is None else list(result.line_of_sight.tables)
    return tuple(tables)
