"""The command line: it reads arguments, calls the library and prints; nothing is computed here."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from flexplant.cli.check import check
from flexplant.cli.couple import couple
from flexplant.cli.export import export
from flexplant.cli.files import convert_file, inspect_files
from flexplant.cli.new import new, schema
from flexplant.cli.reduce import reduce
from flexplant.cli.run import demo, run

EPILOG = "Exit codes: 0 done, 1 a check failed or a computation did not converge, 2 bad input, 130 interrupted."

app = typer.Typer(
    name="flexplant",
    help="Finite-element component models to a flexible structural plant: read, couple, verify, respond, close the loop.",
    epilog=EPILOG,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

_COMMANDS = (  # in the order of --help, each with an example
    (demo, "demo -o results"),
    (run, "run study.yaml -o results"),
    (check, "check bus.op4 optic.op4 --units mm-kg-s"),
    (
        reduce,
        "reduce bus_KM.npz --boundary 9001,9201:123456 --modes 80 --ritz 2 -o bus.npz; by Rubin, a flange as one node: flexplant "
        "reduce plate.npz --method rubin --average-patch 500=17-40 --boundary 500 --modes 20 -o plate_reduced.npz",
    ),
    (couple, "couple bus.op4 optic.op4 --connect bus:optic:3,11,19,27 -o system.npz"),
    (export, "export results/plant.npz --to mat"),
    (inspect_files, "inspect bus.op4 --units mm-kg-s"),
    (convert_file, "convert bus.op4 bus.h5 --units mm-kg-s"),
    (new, "new study.yaml"),
    (schema, "schema > study.schema.json"),
)
for _command, _example in _COMMANDS:
    app.command(_example.split()[0], epilog=f"Example: flexplant {_example}")(_command)


def _version(show: bool) -> None:
    if show:
        from importlib.metadata import version

        typer.echo(f"flexplant {version('flexplant')}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    pass


def main() -> Any:
    """Entry point of the `flexplant` command."""
    return app()
