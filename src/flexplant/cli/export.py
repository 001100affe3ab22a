"""`flexplant export`: a plant for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexplant.cli.options import Force
from flexplant.cli.told import look, told


@told
def export(
    plant: Annotated[Path, typer.Argument(help="Plant file (.npz) that a study wrote.")],
    to: Annotated[str, typer.Option(help="c, fmu, h5, hdf5, jl, m, mat or npz.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="File to write; default beside the plant.")] = None,
    dt: Annotated[float | None, typer.Option(help="Seconds: sample time of c, suggested communication step of fmu.")] = None,
    hold: Annotated[str | None, typer.Option(help="Inputs of c between samples: zero (held) or first (linear).")] = None,
    fmi: Annotated[int | None, typer.Option(help="FMI version of fmu: 2, or 3 with arrays.")] = None,
    force: Force = False,
) -> None:
    """Write a plant for another program: C source (c), FMU, MATLAB or Octave (m, mat), Julia (jl), numpy (npz), HDF5 (h5)."""
    look(plant)
    from flexplant.study.outputs import export_plant

    options = {key: value for key, value in (("dt", dt), ("hold", hold), ("version", fmi)) if value is not None}
    typer.echo(f"wrote {export_plant(plant, to, output, overwrite=force, **options)}")
