"""The project's own `.npz` of a component or model (layout: `flexplant.io.parse.own`)."""

from __future__ import annotations

from pathlib import Path

from flexplant.io.formats import Format
from flexplant.io.parse.files import provenance
from flexplant.io.parse.npz import MAX_BYTES, looks_like_npz, member_names, read_npz
from flexplant.io.parse.own import HEADER, unpack_component, unpack_model
from flexplant.model.component import Component, FiniteElementModel


def sniff(head: bytes, path: Path) -> bool:
    """A zip archive with our header among its arrays."""
    return looks_like_npz(head) and HEADER in member_names(path)


def read_component(path: Path, *, name: str | None = None, max_bytes: float = MAX_BYTES) -> Component:
    """A component as it was written; source["origin"] is the source it had."""
    arrays = read_npz(path, max_bytes=max_bytes)
    return unpack_component(arrays, path, provenance(path, FORMAT.name, __name__), name)


def read_model(path: Path, *, name: str | None = None, max_bytes: float = MAX_BYTES) -> FiniteElementModel:
    """A finite-element model as it was written; source["origin"] is the source it had."""
    arrays = read_npz(path, max_bytes=max_bytes)
    return unpack_model(arrays, path, provenance(path, FORMAT.name, __name__), name)


FORMAT = Format(
    name="flexplant_npz",
    description="flexplant's own .npz",
    suffixes=(".npz",),
    sniff=sniff,
    tested_against="itself, bit-equal",
    readers={"read_component": read_component, "read_model": read_model},
)
