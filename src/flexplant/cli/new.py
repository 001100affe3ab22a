"""`flexplant new` and `flexplant schema`: a study to start from, and what it may say."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexplant.cli.told import told


@told
def new(path: Annotated[Path, typer.Argument(help="Study file to write.")] = Path("study.yaml")) -> None:
    """Write a commented starter study."""
    from flexplant.study.outputs import write_new
    from flexplant.study.reference import STARTER

    typer.echo(f"wrote {write_new(path, STARTER)}; edit it, then: flexplant run {path}")


@told
def schema(
    markdown: Annotated[bool, typer.Option("--markdown", help="The reference page instead of the JSON schema.")] = False,
) -> None:
    """Print the study file's JSON schema for editors, or its reference page."""
    from flexplant.study import reference

    typer.echo(reference.markdown() if markdown else reference.json_schema(), nl=False)
