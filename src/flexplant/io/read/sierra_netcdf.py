"""Sierra/SD Craig-Bampton reductions as NetCDF-3 or NetCDF-4 (`.nc4`, `.ncf`): Kr, Mr (Cr) and cbmap.

cbmap lists (node, direction) for each row, node 0 for a modal row; a cbmap of the boundary alone has the modal rows first.
Rows are put in the order boundary, modal. Positions are coordx, coordy, coordz of the nodes in node_num_map where the file has
these (names, and cbmap as real numbers, are those that SEACAS's superelement reader takes); the nodes of cbmap are then ids in
node_num_map, or places in it (from 1).
"""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import InputError, ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.files import one_line, provenance, read_bytes, read_head
from flexplant.io.parse.h5 import SIGNATURE as HDF5
from flexplant.io.parse.h5 import dataset_names, read_h5
from flexplant.io.parse.listed_rows import listed_component
from flexplant.io.parse.names import name_from
from flexplant.io.parse.number_text import integers
from flexplant.model.arrays import IntArray
from flexplant.model.component import Component
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes

SIGNATURES = (b"CDF\x01", b"CDF\x02")
CORRUPT = (ValueError, TypeError, LookupError, AttributeError, OverflowError, OSError, MemoryError, struct.error)
NAMES = {"stiffness": "Kr", "mass": "Mr", "damping": "Cr"}


def sniff(head: bytes, path: Path) -> bool:
    """A NetCDF-3 file with cbmap in its header, or an HDF5 file with these variables."""
    if head.startswith(HDF5):
        return {"Kr", "Mr", "cbmap"} <= dataset_names(path)
    return head[:4] in SIGNATURES and b"cbmap" in head


def read_component(path: Path, *, name: str | None = None, numbers: str | None = None) -> Component:
    """The component in the file's units.

    numbers: whether the nodes of cbmap are "ids" or "places" in node_num_map, where both are possible.
    """
    if numbers not in (None, "ids", "places"):
        raise InputError(f"numbers={numbers!r}: use 'ids' or 'places'")
    arrays = _netcdf4(path) if read_head(path).startswith(HDF5) else read_netcdf3(path)
    if missing := [v for v in ("Kr", "Mr", "cbmap") if v not in arrays]:
        raise ReadError(path, f"has no variable {', '.join(missing)}; it has {', '.join(arrays)}")
    matrices: dict[str, Any] = {kind: arrays.get(variable) for kind, variable in NAMES.items()}
    for kind, matrix in matrices.items():
        if matrix is not None and (matrix.ndim != 2 or matrix.dtype.kind != "f"):
            raise ReadError(path, f"has shape {matrix.shape} and type {matrix.dtype}", record=NAMES[kind])
    dofs = _dofs(path, arrays["cbmap"], matrices["stiffness"].shape[0])
    nodes = _nodes(path, arrays)
    if nodes is not None:
        dofs = _with_ids(path, dofs, nodes.ids, numbers)
    return listed_component(path, matrices, dofs, nodes, name or name_from(path), provenance(path, FORMAT.name, __name__))


def read_netcdf3(path: Path) -> dict[str, Any]:
    """The numeric variables of a NetCDF-3 file by name; ReadError for anything malformed."""
    from scipy.io import netcdf_file

    data = read_bytes(path)
    try:
        with netcdf_file(io.BytesIO(data), mmap=False) as file:
            found = {n: np.array(v.data) for n, v in file.variables.items() if np.asarray(v.data).dtype.kind in "fiu"}
    except CORRUPT as error:
        raise ReadError(path, f"is not a readable NetCDF-3 file ({one_line(error)})") from None
    return {n: v.astype(v.dtype.newbyteorder("=")) for n, v in found.items()}


def _netcdf4(path: Path) -> dict[str, Any]:
    """The numeric variables of a NetCDF-4 file, which is an HDF5 file."""
    return {n: v for n, v in read_h5(path).items() if getattr(getattr(v, "dtype", None), "kind", "") in "fiu"}


def _dofs(path: Path, listed: Any, n: int) -> DofSet:
    if listed.size % 2 or listed.size > 2 * n:
        raise ReadError(path, f"has shape {listed.shape}; up to {n} rows of node, direction are needed", record="cbmap")
    pairs = integers(path, np.ravel(listed).astype(float), "cbmap", 0).reshape(-1, 2)
    modal = n - len(pairs)
    if modal and (pairs[:, 0] == 0).any():
        raise ReadError(path, f"lists {len(pairs)} of {n} rows, modal ones among them", record="cbmap")
    pairs = np.vstack([np.zeros((modal, 2), dtype=np.int64), pairs])
    scalar = pairs[:, 0] == 0
    pairs[scalar, 0], pairs[scalar, 1] = np.arange(1, scalar.sum() + 1), 0
    if len(pairs) and not (pairs[:, 0].min() >= 0 and pairs[:, 1].min() >= 0 and pairs[:, 1].max() <= 6):
        raise ReadError(path, "has negative nodes or directions outside 1 to 6", record="cbmap")
    return DofSet(pairs[:, 0], pairs[:, 1])


def _nodes(path: Path, arrays: dict[str, Any]) -> Nodes | None:
    """The nodes, where the file has their numbers and all three coordinates."""
    keys = ("coordx", "coordy", "coordz")
    if "node_num_map" not in arrays or any(key not in arrays for key in keys):
        return None
    ids = integers(path, np.ravel(arrays["node_num_map"]).astype(float), "node_num_map")
    columns = [np.ravel(arrays[key]).astype(float) for key in keys]
    if any(column.size != ids.size for column in columns):
        raise ReadError(path, f"has {ids.size} nodes, but {', '.join(str(c.size) for c in columns)} coordinates", record="coordx")
    return None if not ids.size else Nodes(ids=ids, positions=np.column_stack(columns))


def _with_ids(path: Path, dofs: DofSet, ids: IntArray, numbers: str | None) -> DofSet:
    """The DOF with node ids; ReadError where the file does not tell whether cbmap has ids or places."""
    used = np.unique(dofs.node[dofs.direction > 0])
    as_ids, as_places = bool(np.isin(used, ids).all()), bool(used.size == 0 or used.max() <= ids.size)
    same = as_places and as_ids and np.array_equal(ids[used - 1], used)
    if as_ids and as_places and not same and numbers is None:
        raise ReadError(path, "could be ids or places in node_num_map; pass numbers='ids' or numbers='places'", record="cbmap")
    if (numbers or ("ids" if as_ids else "places")) == "ids" and as_ids:
        return dofs
    if not as_places or numbers == "ids":
        raise ReadError(path, f"has nodes {used.tolist()[:8]}, which node_num_map does not have", record="cbmap")
    node = dofs.node.copy()
    physical = dofs.direction > 0
    node[physical] = ids[node[physical] - 1]
    return DofSet(node, dofs.direction)


FORMAT = Format(
    name="sierra_netcdf",
    description="Sierra/SD Craig-Bampton reduction, NetCDF-3 or NetCDF-4",
    suffixes=(".nc4", ".ncf"),
    sniff=sniff,
    tested_against="scipy.io.netcdf_file, h5netcdf",
    readers={"read_component": read_component},
)
