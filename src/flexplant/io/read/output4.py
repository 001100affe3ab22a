"""OUTPUT4 matrices with a sidecar: MYSTRAN's `.OU1` ... `.OU9`, or any Nastran `.op4` (see `flexplant.io.parse.sidecar`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexplant.io.formats import Format
from flexplant.io.parse.files import sibling
from flexplant.io.parse.mystran_deck import deck_beside, is_reduction
from flexplant.io.parse.op4 import looks_like_op4, read_op4
from flexplant.io.parse.plain_matrices import component_of, mesh_of, model_of
from flexplant.io.parse.sidecar import find_sidecar, sidecar_path
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.display import DisplayMesh


def sniff(head: bytes, path: Path) -> bool:
    """An OUTPUT4 file with a sidecar, or at least without the files of a Nastran superelement or MYSTRAN run beside it."""
    deck = deck_beside(path)
    alone = sibling(path, ".pch") is None and sibling(path, ".asm") is None and not (deck is not None and is_reduction(deck))
    return looks_like_op4(head) and (sidecar_path(path) is not None or alone)


def read_component(path: Path, *, name: str | None = None, sidecar: str | Path | None = None) -> Component:
    """A component; sidecar: its YAML file, None for the one with the same stem."""
    described = find_sidecar(path, sidecar)
    return component_of(path, read_op4(path), described, name, FORMAT.name)


def read_model(path: Path, *, name: str | None = None, sidecar: str | Path | None = None) -> FiniteElementModel:
    """A finite-element model; sidecar: its YAML file, None for the one with the same stem."""
    described = find_sidecar(path, sidecar)
    return model_of(path, read_op4(path), described, name, FORMAT.name)


def read_display_mesh(path: Path, *, sidecar: str | Path | None = None) -> tuple[DisplayMesh | None, Any]:
    """The mesh that the sidecar names under `display`, and the units it states."""
    return mesh_of(find_sidecar(path, sidecar))


FORMAT = Format(
    name="output4",
    description="OUTPUT4 matrices with a YAML sidecar: MYSTRAN .OU1, Nastran .op4",
    suffixes=(".OU1", ".op4"),
    sniff=sniff,
    tested_against="MYSTRAN 18.0, NX Nastran 9.1",
    readers={"read_component": read_component, "read_model": read_model, "read_display_mesh": read_display_mesh},
)
