"""The command line: it reads arguments, calls the library and prints; nothing is computed here."""

from __future__ import annotations

import functools
import glob
import os
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, ParamSpec, TypeVar

import typer

from flexplant.errors import CheckFailedError, FlexplantError, InputError, PlausibilityWarning, ReadError, SolverError

OK, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
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
P = ParamSpec("P")
R = TypeVar("R")
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


def _told(command: Callable[P, R]) -> Callable[P, R]:
    """The command with its foreseen errors told in one line on stderr and turned into exit codes."""

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            with _notes():
                return command(*args, **kwargs)
        except (CheckFailedError, SolverError) as error:
            raise _end(str(error), FAILED) from None
        except FlexplantError as error:
            raise _end(_hinted(str(error)), BAD_INPUT) from None
        except OSError as error:
            raise _end(f"{error.filename or 'file'}: {error.strerror or error}", BAD_INPUT) from None
        except MemoryError:
            raise _end("not enough memory for this model", FAILED) from None
        except KeyboardInterrupt:
            raise _end("interrupted; nothing was written", INTERRUPTED) from None

    return wrapped


@contextmanager
def _notes() -> Iterator[None]:
    """Warnings about implausible numbers as one line each on stderr, a file's once."""
    with warnings.catch_warnings():
        warnings.simplefilter("default", PlausibilityWarning)
        shown = warnings.showwarning

        def tell(message: Any, category: Any, *rest: Any, **more: Any) -> None:
            if issubclass(category, PlausibilityWarning):
                typer.echo(f"flexplant: note: {message}", err=True)
            else:
                shown(message, category, *rest, **more)

        warnings.showwarning = tell
        yield


def _look(*paths: Path) -> None:
    """ReadError for a file that is not there, before anything large is imported; a stem without ending may stand for a file."""
    for path in paths:
        if path.exists():
            continue
        beside = sorted(p.name for p in path.parent.glob(f"{glob.escape(path.stem)}.*"))[:8] if path.stem else []
        if path.suffix or not beside:
            raise ReadError(path, "no such file" + (f"; beside it: {', '.join(beside)}" if beside else ""))


def _hinted(text: str) -> str:
    """An error of the library with the command line's words for the option that it asks for."""
    asked = re.search(r"pass (\w+)=", text)
    if asked is None or asked[1] in ("overwrite", *OWN_OPTIONS):
        return text
    return f"{text} (here: --option {asked[1]}=...)"


def _end(text: str, code: int) -> typer.Exit:
    typer.echo("\n".join(f"flexplant: {line}" for line in text.splitlines()), err=True)
    return typer.Exit(code)


def _reading(given: list[str] | None) -> dict[str, Any]:
    """Options NAME=VALUE, for the format to make of them what it needs."""
    from flexplant.io.options import Written

    pairs = [text.partition("=") for text in given or []]
    if wrong := [name for name, equals, _ in pairs if not name or not equals]:
        raise InputError(f"--option {wrong[0]!r}: write name=value, such as superelement=101")
    if own := [name for name, _, _ in pairs if name in OWN_OPTIONS]:
        raise InputError(f"--option {own[0]}: this is no option of a format; see --{own[0]} in --help")
    return {name: Written(value) for name, _, value in pairs}


@contextmanager
def _progress(quiet: bool) -> Iterator[Callable[[str, float], None] | None]:
    """A callback (text, done share) that drives a progress bar on stderr."""
    if quiet:
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<44}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"), TimeElapsedColumn())
    bar = Progress(*columns, console=Console(stderr=True))
    task = bar.add_task("start", total=1.0)

    def show(text: str, share: float) -> None:
        bar.start()  # not before the first step, so that a bad study file is told in one line
        bar.update(task, description=text, completed=share)

    try:
        yield show
    finally:
        if bar.live.is_started:  # stopping what never began would print an empty line
            bar.stop()


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


@app.command(epilog="Example: flexplant demo -o results")
@_told
def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path("flexplant-demo"),
    quiet: Quiet = False,
) -> None:
    """Run the ShockSat-like example: two components to a closed-loop line-of-sight report."""
    # numpy is not loaded yet; its matrices here are so small that BLAS threads would mostly wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from flexplant.study.examples import example_study

    _run(example_study("shocksat"), output, quiet, allow_outside=False)


@app.command(epilog="Example: flexplant run study.yaml -o results")
@_told
def run(
    study: Annotated[Path, typer.Argument(help="Study file (YAML).")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for the results; default STUDY-results.")] = None,
    allow_outside: Outside = False,
    quiet: Quiet = False,
) -> None:
    """Run a study: read, couple, verify, respond, close the loop, report."""
    _look(study)
    _run(study, output or Path(f"{study.stem}-results"), quiet, allow_outside)


def _run(study: Path, output: Path, quiet: bool, allow_outside: bool) -> None:
    from flexplant.study.pipeline import run_study

    with _progress(quiet) as progress:
        result = run_study(study, output=output, allow_outside=allow_outside, progress=progress)
    typer.echo(result.text())
    if not result.checks.passed:
        raise _end(f"{len(result.checks.failed)} checks failed: {', '.join(c.name for c in result.checks.failed)}", FAILED)


@app.command(epilog="Example: flexplant check bus.op4 optic.op4 --units mm-kg-s")
@_told
def check(
    files: Annotated[list[Path], typer.Argument(help="Component files.")],
    format: Format = None,  # noqa: A002 - the name of the option
    units: Units = None,
    option: Reading = None,
) -> None:
    """Check components by themselves: symmetry, mass properties, rigid-body energy, fixed-interface modes."""
    _look(*files)
    from flexplant.io import read_component
    from flexplant.study.tables import component_text
    from flexplant.verification import check_component

    failed = []
    for file in files:
        component = read_component(file, format=format, units=units, **_reading(option))
        if str(component.source.get("units", "")).startswith("not stated"):
            typer.echo(f"{file.name}: units are not stated; the numbers are taken as SI (--units says otherwise)\n")
        report = check_component(component)
        typer.echo(component_text(component, report))
        failed += [c.name for c in report.failed]
    if failed:
        raise _end(f"{len(failed)} checks failed: {', '.join(failed)}", FAILED)


@app.command(epilog="Example: flexplant reduce bus_KM.npz --boundary 9001,9201:123456 --modes 80 --ritz 2 -o bus.npz")
@_told
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
    _look(model)
    from flexplant.io import read_model, write_component
    from flexplant.io.output import check_target
    from flexplant.reduction import craig_bampton
    from flexplant.study.assemble import parse_boundary
    from flexplant.study.outputs import require_folder_of
    from flexplant.study.tables import component_text
    from flexplant.verification import check_component

    require_folder_of(output)
    options: dict[str, Any] = _reading(option) | ({} if geometry is None else {"geometry": geometry})
    check_target("write_component", output, [model, *([geometry] if geometry else [])], overwrite=force)
    full = read_model(model, format=format, units=units, name=name, **options)
    how: dict[str, Any] = {"max_frequency_hz": max_frequency, "n_modes": modes, "residual_vectors": residual_vectors}
    component = craig_bampton(full, parse_boundary(boundary), **how, accuracy=accuracy, size=size)
    typer.echo(component_text(component, check_component(component)))
    typer.echo(f"\n{component.report}")
    typer.echo(f"reduced {len(full.dofs)} DOF to {component.n}; wrote {write_component(component, output, overwrite=force)}")


@app.command(epilog="Example: flexplant couple bus.op4 optic.op4 --connect bus:optic:3,11,19,27 -o system.npz")
@_told
def couple(
    files: Annotated[list[Path], typer.Argument(help="Component files, named after the files.")],
    connect: Annotated[
        list[str] | None,
        typer.Option("--connect", "-c", help="a:b:node,node (the same ids on both sides), or a:b for matching by position."),
    ] = None,
    ground: Annotated[list[str] | None, typer.Option(help="component:node,node to hold fixed.")] = None,
    method: Annotated[str, typer.Option(help="dual or primal.")] = "dual",
    max_frequency: Annotated[float | None, typer.Option(help="Highest frequency listed, Hz.")] = None,
    rigid_body_modes: Annotated[int, typer.Option(help="Expected number of rigid-body modes.")] = 6,
    format: Format = None,  # noqa: A002
    units: Units = None,
    option: Reading = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the coupled matrices to this .npz file.")] = None,
    force: Force = False,
) -> None:
    """Couple components and print the free-free table."""
    _look(*files)
    from flexplant.assembly import couple as assemble
    from flexplant.io import read_component
    from flexplant.modes import normal_modes
    from flexplant.study.assemble import parse_connection, parse_ground
    from flexplant.study.outputs import check_system_target, write_system
    from flexplant.study.tables import modes_table
    from flexplant.verification import verify

    if output is not None:
        check_system_target(output, files, overwrite=force)
    reading: dict[str, Any] = {"format": format, "units": units, **_reading(option)}
    components = [read_component(file, name=file.stem, **reading) for file in files]
    connections = [parse_connection(text) for text in connect or []] + [parse_ground(text) for text in ground or []]
    system = assemble(components, connections, method=method)
    modes = normal_modes(system, max_frequency_hz=max_frequency)
    report = verify(system, rigid_body_modes=rigid_body_modes, modes=modes)
    typer.echo(f"{report}\n\n{modes_table(modes)}")
    if output is not None:
        typer.echo(f"\nwrote {write_system(system, output, overwrite=force)}")
    report.raise_if_failed()


@app.command(epilog="Example: flexplant export results/plant.npz --to mat")
@_told
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
    _look(plant)
    from flexplant.study.outputs import export_plant

    options = {key: value for key, value in (("dt", dt), ("hold", hold), ("version", fmi)) if value is not None}
    typer.echo(f"wrote {export_plant(plant, to, output, overwrite=force, **options)}")


@app.command("inspect", epilog="Example: flexplant inspect bus.op4 --units mm-kg-s")
@_told
def inspect_files(
    files: Annotated[list[Path], typer.Argument(help="Component, model, plant or geometry files.")],
    format: Format = None,  # noqa: A002
    units: Units = None,
    option: Reading = None,
) -> None:
    """Show what is in files: DOF, boundary, modes, mass, recovery labels, first frequencies."""
    _look(*files)
    from flexplant.io import inspect

    options = _reading(option)
    typer.echo("\n\n".join(str(inspect(file, format=format, units=units, **options)) for file in files))


@app.command("convert", epilog="Example: flexplant convert bus.op4 bus.h5 --units mm-kg-s")
@_told
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
    _look(source)
    from flexplant.io import convert

    given: dict[str, Any] = {"dt": dt, "openfast": openfast}
    options = {name: value for name, value in given.items() if value is not None}
    reading: dict[str, Any] = {"format": format, "units": units, "read_options": _reading(option)}
    typer.echo(f"wrote {convert(source, target, overwrite=force, drop=drop or [], **reading, **options)}")


@app.command(epilog="Example: flexplant new study.yaml")
@_told
def new(path: Annotated[Path, typer.Argument(help="Study file to write.")] = Path("study.yaml")) -> None:
    """Write a commented starter study."""
    from flexplant.study.outputs import write_new
    from flexplant.study.reference import STARTER

    typer.echo(f"wrote {write_new(path, STARTER)}; edit it, then: flexplant run {path}")


@app.command(epilog="Example: flexplant schema > study.schema.json")
@_told
def schema(
    markdown: Annotated[bool, typer.Option("--markdown", help="The reference page instead of the JSON schema.")] = False,
) -> None:
    """Print the study file's JSON schema for editors, or its reference page."""
    from flexplant.study import reference

    typer.echo(reference.markdown() if markdown else reference.json_schema(), nl=False)


def main() -> Any:
    """Entry point of the `flexplant` command."""
    return app()
