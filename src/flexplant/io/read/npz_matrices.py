"""Plain `.npz` matrices with a sidecar (see `flexplant.io.parse.sidecar`).

A matrix is an array of that name, or sparse as its CSR parts name.data, name.indices, name.indptr, name.shape. Without
`matrices` in the sidecar the names are mass, stiffness.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexplant.io.formats import Format
from flexplant.io.parse.npz import MAX_BYTES, looks_like_npz, read_npz
from flexplant.io.parse.npz_matrices import unpack_matrices
from flexplant.io.parse.plain_matrices import component_of, mesh_of, model_of
from flexplant.io.parse.sidecar import find_sidecar, sidecar_path
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.display import DisplayMesh


def sniff(head: bytes, path: Path) -> bool:
    """A zip archive of arrays with a sidecar beside it."""
    return looks_like_npz(head) and sidecar_path(path) is not None


def read_component(
    path: Path, *, name: str | None = None, sidecar: str | Path | None = None, max_bytes: float = MAX_BYTES
) -> Component:
    """A component; sidecar: its YAML file, None for the one with the same stem."""
    described = find_sidecar(path, sidecar)
    return component_of(path, unpack_matrices(read_npz(path, max_bytes=max_bytes), path), described, name, FORMAT.name)


def read_model(
    path: Path, *, name: str | None = None, sidecar: str | Path | None = None, max_bytes: float = MAX_BYTES
) -> FiniteElementModel:
    """A finite-element model; sidecar: its YAML file, None for the one with the same stem."""
    described = find_sidecar(path, sidecar)
    return model_of(path, unpack_matrices(read_npz(path, max_bytes=max_bytes), path), described, name, FORMAT.name)


def read_display_mesh(path: Path, *, sidecar: str | Path | None = None) -> tuple[DisplayMesh | None, Any]:
    """The mesh that the sidecar names under `display`, and the units it states."""
    return mesh_of(find_sidecar(path, sidecar))


FORMAT = Format(
    name="npz_matrices",
    description="numpy .npz matrices with a YAML sidecar",
    suffixes=(".npz",),
    sniff=sniff,
    tested_against="numpy, scipy",
    readers={"read_component": read_component, "read_model": read_model, "read_display_mesh": read_display_mesh},
)
