"""Verifying the coupled model of a study: checks, and the table against a reference (Table 2)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexplant.assembly import System
from flexplant.modes import Modes
from flexplant.study.reference_modes import ReferenceModes, read_reference
from flexplant.study.schema import ReferenceSpec, StudySpec
from flexplant.verification import Check, CheckReport, Comparison, Reference, Table, compare_modes, undeflated_hz, verify


@dataclass(frozen=True, eq=False)
class Compared:
    """table: Table 2. every: all modes up to the plant's limit, of which the first `held` have to keep the study's limit.

    lowest_mac: of the shapes of these, None where the reference has no shapes.
    """

    table: Table
    every: Comparison
    held: int
    lowest_mac: float | None

    @property
    def worst_percent(self) -> float:
        """Largest frequency error of the held modes, %."""
        return float(abs(self.every.error_percent[: self.held]).max())


def check_system(study: StudySpec, folder: Path, system: System, modes: Modes) -> tuple[CheckReport, Compared | None]:
    """All checks of the coupled model; with a reference, its first modes are held to the study's limit."""
    spec, limit_hz = study.verification, study.plant.max_frequency_hz
    if spec.reference is None:
        report = verify(
            system,
            rigid_body_modes=spec.rigid_body_modes,
            modes=modes,
            max_frequency_hz=limit_hz,
            reduction_error=spec.reduction_error,
        )
        return _with_rigid_body_share(report, system, modes, spec.rigid_body_share), None
    given = read_reference(spec.reference, folder, system)
    held = given.first(spec.reference, spec.reference.modes)
    report = verify(
        system,
        rigid_body_modes=spec.rigid_body_modes,
        reference=held,
        frequency_tolerance=spec.reference.limit,
        modes=modes,
        max_frequency_hz=limit_hz,
        reduction_error=spec.reduction_error,
    )
    # the report has a section of its own for the reference, so its tables keep only what is not shown there
    kept = CheckReport(report.checks, tuple(t for t in report.tables if t.columns[2] != "coupled [Hz]"), report.notes)
    mac = [c.value for c in report.checks if c.unit == "MAC"]
    limit = limit_hz or float(modes.frequency_hz[-1])
    count = min(int(np.count_nonzero(given.flexible_hz <= limit)), len(modes) - modes.n_rigid)
    every = Reference(given.flexible_hz[:count], names=spec.reference.labels, source=spec.reference.name)
    comparison, table = compare_modes(system, modes, every), _table_2(spec.reference, system, modes, given)
    compared = Compared(table, comparison, min(spec.reference.modes, count), min(mac, default=None))
    return _with_rigid_body_share(kept, system, modes, spec.rigid_body_share), compared


def _table_2(spec: ReferenceSpec, system: System, modes: Modes, given: ReferenceModes) -> Table:
    """Free-free modes: published, reference and coupled; rigid-body modes as a plain eigensolver leaves them."""
    rigid = np.sort(undeflated_hz(system, modes.n_rigid)) if modes.n_rigid else np.zeros(0)
    rows: list[tuple[object, ...]] = [
        (f"Rigid body {i + 1}", "~0", float(given.rigid_hz[i]) if i < given.rigid_hz.size else "", float(hz), "")
        for i, hz in enumerate(rigid)
    ]
    for i in range(min(spec.modes, given.flexible_hz.size, len(modes) - modes.n_rigid)):
        name = spec.labels[i] if i < len(spec.labels) else f"Flexible {i + 1}"
        published = spec.published_hz[i] if i < len(spec.published_hz) else ""
        ours, theirs = float(modes.frequency_hz[modes.n_rigid + i]), float(given.flexible_hz[i])
        rows.append((name, published, theirs, ours, 100 * (ours / theirs - 1)))
    title = f"Free-free modes check ({system.method} assembly)"
    return Table(title, ("mode", "published [Hz]", f"{spec.name} [Hz]", "coupled [Hz]", "error [%]"), tuple(rows))


def _with_rigid_body_share(report: CheckReport, system: System, modes: Modes, limit: float | None) -> CheckReport:
    """The report with the check of how far rigid-body modes lie below the flexible ones before they are set to zero."""
    if limit is None or not 0 < modes.n_rigid < len(modes):
        return report
    share = float(undeflated_hz(system, modes.n_rigid).max() / modes.frequency_hz[modes.n_rigid])
    text = "highest rigid-body frequency of a plain eigensolver / first flexible frequency"
    check = Check("rigid-body modes below the flexible ones", share, limit, share <= limit, "", text)
    return CheckReport((report.checks[0], check, *report.checks[1:]), report.tables, report.notes)
