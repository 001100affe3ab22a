"""The writers users call. Every module of `flexplant.io.write` that defines `WRITER` is a format.

All of them write to a temporary name in the same folder first, so that a file is either whole or as it was, and replace
nothing but what they wrote themselves (`flexplant.io.write.ownership`).
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import flexplant.io.write
from flexplant.errors import InputError, ReadError, expect
from flexplant.io.formats import Writer
from flexplant.io.options import check_options
from flexplant.io.parse.files import UNSTATED_NUMBERS, as_path, checked_file, provenance, read_head
from flexplant.io.parse.h5 import SIGNATURE, read_h5
from flexplant.io.parse.mat5 import read_mat, read_mat_texts
from flexplant.io.parse.npz import looks_like_npz, read_npz
from flexplant.io.parse.own_plant import Plant, unpack_matlab, unpack_plant
from flexplant.io.write.atomic import replacing
from flexplant.io.write.ownership import check_replaced, files_of
from flexplant.io.write.pieces import begun, partial_of
from flexplant.model.arrays import checked_switch, items_of
from flexplant.model.component import Component, FiniteElementModel

DROPPED = {
    "recovery": "dataclasses.replace(component, recovery={})",
    "interior": "dataclasses.replace(component, interior=(), interior_rows=None)",
    "structural_damping": "dataclasses.replace(component, structural_damping=None)",
}


@cache
def writers() -> dict[str, Writer]:
    """All writable formats by name."""
    package = flexplant.io.write
    modules = [importlib.import_module(f"{package.__name__}.{m.name}") for m in pkgutil.iter_modules(package.__path__)]
    found = [module.WRITER for module in modules if hasattr(module, "WRITER")]
    return {w.name: w for w in sorted(found, key=lambda w: w.name)}


def chosen_writer(what: str, path: Path) -> Writer:
    """The format that the path's ending chooses for "write_component" and so on; InputError lists the endings there are."""
    able = {suffix: w for w in writers().values() if what in w.writers for suffix in w.suffixes}
    if path.suffix.lower() not in able:
        raise InputError(f"{what}: {path.name!r} has none of the endings {', '.join(able)}, which choose the format")
    return able[path.suffix.lower()]


def plant_endings() -> list[str]:
    """Endings without dot that `write_plant` knows, in alphabetic order: c, fmu, h5, ..."""
    return sorted(suffix[1:] for w in writers().values() if "write_plant" in w.writers for suffix in w.suffixes)


def check_target(what: str, path: str | Path, sources: Iterable[str | Path] = (), *, overwrite: bool = False) -> Writer:
    """The format of a target that may be written: before a long computation, not after it.

    Raises InputError for an ending that no format has; WriteError where a file of the sources would be replaced, or, unless
    overwrite, a file that `what` (such as "write_component") did not write.
    """
    path = as_path(path)
    chosen = chosen_writer(what, path)
    check_replaced(chosen, what, path, sources, checked_switch(overwrite, "overwrite"))
    return chosen


def _write(
    what: str, value: Any, path: str | Path, options: dict[str, Any], overwrite: bool, sources: Iterable[str | Path] = ()
) -> Path:
    path, listed = as_path(path), items_of(sources)
    if listed is None:
        raise InputError(f"{what}: sources must be a list of paths, got {sources!r:.60}")
    chosen = check_target(what, path, [*map(as_path, listed), *files_of(value)], overwrite=overwrite)
    writer = chosen.writers[what]
    check_options(writer, options, f"format {chosen.name!r}", hidden="target")
    own_path = {"target": path} if "target" in inspect.signature(writer).parameters else {}
    with replacing(path) as work:
        writer(value, work, **options, **own_path)
    return path


def write_component(component: Component, path: str | Path, *, overwrite: bool = False, **options: Any) -> Path:
    """Write a component to `.npz` or `.h5` and return the path; `read_component` gives it back bit-equal.

    What its reduction reported and the error rows are kept; basis=True writes its basis too. Raises InputError for another
    ending, and for recovery, structural damping and interior DOF where the format has no place for them; WriteError naming
    the folder that cannot be written. A file that stands there is replaced only where it is what this wrote before, or with
    overwrite=True; a file that the component was read from never (WriteError). That holds for all files of a target.
    """
    expect(component, Component, "write_component", "read_component gives one, craig_bampton reduces a model to one")
    chosen = chosen_writer("write_component", as_path(path))  # an ending that no format has is the first thing to say
    _refuse_loss(component, as_path(path), chosen.holds)
    return _write("write_component", component, path, options, overwrite)


def _refuse_loss(component: Component, path: Path, holds: frozenset[str]) -> None:
    """InputError where a format would leave out a part of the component without a word."""
    lost = [(what, text) for what, text in _extras(component) if what not in holds]
    if lost:
        what, text = lost[0]
        field = what.split()[0]
        without = "write with_equivalent_viscous_damping(component, hz)" if what == "structural_damping" else DROPPED[field]
        raise InputError(
            f"{path.name!r}: this format does not hold the {text} of component {component.name!r}; write .npz or .h5, or "
            f"{without} (convert: drop=[{field!r}], --drop {field})"
        )


def _extras(component: Component) -> list[tuple[str, str]]:
    """What the component has of `EXTRAS`, in words too."""
    rates = [r.name for r in component.recovery.values() if r.velocity is not None or r.acceleration is not None]
    found = [("structural_damping", "structural damping")] if component.structural_damping is not None else []
    found += [("interior", "interior DOF")] if len(component.interior) else []
    found += [("recovery", f"recovery rows ({', '.join(component.recovery)})")] if component.recovery else []
    return found + ([("recovery rates", f"velocity and acceleration rows of the recovery {', '.join(rates)}")] if rates else [])


def dropped(drop: Iterable[str]) -> list[str]:
    """The words of `drop`; InputError for one that is no part of a component that may be left out."""
    listed = items_of(drop)
    if listed is None or (wrong := [word for word in listed if not isinstance(word, str) or word not in DROPPED]):
        raise InputError(f"drop takes a list of {', '.join(DROPPED)}, got {drop if listed is None else wrong[0]!r:.60}")
    return listed


def without(component: Component, drop: Iterable[str]) -> Component:
    """The component without its "recovery", "interior" DOF or "structural_damping"; InputError for other words."""
    listed = dropped(drop)
    empty: dict[str, Any] = {"recovery": {}, "interior": (), "structural_damping": None}
    given = {word: empty[word] for word in listed} | ({"interior_rows": None} if "interior" in listed else {})
    return replace(component, **given)


def write_model(model: FiniteElementModel, path: str | Path, *, overwrite: bool = False, **options: Any) -> Path:
    """Write a finite-element model to `.npz` or `.h5` and return the path; errors as `write_component`."""
    expect(model, FiniteElementModel, "write_model", "read_model gives one from a file")
    return _write("write_model", model, path, options, overwrite)


def write_plant(
    plant: Plant, path: str | Path, *, overwrite: bool = False, sources: Iterable[str | Path] = (), **options: Any
) -> Path:
    """Write a plant: `.npz`, `.h5` (`read_plant` gives it back bit-equal), `.mat`, `.m`, `.jl`, `.c`, `.fmu`.

    options: of the format, for example dt= of `.c`, version= of `.fmu`; see its module. sources: files that are never to be
    replaced, as the one the plant was read from. Errors as `write_component`.
    """
    return _write("write_plant", plant, path, options, overwrite, sources)


def write_results(results: Any, path: str | Path, *, overwrite: bool = False, append: bool = False) -> Path:
    """Write an xarray Dataset or DataArray to NetCDF-4 (`.nc`); complex `x` becomes `x__real`, `x__imag`.

    results may be what `simulate_stream` returns: its pieces are written one behind the other, and memory holds one at a time.
    After an error or Ctrl-C the pieces that were finished are kept beside the path, as `long.partial.nc` for `long.nc`;
    append=True goes on with that file, or with the path itself. Raises InputError for another kind of results, and for pieces
    that do not fit those before them; WriteError as `write_component`, and where there is nothing to append to.
    """
    if checked_switch(append, "append"):
        check_target("write_results", begun(as_path(path)), overwrite=overwrite)
    elif isinstance(results, Iterator):
        check_target("write_results", partial_of(as_path(path)), overwrite=overwrite)
    return _write("write_results", results, path, {"append": append}, overwrite)


def read_plant(path: str | Path) -> Plant:
    """A plant that `write_plant` wrote to `.npz` or `.h5`, or plain matrices of a `.mat` (`unpack_matlab`); else ReadError."""
    path = checked_file(path)
    head = read_head(path)
    if looks_like_npz(head):
        return _with_provenance(unpack_plant(read_npz(path), path), path, "flexplant_npz")
    if head.startswith(SIGNATURE):
        return _with_provenance(unpack_plant(read_h5(path), path), path, "flexplant_h5")
    if head.startswith(b"MATLAB "):
        return _with_provenance(unpack_matlab(read_mat(path), path, read_mat_texts(path)), path, "mat")
    raise ReadError(path, "is not a plant in flexplant's .npz or .h5, or a .mat file")


def _with_provenance(plant: Plant, path: Path, format_name: str) -> Plant:
    """The plant with its file as its source; what the file says of its own sources is the origin, as of a component."""
    said = [unit for unit in dict.fromkeys((*plant.input_units, *plant.output_units)) if unit]
    units = f"of the channels, as in the file: {', '.join(said)}" if said else UNSTATED_NUMBERS
    origin = {"origin": plant.source} if plant.source else {}
    return replace(plant, source=provenance(path, format_name, __name__) | {"units": units} | origin)
