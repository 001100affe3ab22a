"""What is in a file, and putting it into another format."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexplant.errors import InputError, PlausibilityWarning, ReadError
from flexplant.io.described import Rows, mesh_rows, model_rows, plant_rows, reference_rows, result_rows
from flexplant.io.parse.files import as_path, read_head
from flexplant.io.parse.h5 import SIGNATURE
from flexplant.io.plausibility import Model
from flexplant.io.registry import Units, read_component, read_geometry, read_model, recognise
from flexplant.io.write.ownership import is_file, written_as
from flexplant.model.component import Component
from flexplant.model.table import Table

if TYPE_CHECKING:
    from flexplant.io.parse.own_plant import Plant

NETCDF, UNIVERSAL = (".nc", ".nc4"), b"    -1"


def inspect(path: str | Path, *, format: str | None = None, units: Units | None = None, **options: Any) -> Table:  # noqa: A002
    """A table of what a file holds: kind, DOF, boundary, modes, mass, recovery labels, first frequencies, plausibility.

    Arguments as in `read_component`. Raises ReadError for a file that no reader takes.
    """
    rows = tuple(_rows(path, format, units, options))
    return Table(Path(path).name, ("what", "value"), rows)


def _rows(path: str | Path, wanted: str | None, units: Units | None, options: dict[str, Any]) -> Rows:
    try:
        with warnings.catch_warnings():  # its rows say the same, and more
            warnings.simplefilter("ignore", PlausibilityWarning)
            value = read_any(path, format=wanted, units=units, **options)
    except ReadError as error:
        if wanted is None and _is_results(as_path(path)):
            return result_rows(as_path(path))
        if wanted is None and _is_universal(as_path(path)):
            return reference_rows(as_path(path), units)
        if not _reads_as_geometry(path, wanted):
            raise error from None
        return mesh_rows(read_geometry(path, format=wanted, units=units))
    return model_rows(value) if isinstance(value, Model) else plant_rows(value)


def convert(
    path: str | Path,
    target: str | Path,
    *,
    format: str | None = None,  # noqa: A002
    units: Units | None = None,
    name: str | None = None,
    read_options: Mapping[str, Any] | None = None,
    drop: Iterable[str] = (),
    overwrite: bool = False,
    **write_options: Any,
) -> Path:
    """Read a component, model or plant and write it in the format of the target's ending; returns the target.

    format, units, name, read_options: for reading, the last of the format that is read, such as {"superelement": 101}.
    write_options: of the written format, such as dt for C source. overwrite: as for `write_component`.
    drop: parts of a component to leave out: "recovery", "interior", "structural_damping".
    Raises ReadError for what cannot be read, InputError where the target cannot hold it or is the file itself, WriteError
    where a file would be replaced that belongs to the source or is somebody else's.
    """
    if as_path(target).resolve() == as_path(path).resolve():
        raise InputError(f"{path} is that file already; name another target")
    from flexplant.io.output import dropped, without, write_component, write_model, write_plant

    drop = dropped(drop)
    if not (read_options is None or isinstance(read_options, Mapping)):
        raise InputError(f"convert: read_options must be a mapping such as {{'superelement': 101}}, got {read_options!r:.60}")
    options = dict(read_options or {}) | ({} if name is None else {"name": name})
    value = read_any(path, format=format, units=units, **options)
    if isinstance(value, Component):
        return write_component(without(value, drop), target, overwrite=overwrite, **write_options)
    if isinstance(value, Model):
        return write_model(value, target, overwrite=overwrite, **write_options)
    return write_plant(value, target, overwrite=overwrite, sources=[path], **write_options)


def read_any(
    path: str | Path,
    *,
    format: str | None = None,  # noqa: A002
    units: Units | None = None,
    **options: Any,
) -> Model | Plant:
    """The component, finite-element model or plant in a file, whichever it is; the first reader's ReadError if none."""
    problems: list[ReadError] = []
    for what, reader in (("read_component", read_component), ("read_model", read_model)):
        try:
            recognise(path, format, what)
            model: Model = reader(path, format=format, units=units, **options)
        except ReadError as error:
            problems.append(error)
        else:
            return model
    if format is None:
        from flexplant.io.output import read_plant

        try:
            return read_plant(path)
        except ReadError as error:
            problems.append(error)
    known = [p for p in problems if "not recognised" not in str(p) and "not a plant" not in str(p)]
    raise (known or problems)[0]


def _reads_as_geometry(path: str | Path, wanted: str | None) -> bool:
    try:
        recognise(path, wanted, "read_geometry")
    except ReadError:
        return False
    return True


def _is_results(path: Path) -> bool:
    return is_file(path) and (written_as(path) == "netcdf" or (path.suffix in NETCDF and read_head(path).startswith(SIGNATURE)))


def _is_universal(path: Path) -> bool:
    return is_file(path) and read_head(path)[:80].split(b"\n")[0].rstrip() == UNIVERSAL
