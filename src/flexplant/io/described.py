"""The rows that `inspect` shows of what a file holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexplant.errors import ReadError
from flexplant.io.plausibility import Model, first_frequencies, plausibility, quantities
from flexplant.model.component import Component
from flexplant.model.display import DisplayMesh

if TYPE_CHECKING:
    from flexplant.io.parse.own_plant import Plant
    from flexplant.io.universal_files import Units
    from flexplant.plant.modal import ModalPlant

SHOWN = 12
Rows = list[tuple[object, ...]]


def result_rows(path: Path) -> Rows:
    """Title, and every variable with its dimensions, range of its coordinates and units."""
    from flexplant.io.parse.netcdf import read_results

    data = read_results(path)
    rows: Rows = [("kind", "results (NetCDF-4)")]
    rows += [("title", data.attrs["title"])] if "title" in data.attrs else []
    for name, values in data.data_vars.items():
        sizes = " x ".join(f"{size} {dim}" for dim, size in values.sizes.items()) or "one number"
        units = f" [{values.attrs['units']}]" if "units" in values.attrs else ""
        rows.append((name, f"{values.dtype}, {sizes}{units}"))
    return rows


def model_rows(model: Model) -> Rows:
    """Of a component or a finite-element model: DOF, boundary, mass, first frequencies, what its provenance says."""
    hz, problem = first_frequencies(model, SHOWN)
    found = replace(quantities(model, modes=False), frequency_hz=next((f for f in hz if f > 0), None))
    component = isinstance(model, Component)
    rows: Rows = [
        ("kind", "component" if component else "finite-element model"),
        ("name", model.name),
        *_origin_rows({"units": model.units, **model.source}),
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
        _hash_row(model.source),
    ]
    rows += [("note", text) for text in plausibility(model, found)]
    return [row for row in rows if row[1] != ""]


def _origin_rows(source: Mapping[str, Any]) -> Rows:
    """What a provenance says, but for the hash: format, units as the file has them, files read beside it, what it was made of."""
    origin = source.get("origin", {})
    parts = origin.get("components") if isinstance(origin, Mapping) else None
    known = {k: p for k, p in parts.items() if isinstance(p, Mapping)} if isinstance(parts, Mapping) else {}
    made = [f"{name} ({part.get('file')}, {part.get('format')})" for name, part in known.items()]
    beside = [Path(str(file)).name for file in source.get("files", {})]
    rows = {"format": source.get("format"), "units": source.get("units"), "with": _some(beside), "made from": _some(made)}
    return [(what, text) for what, text in rows.items() if text]


def _hash_row(source: Mapping[str, Any]) -> tuple[object, ...]:
    return ("sha256", str(source.get("sha256", ""))[:16])


def mesh_rows(mesh: DisplayMesh) -> Rows:
    """Of geometry: nodes, surfaces, lines."""
    rows: Rows = [("kind", "geometry"), *_origin_rows(mesh.source), ("nodes", len(mesh.nodes))]
    frames = [("frames", "of each grid")] if mesh.frames is not None else []
    return [*rows, ("surfaces", len(mesh.quads)), ("lines", len(mesh.lines)), *frames, _hash_row(mesh.source)]


def plant_rows(plant: Plant) -> Rows:
    """Of a plant: modes or states, channels, what it was made of."""
    from flexplant.plant.modal import ModalPlant

    rows: Rows = [("kind", type(plant).__name__), ("name", plant.name), *_origin_rows(plant.source)]
    if isinstance(plant, ModalPlant):
        rows += [("modes", f"{plant.n_modes}, {plant.n_rigid} rigid"), ("first frequencies [Hz]", _hertz(plant))]
    else:
        rows.append(("states", plant.n_states))
    return [*rows, ("inputs", _some(plant.inputs)), ("outputs", _some(plant.outputs)), _hash_row(plant.source)]


def _hertz(plant: ModalPlant) -> str:
    return _some([f"{f:.5g}" for f in sorted(plant.frequency_hz)])


def _some(values: Any) -> str:
    shown = [str(v) for v in list(values)[:SHOWN]]
    return ", ".join(shown) + (f", ... ({len(values)})" if len(values) > SHOWN else "")


def reference_rows(path: Path, units: Units | None = None) -> Rows:
    """What a universal file holds of reference modes and of functions; its ReadError where it holds neither."""
    from flexplant.io.universal_files import read_reference, read_response_functions

    functions = read_response_functions(path, units=units)
    try:
        modes = [read_reference(path, component="file", units=units)]
    except ReadError:
        if not functions:
            raise
        modes = []
    source = [*(m.provenance for m in modes), *(f.source for f in functions)][0]
    rows: Rows = [("kind", "reference (universal file)"), *_origin_rows({**source, "format": "universal file"})]
    for found in modes:
        hz, nodes = found.frequency_hz, dict.fromkeys(label.split(".")[1] for label in found.labels)
        rows += [
            ("modes", f"{hz.size} at {len(nodes)} nodes: {_some(nodes)}"),
            ("frequencies [Hz]", _some([f"{f:.5g}" for f in hz])),
        ]
    shown = [f"{f.quantity} {f.response[0]}.{f.response[1]} / {f.reference[0]}.{f.reference[1]}" for f in functions]
    return [*rows, *([("functions", _some(shown))] if shown else []), _hash_row(source)]
