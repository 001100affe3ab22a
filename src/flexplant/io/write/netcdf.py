"""Results as NetCDF-4, readable by every NetCDF program (layout: `flexplant.io.parse.netcdf`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexplant.io.formats import Writer


def write_results(results: Any, path: Path) -> None:
    """An xarray Dataset or DataArray."""
    from flexplant.io.parse.netcdf import storable

    storable(results).to_netcdf(path, engine="h5netcdf")


WRITER = Writer(name="netcdf", description="NetCDF-4", suffixes=(".nc", ".nc4"), writers={"write_results": write_results})
