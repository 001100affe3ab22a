"""Results that come piece by piece, as `simulate_stream` yields them: into one NetCDF-4 file, of which memory holds one piece.

The file's dimension `time` is unlimited. What has no time, as the state at the end, is of the last piece.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import InputError, WriteError
from flexplant.io.parse.names import WRITTEN_BY

ALONG = "time"
CHUNK_BYTES = 1 << 19


def partial_of(target: Path) -> Path:
    """Where the finished pieces of an interrupted run are kept: `long.partial.nc` beside `long.nc`."""
    return target.with_name(f"{target.stem}.partial{target.suffix}")


def begun(target: Path) -> Path:
    """The file that append=True goes on with; WriteError where there is none."""
    found = [path for path in (partial_of(target), target) if path.is_file()]
    if not found:
        raise WriteError(f"nothing to append to: there is no {target.name} and no {partial_of(target).name} in {target.parent}")
    return found[0]


def write_pieces(pieces: Iterable[Any], work: Path, target: Path, marked: str, *, append: bool = False) -> None:
    """Every piece behind the one before it; after an error or Ctrl-C what is finished is kept as `partial_of(target)`.

    Raises InputError for a piece that is no Dataset with `time`, or does not fit the first one.
    """
    first = None
    if append:
        first = begun(target)
        shutil.copyfile(first, work)
    with _kept_if_interrupted(work, partial_of(target)):
        rows = _append_all(iter(pieces), work, marked, started=append)
    if not rows:
        raise InputError("write_results: there are no pieces to write")
    partial_of(target).unlink(missing_ok=True)


@contextmanager
def _kept_if_interrupted(work: Path, partial: Path) -> Iterator[None]:
    finished = False
    try:
        yield
        finished = True
    finally:
        if not finished and work.is_file():
            work.replace(partial)
            error = sys.exception()
            if error is not None:
                error.add_note(
                    f"the pieces that were finished are kept in {partial}; write_results(..., append=True) goes on there"
                )


def _append_all(pieces: Iterator[Any], work: Path, marked: str, *, started: bool) -> int:
    """Number of pieces written."""
    import h5netcdf

    count = 0
    if not started:
        for piece in pieces:
            _begin(piece, work, marked)
            count = 1
            break
        else:
            return 0
    with h5netcdf.File(work, "a") as file:
        for piece in pieces:
            _append(_checked(piece), file)
            file.flush()
            count += 1
    return count


def _checked(piece: Any) -> Any:
    from flexplant.io.parse.netcdf import storable

    data = storable(piece)
    if ALONG not in data.dims:
        raise InputError(f"write_results: a piece has no dimension 'time', only {', '.join(map(str, data.dims)) or 'none'}")
    return data


def _begin(piece: Any, work: Path, marked: str) -> None:
    data = _checked(piece).assign_attrs({WRITTEN_BY: marked})
    chunks = {str(k): {"chunksizes": _chunks(v)} for k, v in data.variables.items() if ALONG in v.dims}
    data.to_netcdf(work, engine="h5netcdf", unlimited_dims=[ALONG], encoding=chunks)


def _chunks(variable: Any) -> tuple[int, ...]:
    """All channels for as many instants as fit into CHUNK_BYTES; left to itself HDF5 takes single channels of a few kB."""
    instant = variable.dtype.itemsize * variable.size // max(variable.sizes[ALONG], 1)
    count = max(1, CHUNK_BYTES // max(instant, 1))
    return tuple(count if d == ALONG else n for d, n in zip(variable.dims, variable.shape, strict=True))


def _append(data: Any, file: Any) -> None:
    before = file.dimensions[ALONG].size if ALONG in file.dimensions else 0
    for name, variable in data.variables.items():
        _refuse_other_shape(str(name), variable, file)
    file.resize_dimension(ALONG, before + data.sizes[ALONG])
    for name, variable in data.variables.items():
        if ALONG in variable.dims:
            place = tuple(slice(before, None) if d == ALONG else slice(None) for d in variable.dims)
            file[str(name)][place] = variable.values
        elif variable.dtype.kind in "fiub":
            file[str(name)][...] = variable.values


def _refuse_other_shape(name: str, variable: Any, file: Any) -> None:
    """InputError where a piece is not of the run that the file holds."""
    if name not in file.variables:
        raise InputError(f"write_results: a piece has {name!r}, which those before it have not")
    stored = file[name]
    if tuple(stored.dimensions) != tuple(map(str, variable.dims)):
        raise InputError(f"write_results: {name!r} of a piece is along {variable.dims}, before along {tuple(stored.dimensions)}")
    sizes = [(d, n, m) for d, n, m in zip(variable.dims, variable.shape, stored.shape, strict=True) if d != ALONG and n != m]
    if sizes:
        raise InputError(
            f"write_results: {name!r} of a piece has {sizes[0][1]} entries along {sizes[0][0]!r}, before {sizes[0][2]}"
        )
    if variable.dtype.kind not in "fiub" and _texts(stored[...]) != _texts(variable.values):
        raise InputError(f"write_results: {name!r} of a piece names other channels than those before it")


def _texts(values: Any) -> list[str]:
    return [value.decode() if isinstance(value, bytes) else str(value) for value in np.ravel(values)]
