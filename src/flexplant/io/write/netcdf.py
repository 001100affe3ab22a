"""Results as NetCDF-4, readable by every NetCDF program (layout: `flexplant.io.parse.netcdf`)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from flexplant.errors import InputError
from flexplant.io.formats import Writer
from flexplant.io.parse.names import WRITTEN_BY
from flexplant.io.write.ownership import mark
from flexplant.io.write.pieces import write_pieces

NAME = "netcdf"


def write_results(results: Any, path: Path, *, append: bool = False, target: Path) -> None:
    """An xarray Dataset or DataArray, or an iterator over the Datasets of a long run, which append=True continues."""
    from flexplant.io.parse.netcdf import storable

    if isinstance(results, Iterator):
        return write_pieces(results, path, target, mark(NAME), append=append)
    if append:
        raise InputError("write_results: append=True takes an iterator of pieces, as simulate_stream returns one")
    storable(results).assign_attrs({WRITTEN_BY: mark(NAME)}).to_netcdf(path, engine="h5netcdf")
    return None


WRITER = Writer(
    name=NAME,
    description="NetCDF-4",
    suffixes=(".nc", ".nc4"),
    writers={"write_results": write_results},
    tested_against="netCDF4 1.7 (the C library)",
)
