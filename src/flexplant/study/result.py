"""What a study returns: every value of the workflow, and its text for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr

from flexplant.assembly import System
from flexplant.blocks.wheel import Wheel
from flexplant.loop.figures_of_merit import LoopFigures
from flexplant.loop.line_of_sight import LineOfSight
from flexplant.model.arrays import FloatArray
from flexplant.modes import Modes
from flexplant.plant.modal import ModalPlant
from flexplant.study.schema import StudySpec
from flexplant.study.tables import worst_rows
from flexplant.study.verification import Compared
from flexplant.verification import CheckReport, Table


@dataclass(frozen=True, eq=False, kw_only=True)
class TruthResult:
    """The plant beside the unreduced model: complex responses, dims (output, input, frequency), one law of damping on both sides.

    direct: unreduced model. plant, uncorrected: reduced plant with and without static correction. viscous: the plant with its own
    damping, to show what the law of damping changes. second: the plant from other components, or None, with its
    second_below_limit. table: differences by band. below_limit:
    lowest and highest Hz of the plant's own range, and in it the median of the local and the largest difference over the peak, %.
    """

    direct: xr.DataArray
    plant: xr.DataArray
    uncorrected: xr.DataArray
    viscous: xr.DataArray
    table: Table
    below_limit: tuple[float, float, float, float]
    second: xr.DataArray | None = None
    second_below_limit: tuple[float, float, float, float] | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class LineOfSightResult:
    """The loop and what the wheel does to the spot.

    singular_values: case ("open loop", "closed loop") -> (frequency, index), m per N or N m. peak_gain: case -> (largest singular
    value of the flexible range, Hz). loop_peak_gain: the same within 5 % of the loop's own peak frequency. closed_loop,
    sensitivity: complex responses of the control system. histories: wheel speed in Hz -> case -> Dataset of the spot over time.
    sweep: RMS and amplitudes over wheel speed, or None. contribution: output -> residue of each flexible mode (of flexible_hz)
    over the largest. figures: of each axis of the loop.
    """

    parameters: LineOfSight
    wheel: Wheel
    singular_values: Mapping[str, xr.DataArray]
    peak_gain: Mapping[str, tuple[float, float]]
    loop_peak_gain: Mapping[str, tuple[float, float]]
    closed_loop: xr.DataArray
    sensitivity: xr.DataArray
    histories: Mapping[float, Mapping[str, xr.Dataset]]
    sweep: xr.Dataset | None
    flexible_hz: FloatArray
    contribution: Mapping[str, FloatArray]
    figures: Sequence[LoopFigures]
    tables: tuple[Table, ...]

    def rms(self, speed: float, case: str) -> float:
        """RMS distance of the spot from its mean place at one wheel speed, metres."""
        motion = self.histories[speed][case]["outputs"].values
        return float(np.sqrt((motion**2).sum(axis=0).mean()))

    def total_rms(self, case: str) -> xr.DataArray:
        """RMS distance of the spot over wheel speed, metres; dims (omega_hz,). Only with a sweep."""
        assert self.sweep is not None
        squares = (self.sweep["rms"].sel(case=case) ** 2).sum("output")
        return squares**0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class StudyResult:
    """A finished study.

    checks: of the coupled model. compared: with the reference, if there is one. component_checks: by component name.
    notes: what was asked and cannot be shown. seconds: what each step took. files: what was written, by kind.
    """

    study: StudySpec
    system: System
    modes: Modes
    component_checks: Mapping[str, CheckReport]
    checks: CheckReport
    compared: Compared | None = None
    plant: ModalPlant
    response: xr.DataArray
    truth: TruthResult | None = None
    line_of_sight: LineOfSightResult | None = None
    tables: tuple[Table, ...] = ()
    summary: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    provenance: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    files: Mapping[str, Path] = field(default_factory=dict)

    def text(self) -> str:
        """Summary, tables, verdict and where the files are, for a terminal."""
        failed = [f"  FAILED {c.name}: {c.value:.6g} {c.unit} (limit {c.limit:.6g}). {c.explanation}" for c in self.checks.failed]
        passed = len(self.checks.checks) - len(failed)
        notes = [f"  note: {note}" for note in (*self.checks.notes, *self.notes)]
        verdict = "\n".join([f"{passed} of {len(self.checks.checks)} checks passed", *failed, *notes])
        parts = [self.study.title, *self.summary, *(str(worst_rows(t)) for t in self.tables), verdict]
        if self.files:
            parts.append("\n".join(["Results:", *(f"  {path}" for path in self.files.values())]))
        return "\n\n".join(parts)
