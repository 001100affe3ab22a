"""The whole workflow as one function: read, couple, verify, plant, respond, close the loop, report."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

from flexplant.errors import expect_function
from flexplant.io.parse.files import as_path
from flexplant.io.write.ownership import files_of
from flexplant.model.arrays import checked_switch
from flexplant.modes import normal_modes
from flexplant.response.frequency import frequency_response
from flexplant.study.assemble import assemble, files_read, read_components
from flexplant.study.display import shape_notes, structure_view
from flexplant.study.grid import frequency_grid
from flexplant.study.line_of_sight import line_of_sight
from flexplant.study.load import lines_of, load_study
from flexplant.study.outputs import output_folder, refuse_sources
from flexplant.study.plant import build_plant
from flexplant.study.provenance import provenance
from flexplant.study.result import StudyResult
from flexplant.study.schema import StudySpec
from flexplant.study.summary import study_tables, summary
from flexplant.study.truth import compare_with_truth
from flexplant.study.verification import check_system
from flexplant.study.write import first_names, write_files
from flexplant.verification import check_component

Progress = Callable[[str, float], None]
MARGIN = 1.02  # modes are computed a little beyond the limit, so that a reference mode just below it finds its partner


def run_study(
    path: str | Path, *, output: str | Path | None = None, allow_outside: bool = False, progress: Progress | None = None
) -> StudyResult:
    """Run a study file and, with `output`, write its results there (all of them, or none).

    progress: called with the name of each step and the share done before it. A failed check is a value in `.checks`, not an
    error. Raises StudyError for a study file that cannot be used, and the errors of the steps.
    """
    checked_switch(allow_outside, "run_study: allow_outside")
    expect_function(progress, "run_study: progress", "step, share")
    path, output = as_path(path), None if output is None else as_path(output)
    study, steps = load_study(path, allow_outside=allow_outside), _Steps(progress)
    if output is not None:
        refuse_sources(first_names(study), output, files_read(study, path))
    with output_folder(output) if output is not None else nullcontext() as work:
        result = _result(study, path, steps)
        if work is None or output is None:
            return result
        steps("writing the results", 0.9)
        names = write_files(result, structure_view(study, path.parent, result.system, result.modes), work)
        beside = [file for c in result.system.components for file in files_of(c)]
        refuse_sources([file.name for file in work.iterdir()], output, [*files_read(study, path), *beside])
    steps("done", 1.0)
    return replace(result, files={name: Path(output) / file for name, file in names.items()})


def _result(study: StudySpec, path: Path, steps: _Steps) -> StudyResult:
    folder = path.parent
    steps("reading the components", 0.0)
    with lines_of(path):
        components = read_components(study, folder, steps.reducing)
    component_checks = {c.name: check_component(c) for c in components}
    steps("coupling", 0.03)
    with lines_of(path):
        system = assemble(study, components)
    modes = normal_modes(system, max_frequency_hz=_highest(study))
    steps("verifying", 0.06)
    checks, compared = check_system(study, folder, system, modes)
    steps("building the plant", 0.1)
    plant = build_plant(study, system)
    steps("transfer functions", 0.12)
    response = frequency_response(plant, frequency_grid(study.response, plant))
    loop = None
    if study.line_of_sight is not None:
        steps("closing the loop", 0.15)
        loop = line_of_sight(study.line_of_sight, plant)
    truth = None
    if study.truth is not None:
        limit = study.plant.max_frequency_hz or float(modes.frequency_hz[-1])
        steps("solving the unreduced model", 0.25)
        truth = compare_with_truth(study, folder, plant, limit, steps.between(0.25, 0.9))
    found = StudyResult(
        study=study,
        system=system,
        modes=modes,
        component_checks=component_checks,
        checks=checks,
        plant=plant,
        response=response,
        truth=truth,
        line_of_sight=loop,
        provenance=provenance(study, path, system) | {"Seconds": {k: round(v, 2) for k, v in steps.seconds().items()}},
        seconds=steps.seconds(),
        notes=shape_notes(study, folder, system, modes),
    )
    return replace(found, tables=study_tables(found, compared), summary=summary(found, compared), compared=compared)


def _highest(study: StudySpec) -> float | None:
    wanted = study.verification.max_frequency_hz or study.plant.max_frequency_hz
    return None if wanted is None else wanted * MARGIN


class _Steps:
    """Tells the caller which step begins, and keeps what each took."""

    def __init__(self, progress: Progress | None) -> None:
        self._progress = progress
        self._started: list[tuple[str, float]] = []

    def __call__(self, text: str, share: float) -> None:
        self._started.append((text, time.perf_counter()))
        if self._progress is not None:
            self._progress(text, share)

    def reducing(self, text: str) -> Callable[[str, float], None]:
        """A step within reading; a callback for the stage and done share of it."""
        self(text, 0.0)
        tell = self.between(0.0, 0.03)
        return lambda _stage, share: tell(share)

    def between(self, low: float, high: float) -> Callable[[float], None]:
        """A callback for the done share of the current step."""
        text = self._started[-1][0]

        def tell(share: float) -> None:
            if self._progress is not None:
                self._progress(text, low + (high - low) * share)

        return tell

    def seconds(self) -> dict[str, float]:
        """Seconds by step, up to now."""
        ends = [start for _, start in self._started[1:]] + [time.perf_counter()]
        return {text: end - start for (text, start), end in zip(self._started, ends, strict=True)}
