"""`flexplant reduce`: a model becomes a component."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import flexplant.cli.reduce_options as o
from flexplant.cli.options import Force, Format, Quiet, Reading, Units, format_options
from flexplant.cli.progress import progress_bar
from flexplant.cli.told import look, told
from flexplant.errors import InputError, SolverError

if TYPE_CHECKING:
    from flexplant.model.component import Component, FiniteElementModel

WORDS = {  # of the library, and of the command line
    "max_frequency_hz": "--max-frequency",
    "n_modes": "--modes",
    "residual_vectors": "--residual-vectors",
    "keep_basis": "--keep-basis",
    "geometry=": "--geometry",
    "radius_m": "the radius",
    "position_m": "its place",
}
INTERFACE_WORDS = {"max_frequency_hz": "--interface-frequency", "n_modes": "--interface-modes"}


@told
def reduce(
    model: o.Model,
    boundary: o.Boundary,
    output: o.Output,
    method: o.Method = "craig_bampton",
    max_frequency: o.MaxFrequency = None,
    modes: o.Count = None,
    residual_vectors: o.Ritz = None,
    accuracy: o.Accuracy = None,
    size: o.Size = None,
    average_patch: o.AveragePatch = None,
    rigid_patch: o.RigidPatch = None,
    loads: o.Loads = None,
    recover: o.Recover = None,
    keep: o.Keep = None,
    interface_modes: o.InterfaceModes = None,
    interface_frequency: o.InterfaceFrequency = None,
    keep_basis: o.KeepBasis = False,
    geometry: o.Geometry = None,
    name: o.Name = None,
    force: Force = False,
    format: Format = None,  # noqa: A002
    units: Units = None,
    option: Reading = None,
    quiet: Quiet = False,
) -> None:
    """Reduce a model to a Hurty/Craig-Bampton component, check it and write it."""
    look(model)
    from flexplant.io import read_model
    from flexplant.study.outputs import check_component_target
    from flexplant.study.reduction import check_method

    reading: dict[str, Any] = format_options(option) | ({} if geometry is None else {"geometry": geometry})
    sources = [model, *([geometry] if geometry else [])]
    extras = {"interior": loads is not None, "recovery": recover is not None, "basis": keep_basis}
    check_component_target(output, sources, overwrite=force, **extras)
    given: dict[str, Any] = {"max_frequency_hz": max_frequency, "n_modes": modes, "residual_vectors": residual_vectors}
    given |= {"accuracy": accuracy, "size": size, "keep_basis": keep_basis or None, **_rows(loads=loads, recover=recover)}
    given = {key: value for key, value in given.items() if value is not None}
    with _words():
        check_method(method, given)
    given |= {"method": method, "interface_nodes": _patches(average_patch or [], rigid_patch or []), **_rows(boundary=boundary)}
    given["characteristic"] = _characteristic(_rows(keep=keep), interface_modes, interface_frequency)
    full = read_model(model, format=format, units=units, name=name, **reading)
    _write(_reduced(full, quiet, given), output, keep_basis, force, len(full.dofs))


def _reduced(model: FiniteElementModel, quiet: bool, given: dict[str, Any]) -> Component:
    from flexplant.study.reduction import reduce_model

    with progress_bar(quiet) as progress, _words():
        return reduce_model(model, progress=progress, **given)


def _write(component: Component, output: Path, basis: bool, force: bool, size_before: int) -> None:
    """The component's checks and report on the terminal, and its file."""
    from flexplant.io import write_component
    from flexplant.study.tables import component_text
    from flexplant.verification import check_component

    typer.echo(component_text(component, check_component(component)))
    typer.echo(f"\n{component.source['reduction']}")
    kept = {"basis": True} if basis else {}
    target = write_component(component, output, overwrite=force, **kept)
    typer.echo(f"reduced {size_before} DOF to {component.n}; wrote {target}")


def _rows(**texts: str | None) -> dict[str, Any]:
    """The DOF of those options that were given."""
    from flexplant.model.dofs import DofSet
    from flexplant.study.arguments import parse_boundary
    from flexplant.study.reduction import told_of

    rows: dict[str, Any] = {}
    for key, text in texts.items():
        if text is not None:
            with told_of(f"--{key}"):
                DofSet.of(rows.setdefault(key, parse_boundary(text)))
    return rows


def _patches(average: list[str], rigid: list[str]) -> list[dict[str, Any]]:
    from flexplant.study.arguments import parse_patch

    return [parse_patch(text, "average") for text in average] + [parse_patch(text, "rigid") for text in rigid]


def _characteristic(keep: dict[str, Any], modes: int | None, frequency: float | None) -> dict[str, Any] | None:
    """What `characteristic_constraint_modes` takes, or None where no interface is to be described so."""
    if not keep and modes is None and frequency is None:
        return None
    if not keep or (modes is None) == (frequency is None):
        raise InputError("characteristic modes need --keep, and either --interface-modes or --interface-frequency")
    return {**keep, "n_modes": modes, "max_frequency_hz": frequency}


@contextmanager
def _words() -> Iterator[None]:
    """Errors of the library with the names that its arguments have on the command line."""
    try:
        yield
    except (InputError, SolverError) as error:
        text = str(error)
        for word, option in (INTERFACE_WORDS if text.startswith("characteristic") else WORDS).items():
            text = re.sub(rf"\b{word}", option, text)
        raise type(error)(*text.splitlines()) from None
