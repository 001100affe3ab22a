"""The project's own HDF5 file of a component or model (layout: `flexplant.io.parse.own`)."""

from __future__ import annotations

from pathlib import Path

from flexplant.io.formats import Format
from flexplant.io.parse.files import provenance
from flexplant.io.parse.h5 import SIGNATURE, header_of, read_h5
from flexplant.io.parse.npz import MAX_BYTES
from flexplant.io.parse.own import HEADER, unpack_component, unpack_model
from flexplant.model.component import Component, FiniteElementModel


def sniff(head: bytes, path: Path) -> bool:
    """An HDF5 file with our header."""
    return head.startswith(SIGNATURE) and header_of(path, HEADER) is not None


def read_component(path: Path, *, name: str | None = None, max_bytes: float = MAX_BYTES) -> Component:
    """A component as it was written; source["origin"] is the source it had."""
    arrays = read_h5(path, max_bytes=max_bytes)
    return unpack_component(arrays, path, provenance(path, FORMAT.name, __name__), name)


def read_model(path: Path, *, name: str | None = None, max_bytes: float = MAX_BYTES) -> FiniteElementModel:
    """A finite-element model as it was written; source["origin"] is the source it had."""
    arrays = read_h5(path, max_bytes=max_bytes)
    return unpack_model(arrays, path, provenance(path, FORMAT.name, __name__), name)


FORMAT = Format(
    name="flexplant_h5",
    description="flexplant's own HDF5 file",
    suffixes=(".h5", ".hdf5"),
    sniff=sniff,
    tested_against="itself, bit-equal",
    readers={"read_component": read_component, "read_model": read_model},
)
