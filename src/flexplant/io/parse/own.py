"""The project's own layout of components, models and plants as named arrays; `.npz` and `.h5` both store it.

`flexplant` is a JSON text: {"kind": "component", "version": 1, texts ...}; other kinds are "model", "modal_plant",
"state_space" and "descriptor". The other arrays are what their names say; a sparse matrix is four arrays (see
`flexplant.io.parse.npz_matrices`).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from flexplant.errors import ModelError, ReadError
from flexplant.io.parse.files import one_line
from flexplant.io.parse.npz_matrices import csr_matrix, pack_matrix
from flexplant.io.parse.own_readers import HEADER
from flexplant.io.parse.own_reduction import dofs_of, pack_reduction, pairs_of, reduced_component, reduction_texts
from flexplant.model.arrays import Matrix, frozen
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.geometry import Nodes
from flexplant.model.recovery import Recovery
from flexplant.model.units import UNSTATED

VERSION = 2  # 2: components with structural damping or interior rows, which 1 would leave out silently
RECOVERY_KINDS = ("displacement", "velocity", "acceleration")
Arrays = dict[str, Any]
Built = TypeVar("Built", Component, FiniteElementModel)


def _plain(value: Any) -> Any:
    """JSON for what JSON does not know: numpy values as lists and numbers, anything else as text."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return dict(value) if isinstance(value, Mapping) else str(value)


def header_text(kind: str, **texts: Any) -> str:
    """The JSON header."""
    return json.dumps({"kind": kind, "version": 1, **texts}, default=_plain)


def read_header(text: Any, path: Path) -> dict[str, Any]:
    """The JSON header of a file; ReadError if it is none, or of a later version."""
    try:
        header = json.loads(str(text))
        version = header["version"]
        kind = header["kind"]
    except (ValueError, TypeError, KeyError, RecursionError):
        raise ReadError(path, "has no usable flexplant header", record=HEADER) from None
    if not isinstance(version, int) or not isinstance(kind, str) or version > VERSION:
        raise ReadError(path, f"is of version {version!r}; this flexplant reads up to {VERSION}: update it", record=HEADER)
    return dict(header)


def pack_component(component: Component, *, basis: bool = False) -> Arrays:
    """Arrays of a component; of a reduced one also its report and error rows, and with basis=True its basis.

    Raises InputError where a basis is asked for that was not kept.
    """
    recovery = {r.name: {"labels": list(r.labels), "units": r.units} for r in component.recovery.values()}
    texts = reduction_texts(component) | ({"version": VERSION} if _needs_newest(component) else {})
    arrays = _pack_common("component", component, recovery=recovery, **texts)
    arrays |= pack_reduction(component, basis=basis) | _pack("structural_damping", component.structural_damping)
    if len(component.interior):
        arrays |= {"interior": pairs_of(component.interior)} | _pack("interior_rows", component.interior_rows)
    arrays |= {"boundary": pairs_of(component.boundary), "modal_ids": np.asarray(component.modal_ids)}
    for r in component.recovery.values():
        for kind in RECOVERY_KINDS:
            arrays |= _pack(f"recovery.{r.name}.{kind}", getattr(r, kind))
    return arrays


def _needs_newest(component: Component) -> bool:
    return component.structural_damping is not None or len(component.interior) > 0


def pack_model(model: FiniteElementModel) -> Arrays:
    """Arrays of a finite-element model."""
    return _pack_common("model", model) | {"dofs": pairs_of(model.dofs)}


def _pack_common(kind: str, model: Component | FiniteElementModel, **texts: Any) -> Arrays:
    header = header_text(kind, name=model.name, units=model.units, source=model.source, **texts)
    arrays: Arrays = {HEADER: header}
    for matrix in ("mass", "stiffness", "damping"):
        arrays |= _pack(matrix, getattr(model, matrix))
    if model.nodes is not None:
        arrays |= {"nodes.ids": model.nodes.ids, "nodes.positions": model.nodes.positions}
        arrays |= {} if model.nodes.frames is None else {"nodes.frames": model.nodes.frames}
    return arrays


def _pack(name: str, matrix: Matrix | None) -> Arrays:
    return {} if matrix is None else pack_matrix(name, matrix)


def unpack_component(arrays: Arrays, path: Path, source: Mapping[str, Any], name: str | None) -> Component:
    """The component from its arrays; ReadError for anything missing or inconsistent."""

    def build(header: dict[str, Any]) -> Component:
        recovery = [_recovery(arrays, path, key, spec) for key, spec in header["recovery"].items()]
        fields = _common(arrays, path, header, source, name) | {
            "boundary": dofs_of(arrays, "boundary"),
            "modal_ids": arrays["modal_ids"],
            "recovery": {r.name: r for r in recovery},
            "structural_damping": _optional(arrays, "structural_damping", path),
            "interior": dofs_of(arrays, "interior") if "interior" in arrays else (),
            "interior_rows": _optional(arrays, "interior_rows", path),
        }
        return reduced_component(arrays, header["reduction"], fields) if "reduction" in header else Component(**fields)

    return _guarded(build, arrays, path, "component")


def unpack_model(arrays: Arrays, path: Path, source: Mapping[str, Any], name: str | None) -> FiniteElementModel:
    """The finite-element model from its arrays; ReadError for anything missing or inconsistent."""

    def build(header: dict[str, Any]) -> FiniteElementModel:
        return FiniteElementModel(**_common(arrays, path, header, source, name), dofs=dofs_of(arrays, "dofs"))

    return _guarded(build, arrays, path, "model")


def _guarded(build: Callable[[dict[str, Any]], Built], arrays: Arrays, path: Path, kind: str) -> Built:
    header = _unstated(read_header(arrays.get(HEADER), path))
    if header["kind"] != kind:
        raise ReadError(path, f"holds a {header['kind']}, not a {kind}", record=HEADER)
    try:
        return build(header)
    except KeyError as error:
        raise ReadError(path, f"has no {error} although it says it holds a {kind}") from None
    except (ModelError, TypeError, ValueError, AttributeError, IndexError, OverflowError) as error:
        raise ReadError(path, one_line(error)) from None


def _unstated(header: dict[str, Any]) -> dict[str, Any]:
    """Files of earlier versions say "SI" of numbers whose units nobody had stated; their source tells."""
    source = header.get("source")
    if header.get("units") != "SI" or not isinstance(source, dict) or not str(source.get("units")).startswith(UNSTATED):
        return header
    reduction = header.get("reduction")
    remembered = {"reduction": {**reduction, "units": UNSTATED}} if isinstance(reduction, dict) else {}
    return header | {"units": UNSTATED} | remembered


def _common(arrays: Arrays, path: Path, header: dict[str, Any], source: Mapping[str, Any], name: str | None) -> dict[str, Any]:
    origin = {"origin": header["source"]} if header["source"] else {}
    units = {"units": "SI"} if header["units"] == "SI" else {}  # others stay as they are unless the caller asks
    return {
        "name": name or header["name"],
        "units": header["units"],
        "source": {**source, **units, **origin},
        "mass": _unpack(arrays, "mass", path),
        "stiffness": _unpack(arrays, "stiffness", path),
        "damping": _optional(arrays, "damping", path),
        "nodes": _nodes(arrays),
    }


def _unpack(arrays: Arrays, name: str, path: Path) -> Matrix:
    return arrays[name] if name in arrays else csr_matrix(arrays, name, path)


def _optional(arrays: Arrays, name: str, path: Path) -> Matrix | None:
    return _unpack(arrays, name, path) if name in arrays or f"{name}.indptr" in arrays else None


def _nodes(arrays: Arrays) -> Nodes | None:
    if "nodes.ids" not in arrays:
        return None
    stored = arrays.get("nodes.frames")
    nodes = Nodes(ids=arrays["nodes.ids"], positions=arrays["nodes.positions"], frames=stored)
    if stored is not None and nodes.frames is not None and abs(nodes.frames - stored).max(initial=0.0) < 1e-14:
        object.__setattr__(nodes, "frames", frozen(stored))  # not re-orthogonalised again: what was written comes back bit-equal
    return nodes


def _recovery(arrays: Arrays, path: Path, name: str, spec: dict[str, Any]) -> Recovery:
    matrices = {kind: _optional(arrays, f"recovery.{name}.{kind}", path) for kind in RECOVERY_KINDS}
    return Recovery(name=name, labels=spec["labels"], units=spec["units"], **matrices)
