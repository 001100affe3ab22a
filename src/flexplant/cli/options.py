"""Options that several commands take."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from flexplant.errors import InputError

Format = Annotated[str | None, typer.Option(help="Format name; left out: decided by the file itself.")]
Units = Annotated[str | None, typer.Option(help="Units of the files, such as SI or mm-tonne-s.")]
Reading = Annotated[
    list[str] | None,
    typer.Option("--option", "-O", help="Option of the format read (docs/formats.md): superelement=101, part=2, sidecar=a.yaml."),
]
OWN_OPTIONS = ("format", "name", "units", "damping")  # of every format, so not for --option
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress display.")]
Force = Annotated[bool, typer.Option("--force", help="Replace a file that something else wrote; never one that is read.")]
Outside = Annotated[bool, typer.Option("--allow-outside", help="Let the study name files outside its folder.")]


def format_options(given: list[str] | None) -> dict[str, Any]:
    """Options NAME=VALUE, for the format to make of them what it needs."""
    from flexplant.io.options import Written

    pairs = [text.partition("=") for text in given or []]
    if wrong := [name for name, equals, _ in pairs if not name or not equals]:
        raise InputError(f"--option {wrong[0]!r}: write name=value, such as superelement=101")
    if own := [name for name, _, _ in pairs if name in OWN_OPTIONS]:
        raise InputError(f"--option {own[0]}: this is no option of a format; see --{own[0]} in --help")
    return {name: Written(value) for name, _, value in pairs}
