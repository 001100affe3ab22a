"""MATLAB `.mat` matrices (up to version 7.2; dense or sparse) with a sidecar (see `flexplant.io.parse.sidecar`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexplant.io.formats import Format
from flexplant.io.parse.mat5 import HEADER_BYTES, read_mat
from flexplant.io.parse.npz import MAX_BYTES
from flexplant.io.parse.plain_matrices import component_of, mesh_of, model_of
from flexplant.io.parse.sidecar import find_sidecar
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.display import DisplayMesh


def sniff(head: bytes, path: Path) -> bool:  # noqa: ARG001  every sniff function has it
    """The text that MATLAB and scipy put first."""
    return head.startswith(b"MATLAB ") and len(head) > HEADER_BYTES


def read_component(
    path: Path, *, name: str | None = None, sidecar: str | Path | None = None, max_bytes: float = MAX_BYTES
) -> Component:
    """A component; sidecar: its YAML file, None for the one with the same stem."""
    described = find_sidecar(path, sidecar)
    return component_of(path, read_mat(path, max_bytes=max_bytes), described, name, FORMAT.name)


def read_model(
    path: Path, *, name: str | None = None, sidecar: str | Path | None = None, max_bytes: float = MAX_BYTES
) -> FiniteElementModel:
    """A finite-element model; sidecar: its YAML file, None for the one with the same stem."""
    described = find_sidecar(path, sidecar)
    return model_of(path, read_mat(path, max_bytes=max_bytes), described, name, FORMAT.name)


def read_display_mesh(path: Path, *, sidecar: str | Path | None = None) -> tuple[DisplayMesh | None, Any]:
    """The mesh that the sidecar names under `display`, and the units it states."""
    return mesh_of(find_sidecar(path, sidecar))


FORMAT = Format(
    name="mat_matrices",
    description="MATLAB .mat matrices with a YAML sidecar",
    suffixes=(".mat",),
    sniff=sniff,
    tested_against="scipy.io",
    readers={"read_component": read_component, "read_model": read_model, "read_display_mesh": read_display_mesh},
)
