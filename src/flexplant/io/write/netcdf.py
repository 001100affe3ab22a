"""Results as NetCDF-4, readable by every NetCDF program (layout: `flexplant.io.parse.netcdf`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexplant.io.formats import Writer
from flexplant.io.parse.names import WRITTEN_BY
from flexplant.io.write.ownership import mark

NAME = "netcdf"


def write_results(results: Any, path: Path) -> None:
    """An xarray Dataset or DataArray."""
    from flexplant.io.parse.netcdf import storable

    storable(results).assign_attrs({WRITTEN_BY: mark(NAME)}).to_netcdf(path, engine="h5netcdf")


WRITER = Writer(name=NAME, description="NetCDF-4", suffixes=(".nc", ".nc4"), writers={"write_results": write_results})
