"""Labelled results as NetCDF: complex arrays become a pair of real ones, rich attributes become JSON.

`name` complex is stored as `name__real` and `name__imag`, so that every NetCDF program can open the file.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flexplant.errors import InputError, ReadError
from flexplant.io.parse.files import checked_file, one_line
from flexplant.io.parse.names import WRITTEN_BY

REAL, IMAGINARY, JSON_LIST = "__real", "__imag", "flexplant_json"


def storable(results: xr.Dataset | xr.DataArray) -> xr.Dataset:
    """A data set with real variables and plain attributes only."""
    if not isinstance(results, (xr.Dataset, xr.DataArray)):
        raise InputError(f"write_results takes a Dataset or DataArray, as simulate gives one, got {type(results).__name__}")
    data = results.to_dataset(name=results.name or "value") if isinstance(results, xr.DataArray) else results
    out = data.copy()
    for name, variable in data.data_vars.items():
        if np.iscomplexobj(variable):
            out = out.drop_vars([name]).assign({f"{name}{REAL}": variable.real, f"{name}{IMAGINARY}": variable.imag})
            out[f"{name}{REAL}"].attrs, out[f"{name}{IMAGINARY}"].attrs = dict(variable.attrs), {}
    for item in _attributed(out):
        item.attrs = _plain_attributes(item.attrs)
    return out


def _attributed(data: xr.Dataset) -> list[Any]:
    return [data, *data.variables.values()]


def _plain_attributes(attributes: dict[Any, Any]) -> dict[str, Any]:
    plain: dict[str, Any] = {}
    rich = []
    for key, value in attributes.items():
        keep = isinstance(value, str | int | float | np.number) and not isinstance(value, bool)
        plain[str(key)] = value if keep else json.dumps(value, default=_listed)
        rich += [] if keep else [str(key)]
    return plain | ({JSON_LIST: " ".join(rich)} if rich else {})


def _listed(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


def restored(stored: xr.Dataset) -> xr.Dataset:
    """The data set as it was before `storable` (tuples have become lists)."""
    out = stored
    if str(out.attrs.get(WRITTEN_BY, "")).startswith("written by flexplant"):
        out.attrs.pop(WRITTEN_BY)
    for item in _attributed(out):
        rich = str(item.attrs.pop(JSON_LIST, "")).split()
        item.attrs = {k: json.loads(v) if k in rich else v for k, v in item.attrs.items()}
    for name in [str(n) for n in stored.data_vars if str(n).endswith(REAL)]:
        base = name.removesuffix(REAL)
        if f"{base}{IMAGINARY}" in out:
            whole = out[name] + 1j * out[f"{base}{IMAGINARY}"]
            whole.attrs = out[name].attrs
            out = out.drop_vars([name, f"{base}{IMAGINARY}"]).assign({base: whole})
    return out


def read_results(path: str | Path) -> xr.Dataset:
    """Results that `write_results` wrote (or any NetCDF-4 file), complex arrays put together again; ReadError otherwise."""
    path = checked_file(path)
    try:
        with xr.open_dataset(path, engine="h5netcdf") as stored:
            return restored(stored.load())
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError) as error:
        raise ReadError(path, f"is not a readable NetCDF-4 file: {one_line(error)}") from None
