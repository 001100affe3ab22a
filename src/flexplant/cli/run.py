"""`flexplant run` and `flexplant demo`: a whole study."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from flexplant.cli.options import Outside, Quiet
from flexplant.cli.progress import progress_bar
from flexplant.cli.told import FAILED, end, look, told


@told
def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path("flexplant-demo"),
    quiet: Quiet = False,
) -> None:
    """Run the ShockSat-like example: two components to a closed-loop line-of-sight report."""
    # numpy is not loaded yet; its matrices here are so small that BLAS threads would mostly wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from flexplant.study.examples import example_study

    _run(example_study("shocksat"), output, quiet, allow_outside=False)


@told
def run(
    study: Annotated[Path, typer.Argument(help="Study file (YAML).")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for the results; default STUDY-results.")] = None,
    allow_outside: Outside = False,
    quiet: Quiet = False,
) -> None:
    """Run a study: read, couple, verify, respond, close the loop, report."""
    look(study)
    _run(study, output or Path(f"{study.stem}-results"), quiet, allow_outside)


def _run(study: Path, output: Path, quiet: bool, allow_outside: bool) -> None:
    from flexplant.study.pipeline import run_study

    with progress_bar(quiet) as progress:
        result = run_study(study, output=output, allow_outside=allow_outside, progress=progress)
    typer.echo(result.text())
    if not result.checks.passed:
        raise end(f"{len(result.checks.failed)} checks failed: {', '.join(c.name for c in result.checks.failed)}", FAILED)
