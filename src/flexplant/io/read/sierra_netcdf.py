"""Sierra/SD Craig-Bampton reductions as NetCDF-3 (`.nc4`, `.ncf`): Kr, Mr (Cr) and cbmap.

cbmap lists (node, direction) for each row, node 0 for a modal row; a cbmap of the boundary alone has the modal rows first.
Rows are put in the order boundary, modal. Positions are not in the file.
"""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.files import one_line, provenance, read_bytes
from flexplant.io.parse.listed_rows import listed_component
from flexplant.io.parse.names import name_from
from flexplant.model.component import Component
from flexplant.model.dofs import DofSet

SIGNATURES = (b"CDF\x01", b"CDF\x02")
CORRUPT = (ValueError, TypeError, LookupError, AttributeError, OverflowError, OSError, MemoryError, struct.error)
NAMES = {"stiffness": "Kr", "mass": "Mr", "damping": "Cr"}


def sniff(head: bytes, path: Path) -> bool:  # noqa: ARG001  every sniff function has it
    """A NetCDF-3 file with cbmap in its header."""
    return head[:4] in SIGNATURES and b"cbmap" in head


def read_component(path: Path, *, name: str | None = None) -> Component:
    """The component in the file's units."""
    arrays = read_netcdf3(path)
    if missing := [v for v in ("Kr", "Mr", "cbmap") if v not in arrays]:
        raise ReadError(path, f"has no variable {', '.join(missing)}; it has {', '.join(arrays)}")
    matrices: dict[str, Any] = {kind: arrays.get(variable) for kind, variable in NAMES.items()}
    for kind, matrix in matrices.items():
        if matrix is not None and (matrix.ndim != 2 or matrix.dtype.kind != "f"):
            raise ReadError(path, f"has shape {matrix.shape} and type {matrix.dtype}", record=NAMES[kind])
    dofs = _dofs(path, arrays["cbmap"], matrices["stiffness"].shape[0])
    return listed_component(path, matrices, dofs, None, name or name_from(path), provenance(path, FORMAT.name, __name__))


def read_netcdf3(path: Path) -> dict[str, Any]:
    """The numeric variables of a NetCDF-3 file by name; ReadError for anything malformed."""
    from scipy.io import netcdf_file

    data = read_bytes(path)
    try:
        with netcdf_file(io.BytesIO(data), mmap=False) as file:
            found = {n: np.array(v.data) for n, v in file.variables.items() if np.asarray(v.data).dtype.kind in "fiu"}
    except (
        ValueError,
        TypeError,
        KeyError,
        IndexError,
        AttributeError,
        OverflowError,
        OSError,
        MemoryError,
        struct.error,
    ) as error:
        raise ReadError(path, f"is not a readable NetCDF-3 file ({one_line(error)})") from None
    return {n: v.astype(v.dtype.newbyteorder("=")) for n, v in found.items()}


def _dofs(path: Path, listed: Any, n: int) -> DofSet:
    if listed.size % 2 or listed.dtype.kind not in "iu" or listed.size > 2 * n:
        raise ReadError(path, f"has shape {listed.shape}; up to {n} rows of node, direction are needed", record="cbmap")
    pairs = listed.reshape(-1, 2).astype(np.int64)
    modal = n - len(pairs)
    if modal and (pairs[:, 0] == 0).any():
        raise ReadError(path, f"lists {len(pairs)} of {n} rows, modal ones among them", record="cbmap")
    pairs = np.vstack([np.zeros((modal, 2), dtype=np.int64), pairs])
    scalar = pairs[:, 0] == 0
    pairs[scalar, 0], pairs[scalar, 1] = np.arange(1, scalar.sum() + 1), 0
    if len(pairs) and not (pairs[:, 0].min() >= 0 and pairs[:, 1].min() >= 0 and pairs[:, 1].max() <= 6):
        raise ReadError(path, "has negative nodes or directions outside 1 to 6", record="cbmap")
    return DofSet(pairs[:, 0], pairs[:, 1])


FORMAT = Format(
    name="sierra_netcdf",
    description="Sierra/SD Craig-Bampton reduction, NetCDF-3",
    suffixes=(".nc4", ".ncf"),
    sniff=sniff,
    tested_against="scipy.io.netcdf_file",
    readers={"read_component": read_component},
)
