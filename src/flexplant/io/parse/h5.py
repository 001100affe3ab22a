"""Named arrays in an HDF5 file, read with bounds: no links to elsewhere, no claims beyond what is stored."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexplant.errors import ReadError
from flexplant.io.parse.files import checked_file, one_line
from flexplant.io.parse.npz import MAX_BYTES, MAX_RATIO, RATIO_FREE_BYTES

SIGNATURE = b"\x89HDF\r\n\x1a\n"
BROKEN = (OSError, RuntimeError, KeyError, ValueError, TypeError, OverflowError, MemoryError, NotImplementedError, AttributeError)


def write_h5(path: Path, arrays: dict[str, Any]) -> None:
    """Arrays and texts as data sets of the root group."""
    import h5py

    with h5py.File(path, "w", libver=("v110", "v110")) as file:  # whose structures carry checksums, unlike the older ones
        for name, value in arrays.items():
            file.create_dataset(name, data=value)


def read_h5(path: str | Path, *, max_bytes: float = MAX_BYTES) -> dict[str, Any]:
    """The arrays and texts of the root group; ReadError for anything corrupt, linked elsewhere, or larger than it can be."""
    import h5py

    path = checked_file(path)
    name = "root group"
    try:
        with h5py.File(path, "r") as file:
            out: dict[str, Any] = {}
            for name in file:
                if not isinstance(file.get(name, getlink=True), h5py.HardLink) or not isinstance(file[name], h5py.Dataset):
                    raise ReadError(path, "is not a data set of this file", record=one_line(name))
                max_bytes -= _checked_size(path, file[name], name, max_bytes)
                value = file[name][()]
                out[name] = value.decode("utf-8") if isinstance(value, bytes) else value
            return out
    except BROKEN as error:
        raise ReadError(path, f"is corrupt: {one_line(error) or type(error).__name__}", record=one_line(name)) from None


def _checked_size(path: Path, dataset: Any, name: str, left: float) -> int:
    if dataset.external or dataset.is_virtual:
        raise ReadError(path, "is stored in another file, which is not followed", record=name)
    size = int(dataset.size) * int(dataset.dtype.itemsize)
    stored = int(dataset.id.get_storage_size())
    beyond = size > 10**6 and stored == 0
    if size > left or beyond or (size > RATIO_FREE_BYTES and size > MAX_RATIO * stored):
        raise ReadError(path, f"claims shape {dataset.shape}, {size} bytes; {stored} are stored", record=name)
    return size


def header_of(path: Path, key: str) -> str | None:
    """The text of one data set, None if there is none."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            value = file[key][()] if key in file and file[key].shape == () else None
            return value.decode("utf-8") if isinstance(value, bytes) else None
    except BROKEN:
        return None


def attribute_of(path: Path, key: str) -> str:
    """The text of an attribute of the file, "" if there is none."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            value = file.attrs.get(key, "")
            return value.decode("utf-8") if isinstance(value, bytes) else str(value)
    except BROKEN:
        return ""


def dataset_names(path: Path) -> set[str]:
    """The names in the root group; empty for a file that cannot be opened."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return set(file)
    except BROKEN:
        return set()
