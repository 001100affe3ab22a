"""Whether reduced components serve the range that is asked of their system: completeness, and the estimated errors of modes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexplant.assembly import System
from flexplant.model.table import Table
from flexplant.modes import Modes, normal_modes
from flexplant.reduction.coverage import MARGIN, Coverage, coverage, shortfall
from flexplant.reduction.reduced import can_estimate
from flexplant.verification.checks import Check
from flexplant.verification.reduction_error import ErrorEstimate, estimate_error

ROWS = 60  # modes in the table
FEW = 100  # elastic modes whose errors are estimated where no range is asked for: it takes the cube of their number
COMPLETE = ": modes complete up to the frequency asked"  # ends the name of a component's check
LARGEST = "estimated frequency error of the reductions"
TITLE = "Estimated frequency errors of the reductions"


class Found(NamedTuple):
    """What a report gets."""

    checks: list[Check]
    tables: list[Table]
    notes: list[str]


def reduction_range(system: System, modes: Modes, max_frequency_hz: float | None, limit: float) -> Found:
    """Checks, table and notes on what the components' reductions leave out.

    max_frequency_hz: what is asked of the system; None promises nothing, so nothing fails. limit: largest accepted estimated
    relative error of a frequency in that range.
    """
    covered = [coverage(c) for c in system.components]
    complete = min((c.complete_below_hz for c in covered if c.complete_below_hz is not None), default=np.inf)
    if max_frequency_hz is None:
        checks, notes = [], _beyond(modes, complete)
        top = min(complete / MARGIN, float(modes.frequency_hz[: modes.n_rigid + FEW][-1]) if len(modes) else 0.0)
    else:
        checks, notes = list(_complete(covered, max_frequency_hz)), [c.note(max_frequency_hz) or "" for c in covered]
        top = min(max_frequency_hz, complete)
    found = Found(checks, [], [note for note in notes if note])
    if not any(can_estimate(c) for c in system.components):
        return found
    estimate = estimate_error(system, modes=_up_to(system, modes, MARGIN * top)).below(top)
    if not estimate.frequency_hz.size:
        return found
    if estimate.skipped:
        found.notes.append(f"estimated frequency errors do not contain those of {', '.join(estimate.skipped)}")
    if max_frequency_hz is not None:
        checks.append(_largest(estimate, modes.n_rigid + 1, limit))
    found.tables.append(_table(estimate, modes.n_rigid + 1))
    return found


def _beyond(modes: Modes, complete: float) -> list[str]:
    if not len(modes) or modes.frequency_hz[-1] <= complete:
        return []
    return [f"modes above {complete:.4g} Hz are not vouched for: the components' own modes are complete only below it"]


def _up_to(system: System, modes: Modes, frequency_hz: float) -> Modes:
    """Modes up to there, solved for where the given ones end below: errors of modes mix with those of the next ones."""
    count = int(np.count_nonzero(modes.frequency_hz <= frequency_hz))
    if count == len(modes) < system.basis.shape[1]:
        return normal_modes(system, max_frequency_hz=frequency_hz)
    return replace(
        modes, frequency_hz=modes.frequency_hz[:count], shapes=modes.shapes[:, :count], residuals=modes.residuals[:count]
    )


def _complete(covered: list[Coverage], max_frequency_hz: float) -> Iterator[Check]:
    for found in covered:
        if found.complete_below_hz is None or not np.isfinite(found.complete_below_hz):
            continue
        short = shortfall([found], max_frequency_hz)
        text = "no mode of the component's own is missing up to the frequency asked of the system"
        if short is not None:
            text = (
                f"{short}: modes above it are missing or wrong; reduce it up to {MARGIN * max_frequency_hz:.4g} Hz, or ask less"
            )
        yield Check(f"{found.component}{COMPLETE}", found.complete_below_hz, max_frequency_hz, short is None, "Hz", text)


def _largest(estimate: ErrorEstimate, first: int, limit: float) -> Check:
    worst = int(np.argmax(estimate.total))
    value = 100 * float(estimate.total[worst])
    name = estimate.components[int(np.argmax(estimate.by_component[worst]))]
    text = f"largest at mode {first + worst}, {estimate.frequency_hz[worst]:.5g} Hz, mostly from component {name!r}"
    passed = value <= 100 * limit
    if not passed:
        text += "; reduce it to a higher frequency, with residual vectors, or with accuracy="
    return Check(LARGEST, value, 100 * limit, passed, "%", text)


def _table(estimate: ErrorEstimate, first: int) -> Table:
    """All modes, or the worst ones in ascending order."""
    total = estimate.total
    shown = np.sort(np.argsort(-total, kind="stable")[:ROWS])
    title = TITLE if shown.size == total.size else f"{TITLE}: the largest {ROWS} of {total.size} modes"
    rows = tuple(
        (first + int(k), float(estimate.frequency_hz[k]), 100 * float(total[k]), *_shares(estimate, k), _remark(estimate, k))
        for k in shown
    )
    columns = ("mode", "Hz", "error [%]", *(f"from {name} [%]" for name in estimate.components), "")
    return Table(title, columns, rows)


def _shares(estimate: ErrorEstimate, k: int) -> list[float]:
    return [100 * float(value) for value in estimate.by_component[k]]


def _remark(estimate: ErrorEstimate, k: int) -> str:
    if not np.isfinite(estimate.total[k]):
        return "not vouched for"
    return "mixes with close modes" if estimate.mixed[k] else ""
