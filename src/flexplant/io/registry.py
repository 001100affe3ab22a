"""The registry of file formats, and the readers users call.

Every module of `flexplant.io.read` that defines `FORMAT` is a format; nothing else needs to be edited to add one.
"""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import flexplant.io.read
from flexplant.errors import InputError, ModelError, ReadError, nearest
from flexplant.io.formats import Format
from flexplant.io.options import check_options, keywords, understood
from flexplant.io.parse.files import UNSTATED_NUMBERS, as_path, checked_file, exists, one_line, read_head
from flexplant.io.plausibility import warn_if_implausible
from flexplant.model.component import Component, FiniteElementModel, check_name
from flexplant.model.conversion import component_in_si, model_in_si
from flexplant.model.damping import DampingRatio, with_modal_damping
from flexplant.model.display import DisplayMesh
from flexplant.model.recovery_units import recovery_in_si
from flexplant.model.units import SI, UNSTATED, UnitSystem, unit_system

Units = str | UnitSystem | tuple[float, float]


@cache
def formats() -> dict[str, Format]:
    """All readable formats by name."""
    package = flexplant.io.read
    modules = [importlib.import_module(f"{package.__name__}.{m.name}") for m in pkgutil.iter_modules(package.__path__)]
    found = [module.FORMAT for module in modules if hasattr(module, "FORMAT")]
    return {f.name: f for f in sorted(found, key=lambda f: f.name)}


@cache
def every_option() -> frozenset[str]:
    """Options that any format has for reading."""
    return frozenset(name for f in formats().values() for reader in f.readers.values() for name in keywords(reader))


@cache
def path_options() -> frozenset[str]:
    """Options of any format that are paths: sidecar, mapping, geometry, ..."""
    readers = [reader for f in formats().values() for reader in f.readers.values()]
    return frozenset(name for reader in readers for name, kind in keywords(reader).items() if "Path" in kind)


def _resolved(path: str | Path, able: list[Format]) -> Path:
    """The path; or, for a stem without ending such as "outboard", the one file beside it with an ending of these formats."""
    path = as_path(path)
    if path.name and not exists(path):
        endings = dict.fromkeys(ending for f in able for ending in f.suffixes)
        found = [p for p in (path.with_name(path.name + ending) for ending in endings) if p.is_file()]
        if len(found) > 1:
            raise ReadError(path, f"could be {', '.join(p.name for p in found)}; write the ending too")
        if found:
            return found[0]
    return checked_file(path)


def recognise(path: str | Path, wanted: str | None = None, what: str = "read_component") -> tuple[Path, Format]:
    """The file and its format, from the content if `wanted` is None; ReadError lists the formats that can do `what`."""
    able = {name: f for name, f in formats().items() if what in f.readers}
    path = _resolved(path, list(able.values()))
    if wanted is not None:
        if not isinstance(wanted, str) or wanted not in able:
            raise ReadError(path, f"no format {wanted!r:.60} for {what}." + nearest(wanted, able))
        return path, able[wanted]
    head = read_head(path)
    matching = [f for f in able.values() if f.sniff(head, path)]
    if len(matching) == 1:
        return path, matching[0]
    if matching:
        names = ", ".join(f.name for f in matching)
        raise ReadError(path, f"could be {names}; give format=")
    others = [f.name for f in formats().values() if f.sniff(head, path)]
    hint = f" (it is {others[0]}, which {what} cannot use)" if others else ""
    raise ReadError(path, f"its format is not recognised{hint}; {what} knows: {', '.join(able)}")


def _read(what: str, path: str | Path, wanted: str | None, options: dict[str, Any]) -> Any:
    path, found = recognise(path, wanted, what)
    reader = found.readers[what]
    options = understood(reader, options)
    check_options(reader, options, f"format {found.name!r}")
    if options.get("name") is not None:
        check_name(options["name"], "model")
    try:
        with np.errstate(
            over="ignore", invalid="ignore"
        ):  # absurd numbers of a corrupt file; the model refuses what is not finite
            return reader(path, **options)
    except ModelError as error:
        raise ReadError(path, one_line(error)) from None


def _unit_choice(stated: Any, asked: Units | None, path: str | Path) -> UnitSystem | None:
    """The unit system of the file: its own statement or the caller's, which must not contradict each other."""
    try:
        own = None if stated is None else unit_system(stated if isinstance(stated, str) else tuple(stated))
    except (InputError, TypeError, ValueError) as error:
        raise ReadError(path, f"units: {error}") from None
    given = None if asked is None else unit_system(asked)
    if own and given and replace(own, name=given.name) != given:
        raise ReadError(path, f"the file says its units are {own.name!r}, the argument units says {given.name!r}")
    return own or given


def _labelled(model: Any, chosen: UnitSystem | None) -> Any:
    """The model with what is known of its units: a file that states none leaves them so, and is not taken to be in SI."""
    if chosen:
        return replace(model, source={**model.source, "units": chosen.name})
    units = UNSTATED if model.units == SI.name else model.units
    return replace(model, units=units, source={**model.source, "units": UNSTATED_NUMBERS})


def _said_to_be_si(component: Component) -> Component:
    """The same numbers, which the caller says are in SI."""
    if component.units == SI.name:
        return component
    same = getattr(component, "reduced_units", None) == component.units  # of a reduced one, whose module need not be loaded
    units: dict[str, Any] = {"units": SI.name} | ({"reduced_units": SI.name} if same else {})
    return replace(component, **units)


def _component_in_si(component: Component, units: UnitSystem) -> Component:
    """Converted, rows of recovery of a known quantity included."""
    if replace(units, name=SI.name) != SI:
        return component_in_si(component, units)
    converted = _said_to_be_si(component)
    ours = str(component.source.get("format", "")).startswith("flexplant")
    if ours and component.units != UNSTATED:  # its rows say what they are
        return converted
    ids = frozenset(np.asarray(converted.modal_ids).tolist())
    return replace(converted, recovery={name: recovery_in_si(r, units, ids) for name, r in converted.recovery.items()})


def read_component(
    path: str | Path,
    *,
    format: str | None = None,  # noqa: A002  the public name
    name: str | None = None,
    damping: DampingRatio | None = None,
    units: Units | None = None,
    **options: Any,
) -> Component:
    """A Hurty/Craig-Bampton component from a file.

    format: a name of `formats()`; None recognises it from the content. name: instead of the file's stem.
    damping: modal damping ratio, list or table (`with_modal_damping`), replacing what the file has; None keeps that.
    units: the file's unit system (preset name, or (length in m, mass in kg)), converted to SI; None takes what the file
    states, else leaves the numbers as they are. options: of the format, see its module. `source` tells where it came from.
    Raises ReadError naming the file (record, byte) for anything missing, malformed or contradictory. Warns
    (`PlausibilityWarning`) where mass, size or first frequency are no structure's: units= is likely to be wrong.
    """
    if name is not None:
        options["name"] = name
    component: Component = _read("read_component", path, format, options)
    chosen = _unit_choice(component.source.get("units"), units, path)
    component = _labelled(component, chosen)
    component = component if chosen is None else _component_in_si(component, chosen)
    warn_if_implausible(component, path)
    return component if damping is None else with_modal_damping(component, damping)


def read_model(
    path: str | Path,
    *,
    format: str | None = None,  # noqa: A002
    name: str | None = None,
    units: Units | None = None,
    **options: Any,
) -> FiniteElementModel:
    """An unreduced finite-element model from a file; arguments and errors as `read_component`."""
    if name is not None:
        options["name"] = name
    model: FiniteElementModel = _read("read_model", path, format, options)
    chosen = _unit_choice(model.source.get("units"), units, path)
    model = _labelled(model, chosen)
    model = model if chosen is None else model_in_si(model, chosen)
    warn_if_implausible(model, path)
    return model


def read_geometry(
    path: str | Path,
    *,
    format: str | None = None,  # noqa: A002
    units: Units | None = None,
    **options: Any,
) -> DisplayMesh:
    """Grids and element outlines of a finite-element deck, for display: positions, displacement frames, provenance.

    units: the deck's unit system as in `read_component`, positions become metres; None leaves them as they are.
    """
    mesh: DisplayMesh = _read("read_geometry", path, format, options)
    return _mesh_in_si(mesh, None if units is None else unit_system(units))


def _mesh_in_si(mesh: DisplayMesh, chosen: UnitSystem | None) -> DisplayMesh:
    """The mesh in metres, with what is known of its units."""
    if chosen is None:
        return replace(mesh, source={**mesh.source, "units": UNSTATED_NUMBERS})
    return replace(mesh, positions=mesh.positions * chosen.length, source={**mesh.source, "units": chosen.name})


def read_display_mesh(
    path: str | Path,
    *,
    format: str | None = None,  # noqa: A002
    units: Units | None = None,
    **options: Any,
) -> DisplayMesh | None:
    """The display mesh that comes with a component's file, in the component's own frame; None if it has none.

    units: as in `read_component`, so that mesh and component fit together.
    """
    mesh: DisplayMesh | None
    mesh, stated = _read("read_display_mesh", path, format, options)
    chosen = _unit_choice(stated, units, path)
    return None if mesh is None else _mesh_in_si(mesh, chosen)
