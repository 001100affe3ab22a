"""`flexplant reduce`: a model becomes a component."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from flexplant.cli.options import Force, Format, Reading, Units, format_options
from flexplant.cli.told import look, told


@told
def reduce(
    model: Annotated[Path, typer.Argument(help="Unreduced model: mass and stiffness with their DOF.")],
    boundary: Annotated[str, typer.Option(help="node,node:directions; several groups separated by blanks.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Component file to write (.npz or .h5).")],
    max_frequency: Annotated[float | None, typer.Option(help="Fixed-interface modes up to here, Hz.")] = None,
    modes: Annotated[int | None, typer.Option(help="Or this many of them.")] = None,
    residual_vectors: Annotated[
        int, typer.Option("--residual-vectors", "--ritz", help="Blocks of load-dependent Ritz vectors beside the modes.")
    ] = 0,
    accuracy: Annotated[float | None, typer.Option(help="Instead: relative frequency error up to --max-frequency.")] = None,
    size: Annotated[
        int | None, typer.Option(help="Instead: modal coordinates to spend on frequencies up to --max-frequency.")
    ] = None,
    geometry: Annotated[Path | None, typer.Option(help="Deck with the node positions that the model lacks.")] = None,
    name: Annotated[str | None, typer.Option(help="Name of the component; left out: that of the model's file.")] = None,
    force: Force = False,
    format: Format = None,  # noqa: A002
    units: Units = None,
    option: Reading = None,
) -> None:
    """Reduce a model to a Hurty/Craig-Bampton component, check it and write it."""
    look(model)
    from flexplant.io import read_model, write_component
    from flexplant.io.output import check_target
    from flexplant.reduction import craig_bampton
    from flexplant.study.assemble import parse_boundary
    from flexplant.study.outputs import require_folder_of
    from flexplant.study.tables import component_text
    from flexplant.verification import check_component

    require_folder_of(output)
    options: dict[str, Any] = format_options(option) | ({} if geometry is None else {"geometry": geometry})
    check_target("write_component", output, [model, *([geometry] if geometry else [])], overwrite=force)
    full = read_model(model, format=format, units=units, name=name, **options)
    how: dict[str, Any] = {"max_frequency_hz": max_frequency, "n_modes": modes, "residual_vectors": residual_vectors}
    component = craig_bampton(full, parse_boundary(boundary), **how, accuracy=accuracy, size=size)
    typer.echo(component_text(component, check_component(component)))
    typer.echo(f"\n{component.report}")
    typer.echo(f"reduced {len(full.dofs)} DOF to {component.n}; wrote {write_component(component, output, overwrite=force)}")
