"""A finished study in plain words, and the tables that are printed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexplant.study.line_of_sight import CASES
from flexplant.study.reductions import how_reduced, reductions_table, reductions_text
from flexplant.study.result import LineOfSightResult, StudyResult
from flexplant.study.verification import Compared
from flexplant.verification import Table
from flexplant.verification.reduction_range import COMPLETE, LARGEST, TITLE

ROUND_OFF = 1e-10  # % of a frequency, below which an estimate says nothing
SEEN, UNSEEN = 0.05, 1e-6  # shares of the largest residue that count as there and as absent


def summary(result: StudyResult, compared: Compared | None) -> tuple[str, ...]:
    """Paragraphs for the top of the report and the terminal."""
    parts = [
        result.study.statement,
        _model(result),
        _reference(result, compared),
        reductions_text(result.study, result.system),
        _reductions(result),
        _plant(result),
        _truth(result),
    ]
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
    mac = "" if compared.lowest_mac is None else f", shapes with a MAC of at least {compared.lowest_mac:.6f}"
    return (
        f"Against {result.study.verification.reference.name}: the first {compared.held} flexible frequencies agree within "
        f"{compared.worst_percent:.2g} %{mac}; all {every.size} up to "
        f"{compared.every.reference_hz.max():.4g} Hz within {every.max():.2g} %."
    )


def _reductions(result: StudyResult) -> str:
    """Whether the reductions made here serve the plant's range."""
    checks, limit = result.checks.checks, result.study.plant.max_frequency_hz
    short = [f"{c.explanation}." for c in checks if c.name.endswith(COMPLETE) and not c.passed]
    largest = [c for c in checks if c.name == LARGEST]
    sentences = [text[0].upper() + text[1:] for text in short]
    for check in largest:
        where = "as far as they are complete" if short else f"up to {limit:.4g} Hz"
        found = f"{check.value:.2g} % at most, {check.explanation}" if check.value > ROUND_OFF else "below round-off"
        sentences.append(f"Estimated frequency errors of the reductions {where}: {found}.")
    return " ".join(sentences)


def _plant(result: StudyResult) -> str:
    plant, damping = result.plant, result.study.damping
    own = "the damping of the components" if any(c.damping is not None for c in result.system.components) else "no damping"
    ratio = own if damping is None else f"a damping ratio of {damping.ratio} on the {damping.on}"
    corrected = "with" if plant.report.get("static_correction") else "without"
    limit = result.study.plant.max_frequency_hz
    kept = "all modes kept" if limit is None else f"{corrected} static correction of the truncated modes"
    return (
        f"Plant: {plant.n_modes} modes up to {plant.frequency_hz.max():.4g} Hz, {_count(len(plant.inputs), 'input')}, "
        f"{_count(len(plant.outputs), 'output')}, {ratio}, {kept}."
    )


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _truth(result: StudyResult) -> str:
    if result.truth is None:
        return ""
    low, high, median, largest = result.truth.below_limit
    return (
        f"Against the unreduced model, solved at {result.truth.direct['frequency'].size} frequencies with the same structural "
        f"damping: between {low:.4g} and {high:.4g} Hz the plant's response differs by {median:.2g} % in the median and by at "
        f"most {largest:.2g} % of the highest resonance.{_second(result)}"
    )


def _second(result: StudyResult) -> str:
    assert result.truth is not None
    assert result.study.truth is not None
    if result.truth.second_below_limit is None:
        return ""
    _, _, median, largest = result.truth.second_below_limit
    parts = result.study.truth.components
    how = ", ".join(f"{name} from {spec.file}{how_reduced(spec)}" for name, spec in parts.items())
    differs = f"the same plant differs by {median:.2g} % and {largest:.2g} %"
    return f" Built from other components ({how}), {differs}; what lies between is the basis of the first ones."


def _line_of_sight(loop: LineOfSightResult) -> Iterator[str]:
    f = loop.figures[0]
    yield (
        f"Loop: closed-loop peak at {f.peak_hz:.1f} Hz, -3 dB bandwidth {f.bandwidth_hz:.1f} Hz, output sensitivity below -3 dB "
        f"up to {f.rejection_hz:.1f} Hz. The phase margin is {f.phase_margin_deg:.2f} degrees: a small delay or "
        "lag would make this loop unstable."
    )
    yield from _unseen(loop)
    for speed in loop.histories:
        opened, closed = (loop.rms(speed, case) for case in CASES)
        change = f"{opened / closed:.3g} times less" if closed < opened else "more: the loop amplifies here"
        yield (
            f"Wheel at {speed:g} Hz: the spot moves {length(opened)} RMS with the mirror at rest and {length(closed)} with the "
            f"loop closed, {change}."
        )


def _unseen(loop: LineOfSightResult) -> Iterator[str]:
    """Modes that move the lens along the axis but not across it."""
    if len(loop.contribution) < 3:
        return
    across = np.maximum(*(loop.contribution[name] for name in list(loop.contribution)[:2]))
    axial = list(loop.contribution.values())[2]
    absent = np.flatnonzero((axial > SEEN) & (across < UNSEEN))
    if absent.size:
        names = ", ".join(f"{loop.flexible_hz[k]:.1f} Hz" for k in absent[:4])
        yield (
            f"Axial modes do not reach the spot: at {names} the residue in x and y is at most {across[absent].max():.1g} of the "
            f"largest, while it is {axial[absent[0]]:.2g} along the axis for the first."
        )


def length(metres: float) -> str:
    """A length with the prefix that suits it: "11.1 nm"."""
    units = (("m", 1.0), ("mm", 1e3), ("µm", 1e6), ("nm", 1e9), ("pm", 1e12))
    unit, scale = next((u for u in units if abs(metres) * u[1] >= 1), units[-1])
    return f"{metres * scale:.3g} {unit}"


def study_tables(result: StudyResult, compared: Compared | None) -> tuple[Table, ...]:
    """The tables that are printed and stored."""
    tables = [] if compared is None else [compared.table]
    tables += [t for t in result.checks.tables if t.title.startswith("Mass properties")]
    reduced = reductions_table(result.study, result.system)
    tables += [] if reduced is None else [reduced]
    tables += [t for t in result.checks.tables if t.title.startswith(TITLE)]
    tables += [] if result.truth is None else [result.truth.table]
    tables += [] if result.line_of_sight is None else list(result.line_of_sight.tables)
    return tuple(tables)
