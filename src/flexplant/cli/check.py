"""`flexplant check`: components by themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexplant.cli.options import Format, Reading, Units, format_options
from flexplant.cli.told import FAILED, end, look, told


@told
def check(
    files: Annotated[list[Path], typer.Argument(help="Component files.")],
    format: Format = None,  # noqa: A002 - the name of the option
    units: Units = None,
    option: Reading = None,
) -> None:
    """Check components by themselves: symmetry, mass properties, rigid-body energy, fixed-interface modes."""
    look(*files)
    from flexplant.io import read_component
    from flexplant.study.tables import component_text
    from flexplant.verification import check_component

    failed = []
    for file in files:
        component = read_component(file, format=format, units=units, **format_options(option))
        if str(component.source.get("units", "")).startswith("not stated"):
            typer.echo(f"{file.name}: units are not stated; the numbers are taken as SI (--units says otherwise)\n")
        report = check_component(component)
        typer.echo(component_text(component, report))
        failed += [c.name for c in report.failed]
    if failed:
        raise end(f"{len(failed)} checks failed: {', '.join(failed)}", FAILED)
