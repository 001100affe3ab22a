"""What is in a file, and putting it into another format."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from flexplant.errors import InputError, PlausibilityWarning, ReadError
from flexplant.io.output import dropped, read_plant, without, write_component, write_model, write_plant
from flexplant.io.parse.files import as_path, read_head
from flexplant.io.parse.h5 import SIGNATURE
from flexplant.io.parse.own_plant import Plant
from flexplant.io.plausibility import Model, first_frequencies, plausibility, quantities
from flexplant.io.registry import Units, read_component, read_geometry, read_model, recognise
from flexplant.io.write.ownership import is_file, written_as
from flexplant.model.component import Component
from flexplant.plant.modal import ModalPlant
from flexplant.verification.checks import Table

SHOWN = 12
NETCDF = (".nc", ".nc4")


def inspect(path: str | Path, *, format: str | None = None, units: Units | None = None, **options: Any) -> Table:  # noqa: A002
    """A table of what a file holds: kind, DOF, boundary, modes, mass, recovery labels, first frequencies, plausibility.

    Arguments as in `read_component`. Raises ReadError for a file that no reader takes.
    """
    try:
        with warnings.catch_warnings():  # its rows say the same, and more
            warnings.simplefilter("ignore", PlausibilityWarning)
            value: Any = read_any(path, format=format, units=units, **options)
    except ReadError as error:
        if format is None and _is_results(as_path(path)):
            return Table(Path(path).name, ("what", "value"), tuple(_result_rows(as_path(path))))
        if not _reads_as_geometry(path, format):
            raise error from None
        mesh = read_geometry(path, format=format)
        rows: list[tuple[object, ...]] = [("kind", "geometry"), ("nodes", len(mesh.nodes))]
        rows += [("surfaces", len(mesh.quads)), ("lines", len(mesh.lines))]
        return Table(Path(path).name, ("what", "value"), tuple(rows))
    described = _plant_rows(value) if not isinstance(value, Model) else _model_rows(value)
    return Table(Path(path).name, ("what", "value"), tuple(described))


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


def _result_rows(path: Path) -> list[tuple[object, ...]]:
    """Title, and every variable with its dimensions, range of its coordinates and units."""
    from flexplant.io.parse.netcdf import read_results

    data = read_results(path)
    rows: list[tuple[object, ...]] = [("kind", "results (NetCDF-4)")]
    rows += [("title", data.attrs["title"])] if "title" in data.attrs else []
    for name, values in data.data_vars.items():
        sizes = " x ".join(f"{size} {dim}" for dim, size in values.sizes.items()) or "one number"
        units = f" [{values.attrs['units']}]" if "units" in values.attrs else ""
        rows.append((name, f"{values.dtype}, {sizes}{units}"))
    return rows


def _model_rows(model: Model) -> list[tuple[object, ...]]:
    hz, problem = first_frequencies(model, SHOWN)
    found = replace(quantities(model, modes=False), frequency_hz=next((f for f in hz if f > 0), None))
    component = isinstance(model, Component)
    rows: list[tuple[object, ...]] = [
        ("kind", "component" if component else "finite-element model"),
        ("name", model.name),
        ("format", model.source.get("format", "")),
        ("units", model.source.get("units", model.units)),
        ("degrees of freedom", len(model.dofs)),
    ]
    if isinstance(model, Component):
        rows += [
            ("boundary", f"{model.n_boundary} DOF at nodes {_some(model.boundary.nodes)}"),
            ("modal coordinates", model.n_modal),
            ("fixed-interface modes [Hz]", _some([f"{f:.5g}" for f in model.fixed_interface_hz])),
            ("recovery", _some([f"{r.name} ({len(r.labels)} rows: {r.labels[0]} ...)" for r in model.recovery.values()])),
        ]
    rows += [
        ("damping", "none" if model.damping is None else "given"),
        ("mass", "no node positions" if found.mass is None else f"{found.mass:.7g}"),
        ("extent", "" if found.size is None else f"{found.size:.5g}"),
        ("first frequencies [Hz]", _some([f"{f:.5g}" for f in hz]) or f"none: {problem}"),
        ("left out", _some(model.source.get("unused", []))),
        ("sha256", str(model.source.get("sha256", ""))[:16]),
    ]
    rows += [("note", text) for text in plausibility(model, found)]
    return [row for row in rows if row[1] != ""]


def _plant_rows(plant: Plant) -> list[tuple[object, ...]]:
    rows: list[tuple[object, ...]] = [("kind", type(plant).__name__), ("name", plant.name)]
    if isinstance(plant, ModalPlant):
        rows += [("modes", f"{plant.n_modes}, {plant.n_rigid} rigid"), ("first frequencies [Hz]", _hertz(plant))]
    else:
        rows.append(("states", plant.n_states))
    return [*rows, ("inputs", _some(plant.inputs)), ("outputs", _some(plant.outputs))]


def _hertz(plant: ModalPlant) -> str:
    return _some([f"{f:.5g}" for f in sorted(plant.frequency_hz)])


def _some(values: Any) -> str:
    shown = [str(v) for v in list(values)[:SHOWN]]
    return ", ".join(shown) + (f", ... ({len(values)})" if len(values) > SHOWN else "")
