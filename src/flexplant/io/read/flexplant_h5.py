"""The project's own HDF5 file of a component or model (layout: `flexplant.io.parse.own`)."""

from __future__ import annotations

from pathlib import Path

from flexplant.io.formats import Format
from flexplant.io.parse.h5 import SIGNATURE, header_of, read_h5
from flexplant.io.parse.own_readers import HEADER, own_readers

NAME = "flexplant_h5"


def sniff(head: bytes, path: Path) -> bool:
    """An HDF5 file with our header."""
    return head.startswith(SIGNATURE) and header_of(path, HEADER) is not None


FORMAT = Format(
    name=NAME,
    description="flexplant's own HDF5 file",
    suffixes=(".h5", ".hdf5"),
    sniff=sniff,
    tested_against="itself, bit-equal",
    readers=own_readers(read_h5, NAME, __name__),
)
