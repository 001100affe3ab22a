"""The readers of plain matrices with a sidecar, whichever container holds the matrices."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexplant.io.parse.npz import MAX_BYTES
from flexplant.io.parse.plain_matrices import Matrices, component_of, mesh_of, model_of
from flexplant.io.parse.sidecar import find_sidecar
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.display import DisplayMesh


def sidecar_readers(load: Callable[[Path, float], Matrices], format_name: str) -> dict[str, Callable[..., Any]]:
    """read_component, read_model and read_display_mesh over `load`(path, max_bytes).

    sidecar: the YAML file, None for the one with the same stem. max_bytes: the most that a packed file may unpack to.
    """

    def read_component(
        path: Path, *, name: str | None = None, sidecar: str | Path | None = None, max_bytes: float = MAX_BYTES
    ) -> Component:
        described = find_sidecar(path, sidecar)
        return component_of(path, load(path, max_bytes), described, name, format_name)

    def read_model(
        path: Path, *, name: str | None = None, sidecar: str | Path | None = None, max_bytes: float = MAX_BYTES
    ) -> FiniteElementModel:
        described = find_sidecar(path, sidecar)
        return model_of(path, load(path, max_bytes), described, name, format_name)

    def read_display_mesh(path: Path, *, sidecar: str | Path | None = None) -> tuple[DisplayMesh | None, Any]:
        return mesh_of(find_sidecar(path, sidecar))

    return {"read_component": read_component, "read_model": read_model, "read_display_mesh": read_display_mesh}
