"""From named matrices and a sidecar to a component or a model: shared by OUTPUT4, npz and MATLAB files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError, nearest
from flexplant.io.parse.files import provenance
from flexplant.io.parse.names import name_from
from flexplant.io.parse.npz import read_npz
from flexplant.io.parse.sidecar import Sidecar
from flexplant.model.arrays import Matrix, is_sparse
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.display import DisplayMesh
from flexplant.model.recovery import Recovery

Matrices = Mapping[str, Matrix]
ALIASES = {"mass": "M", "stiffness": "K", "damping": "C"}  # MATLAB's mechss(M, C, K, B, F, G, D)


def component_of(path: Path, matrices: Matrices, sidecar: Sidecar, name: str | None, format_name: str) -> Component:
    """The component that plain matrices and their sidecar describe; ReadError where they disagree."""
    if sidecar.boundary is None:
        sidecar.fail('boundary is missing: list the DOF of the first rows, as in boundary: [[9001, "123456"]]')
    square = _square(path, matrices, sidecar)
    n, boundary = square["mass"].shape[0], sidecar.boundary
    if len(boundary) > n:
        sidecar.fail(f"boundary lists {len(boundary)} DOF, but the matrices of {path.name} have {n} rows", "boundary")
    if sidecar.modal not in (None, n - len(boundary)):
        text = f"{n} rows less {len(boundary)} boundary DOF leave {n - len(boundary)} modal rows, not {sidecar.modal}"
        sidecar.fail(text, "modal")
    _check_nodes(sidecar, boundary.nodes, "boundary")
    recovery = _recoveries(path, matrices, sidecar, n)
    return Component(
        **square, name=name or sidecar.name or name_from(path), boundary=boundary, nodes=sidecar.nodes,
        recovery={r.name: r for r in recovery}, source=_source(path, sidecar, format_name),
    )  # fmt: skip


def model_of(path: Path, matrices: Matrices, sidecar: Sidecar, name: str | None, format_name: str) -> FiniteElementModel:
    """The finite-element model that plain matrices and their sidecar describe; ReadError where they disagree."""
    if sidecar.dofs is None:
        sidecar.fail("dofs is missing: list the DOF of every row, as in dofs: [[1, 1], [1, 2]]")
    square = _square(path, matrices, sidecar)
    if len(sidecar.dofs) != square["mass"].shape[0]:
        text = f"dofs lists {len(sidecar.dofs)} DOF, but the matrices of {path.name} have {square['mass'].shape[0]} rows"
        sidecar.fail(text, "dofs")
    _check_nodes(sidecar, sidecar.dofs.nodes, "dofs")
    return FiniteElementModel(
        **square, name=name or sidecar.name or name_from(path), dofs=sidecar.dofs, nodes=sidecar.nodes,
        source=_source(path, sidecar, format_name),
    )  # fmt: skip


def _source(path: Path, sidecar: Sidecar, format_name: str) -> dict[str, Any]:
    others = (sidecar.path,) if sidecar.display is None else (sidecar.path, sidecar.display)
    return provenance(path, format_name, __name__, others) | sidecar.source()


def _check_nodes(sidecar: Sidecar, nodes: list[int], key: str) -> None:
    if sidecar.nodes is not None and (missing := [n for n in nodes if n not in sidecar.nodes]):
        sidecar.fail(f"{key}: nodes {missing[:8]} have no position in nodes", key)


def _named(path: Path, matrices: Matrices, name: str, sidecar: Sidecar, *keys: str) -> Matrix:
    if name not in matrices:
        sidecar.fail(f"{'.'.join(keys)}: {path.name} has no matrix {name!r}." + nearest(name, matrices), *keys)
    matrix = matrices[name]
    if matrix.dtype.kind not in "fiu":
        raise ReadError(path, f"is of type {matrix.dtype}; real numbers are needed", record=name)
    if matrix.ndim != 2:
        raise ReadError(path, f"has shape {matrix.shape}; a matrix is needed", record=name)
    return matrix


def _square(path: Path, matrices: Matrices, sidecar: Sidecar) -> dict[str, Matrix]:
    names = dict(sidecar.matrices)
    if "matrices" not in sidecar.yaml.data and "mass" not in matrices and "M" in matrices:
        names = {kind: letter for kind, letter in ALIASES.items() if letter in matrices or kind != "damping"}
    found = {kind: _named(path, matrices, name, sidecar, "matrices", kind) for kind, name in names.items()}
    n = found["mass"].shape[0]
    if all(is_sparse(m) for m in found.values()) and max(m.nnz for m in found.values()) < n // 2:
        raise ReadError(path, f"claims {n} rows but holds numbers for fewer than half of them", record=names["mass"])
    for kind, matrix in found.items():
        if matrix.shape != (n, n):
            raise ReadError(path, f"{kind} has shape {matrix.shape}, mass {found['mass'].shape}", record=names[kind])
    return found


def _recoveries(path: Path, matrices: Matrices, sidecar: Sidecar, n: int) -> list[Recovery]:
    out = [_recovery(path, matrices, sidecar, name) for name in sidecar.recovery]
    if sidecar.display is not None:
        out.append(_display_recovery(sidecar, sidecar.display, n))
    return out


def _recovery(path: Path, matrices: Matrices, sidecar: Sidecar, name: str) -> Recovery:
    spec = sidecar.recovery[name]
    kinds = {"matrix": "displacement", "velocity": "velocity", "acceleration": "acceleration"}
    rows = {kinds[k]: _named(path, matrices, str(spec[k]), sidecar, "recovery", name) for k in kinds if k in spec}
    if not rows:
        sidecar.fail(f"recovery.{name} names no matrix", "recovery", name)
    count = next(iter(rows.values())).shape[0]
    return Recovery(
        name=name, labels=spec.get("labels") or [str(i + 1) for i in range(count)], units=str(spec.get("units", "")), **rows
    )


def _display_arrays(path: Path) -> dict[str, Any]:
    arrays = read_npz(path)
    if missing := {"nodes", "positions", "quads", "lines"} - set(arrays):
        raise ReadError(path, f"a display file needs the arrays nodes, positions, quads, lines; {sorted(missing)} are missing")
    return arrays


def mesh_of(sidecar: Sidecar) -> tuple[DisplayMesh | None, Any]:
    """The mesh of the sidecar's display file, None if it names none; and the units the sidecar states."""
    if sidecar.display is None:
        return None, None
    arrays = _display_arrays(sidecar.display)
    source = provenance(sidecar.display, "display mesh .npz", __name__, (sidecar.path,))
    return DisplayMesh(**{k: arrays[k] for k in ("nodes", "positions", "quads", "lines")}, source=source), sidecar.units


def _display_recovery(sidecar: Sidecar, path: Path, n: int) -> Recovery:
    """Translations of each display node: labels "node.1", "node.2", "node.3"."""
    arrays = _display_arrays(path)
    labels = [f"{int(node)}.{direction}" for node in np.ravel(arrays["nodes"]) for direction in (1, 2, 3)]
    shape = arrays["matrix"].shape if "matrix" in arrays else None
    if shape != (len(labels), n):
        raise ReadError(path, f"has shape {shape}; 3 rows a node and {n} columns are needed", record="matrix")
    return Recovery(name="display", labels=labels, displacement=arrays["matrix"], units="m" if sidecar.units == "SI" else "")
