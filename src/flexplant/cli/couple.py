"""`flexplant couple`: components become a system."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from flexplant.cli.options import Force, Format, Reading, Units, format_options
from flexplant.cli.told import look, told


@told
def couple(
    files: Annotated[list[Path], typer.Argument(help="Component files, named after the files.")],
    connect: Annotated[
        list[str] | None,
        typer.Option(
            "--connect",
            "-c",
            help="a:b:node,node (the same ids on both sides), or a:b (by position); a:b::123 joins some directions only.",
        ),
    ] = None,
    ground: Annotated[list[str] | None, typer.Option(help="component:node,node to hold fixed.")] = None,
    method: Annotated[str, typer.Option(help="dual or primal.")] = "dual",
    interface_modes: Annotated[
        list[str] | None,
        typer.Option(help="a-b=12: describe what joins a and b by 12 characteristic modes, the same coordinates on both sides."),
    ] = None,
    max_frequency: Annotated[float | None, typer.Option(help="Highest frequency listed, Hz.")] = None,
    rigid_body_modes: Annotated[int, typer.Option(help="Expected number of rigid-body modes.")] = 6,
    format: Format = None,  # noqa: A002
    units: Units = None,
    option: Reading = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the coupled matrices to this .npz file.")] = None,
    force: Force = False,
) -> None:
    """Couple components and print the free-free table."""
    look(*files)
    from flexplant.assembly import characteristic_interface
    from flexplant.assembly import couple as assemble
    from flexplant.io import read_component
    from flexplant.modes import normal_modes
    from flexplant.study.arguments import parse_connection, parse_ground, parse_interface
    from flexplant.study.outputs import check_system_target, write_system
    from flexplant.study.tables import modes_table
    from flexplant.verification import verify

    if output is not None:
        check_system_target(output, files, overwrite=force)
    reading: dict[str, Any] = {"format": format, "units": units, **format_options(option)}
    asked = [parse_interface(text) for text in interface_modes or []]
    components = [read_component(file, name=file.stem, **reading) for file in files]
    connections = [parse_connection(text) for text in connect or []] + [parse_ground(text) for text in ground or []]
    system = assemble(components, connections, method=method)
    for name, count in asked:
        system = characteristic_interface(system, name, n_modes=count)
    modes = normal_modes(system, max_frequency_hz=max_frequency)
    report = verify(system, rigid_body_modes=rigid_body_modes, modes=modes)
    typer.echo(f"{report}\n\n{modes_table(modes)}")
    if output is not None:
        typer.echo(f"\nwrote {write_system(system, output, overwrite=force)}")
    report.raise_if_failed()
