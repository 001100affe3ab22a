"""MATLAB `.mat` matrices (up to version 7.2; dense or sparse) with a sidecar (see `flexplant.io.parse.sidecar`)."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.display import DisplayMesh
from flexplant.io.parse.files import read_bytes
from flexplant.io.parse.npz import BROKEN, MAX_BYTES
from flexplant.io.parse.plain_matrices import component_of, mesh_of, model_of
from flexplant.io.parse.sidecar import find_sidecar
from flexplant.model.arrays import Matrix
from flexplant.model.component import Component, FiniteElementModel

HEADER_BYTES, COMPRESSED = 128, 15


def sniff(head: bytes, path: Path) -> bool:  # noqa: ARG001  every sniff function has it
    """The text that MATLAB and scipy put first."""
    return head.startswith(b"MATLAB ") and len(head) > HEADER_BYTES


def read_matrices(path: Path, max_bytes: float = MAX_BYTES) -> dict[str, Matrix]:
    """The numeric matrices of a `.mat` file by name; ReadError for version 7.3, corrupt or oversized files."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    data = read_bytes(path)
    if data.startswith(b"MATLAB 7.3"):
        raise ReadError(path, "is a version 7.3 MAT-file; save it with -v7 (or as .npz)")
    _check_size(path, data, max_bytes)
    try:
        variables = loadmat(str(path), spmatrix=False)
    except (*BROKEN, MatReadError) as error:
        raise ReadError(path, f"is corrupt: {str(error)[:200] or type(error).__name__}") from None
    return {k: v for k, v in variables.items() if (sp.issparse(v) or isinstance(v, np.ndarray)) and v.dtype.kind in "fiu"}


def _check_size(path: Path, data: bytes, max_bytes: float) -> None:
    """Lengths of the elements against the file, and of the compressed ones uncompressed against max_bytes."""
    order, at, total = ("<" if data[126:128] == b"IM" else ">"), HEADER_BYTES, 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(order + "2I", data, at)
        if at + 8 + size > len(data):
            raise ReadError(path, f"an element claims {size} bytes, {len(data) - at - 8} are left", offset=at)
        total += _unpacked(data[at + 8 : at + 8 + size], max_bytes - total) if kind == COMPRESSED else size
        if total > max_bytes:
            raise ReadError(path, f"unpacks to more than max_bytes = {max_bytes:.3g}", offset=at)
        at += 8 + size


def _unpacked(packed: bytes, left: float) -> int:
    """Length of a compressed element, counted without keeping it and no further than `left`."""
    stream, total, chunk = zlib.decompressobj(), 0, packed
    while chunk and total <= left:
        try:
            total += len(stream.decompress(chunk, 1 << 24))
        except zlib.error:
            return total
        chunk = stream.unconsumed_tail
    return total


def read_component(
    path: Path, *, name: str | None = None, sidecar: str | Path | None = None, max_bytes: float = MAX_BYTES
) -> Component:
    """A component; sidecar: its YAML file, None for the one with the same stem."""
    described = find_sidecar(path, sidecar)
    return component_of(path, read_matrices(path, max_bytes), described, name, FORMAT.name)


def read_model(
    path: Path, *, name: str | None = None, sidecar: str | Path | None = None, max_bytes: float = MAX_BYTES
) -> FiniteElementModel:
    """A finite-element model; sidecar: its YAML file, None for the one with the same stem."""
    described = find_sidecar(path, sidecar)
    return model_of(path, read_matrices(path, max_bytes), described, name, FORMAT.name)


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
