"""`flexplant inspect` and `flexplant convert`: what is in files, and the same in another format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from flexplant.cli.options import Force, Format, Reading, Units, format_options
from flexplant.cli.told import look, told


@told
def inspect_files(
    files: Annotated[list[Path], typer.Argument(help="Component, model, plant or geometry files.")],
    format: Format = None,  # noqa: A002
    units: Units = None,
    option: Reading = None,
) -> None:
    """Show what is in files: DOF, boundary, modes, mass, recovery labels, first frequencies."""
    look(*files)
    from flexplant.io import inspect

    options = format_options(option)
    typer.echo("\n\n".join(str(inspect(file, format=format, units=units, **options)) for file in files))


@told
def convert_file(
    source: Annotated[Path, typer.Argument(help="Component, model or plant file.")],
    target: Annotated[Path, typer.Argument(help="File to write; its ending chooses the format.")],
    format: Format = None,  # noqa: A002
    units: Units = None,
    dt: Annotated[float | None, typer.Option(help="Sample time in seconds, for C source.")] = None,
    openfast: Annotated[int | None, typer.Option(help="Major version of OpenFAST, for .extptfm (default 4).")] = None,
    option: Reading = None,
    drop: Annotated[
        list[str] | None, typer.Option(help="Leave out what the target cannot hold: recovery, interior or structural_damping.")
    ] = None,
    force: Force = False,
) -> None:
    """Put a component, model or plant into another format (docs/formats.md lists them)."""
    look(source)
    from flexplant.io import convert

    given: dict[str, Any] = {"dt": dt, "openfast": openfast}
    options = {name: value for name, value in given.items() if value is not None}
    reading: dict[str, Any] = {"format": format, "units": units, "read_options": format_options(option)}
    typer.echo(f"wrote {convert(source, target, overwrite=force, drop=drop or [], **reading, **options)}")
