"""Zipped numpy arrays from untrusted files: sizes are checked in the zip directory and array headers before anything is read.

Pickled objects are never loaded.
"""

from __future__ import annotations

import math
import struct
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.files import checked_file, one_line

MAX_BYTES = 8 * 10**9  # of all arrays together, uncompressed
MAX_RATIO = 500  # uncompressed over file size, for archives above RATIO_FREE_BYTES: more is a zip bomb
RATIO_FREE_BYTES = 256 * 10**6
BROKEN = (
    zipfile.BadZipFile, zlib.error, ValueError, TypeError, KeyError, IndexError, EOFError, OSError, struct.error, SyntaxError,
    tokenize.TokenError, NotImplementedError, RuntimeError, OverflowError, MemoryError, AttributeError,
)  # fmt: skip  # what zipfile and numpy.lib.format raise for corrupt input


def looks_like_npz(head: bytes) -> bool:
    """Whether the file starts like a zip archive whose first member is an array."""
    return head[:4] == b"PK\x03\x04" and b".npy" in head[:600]


def member_names(path: Path) -> list[str]:
    """Names of the arrays in an archive, [] if it is not readable."""
    try:
        with zipfile.ZipFile(path) as archive:
            return [n.removesuffix(".npy") for n in archive.namelist()]
    except BROKEN:
        return []


def read_npz(path: str | Path, *, max_bytes: float = MAX_BYTES, max_ratio: float = MAX_RATIO) -> dict[str, Any]:
    """All arrays of a `.npz` file by name.

    max_bytes: of all arrays, uncompressed. max_ratio: uncompressed over compressed, for more than 256 MB.
    Raises ReadError naming the array for anything corrupt, pickled, or beyond these bounds, before allocating it.
    """
    path = checked_file(path)
    member = "zip directory"
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            _check_total(path, sum(m.file_size for m in members), max_bytes, max_ratio)
            out: dict[str, Any] = {}
            for info in members:
                member = one_line(info.filename.removesuffix(".npy"))
                if member in out or not info.filename.endswith(".npy"):
                    raise ReadError(path, "is stored twice" if member in out else "is not an array (.npy)", record=member)
                out[member] = _array(path, archive, info, member)
            return out
    except BROKEN as error:
        raise ReadError(path, f"is corrupt: {one_line(error) or type(error).__name__}", record=member) from None


def _check_total(path: Path, total: int, max_bytes: float, max_ratio: float) -> None:
    if total > max_bytes:
        raise ReadError(path, f"its arrays take {total:.3g} bytes, more than max_bytes = {max_bytes:.3g}")
    ratio = total / path.stat().st_size
    if total > RATIO_FREE_BYTES and ratio > max_ratio:
        raise ReadError(path, f"its arrays are {ratio:.0f} times the file's size, more than max_ratio = {max_ratio:.0f}")


def _array(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo, member: str) -> Any:
    with archive.open(info) as stream:
        version = np.lib.format.read_magic(stream)
        if version == (1, 0):
            shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
        else:
            shape, _, dtype = np.lib.format.read_array_header_2_0(stream)
        if dtype.hasobject:
            raise ReadError(path, "holds pickled Python objects, which are never loaded", record=member)
        size, there = math.prod(shape) * dtype.itemsize, info.file_size - stream.tell()
        if min(shape, default=0) < 0 or size != there:
            raise ReadError(path, f"claims shape {shape} of {dtype}, {size} bytes, but has {there}", record=member)
    with archive.open(info) as stream:
        return np.lib.format.read_array(stream, allow_pickle=False)
