"""Labels of results, made without xarray's search through them: it takes longer than a thousand steady states."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import xarray as xr
from xarray.indexes import PandasIndex


def coordinates(output_units: Sequence[str], input_units: Sequence[str] | None = None, **labels: npt.ArrayLike) -> xr.Coordinates:
    """Dimension coordinates by name, as `xarray.Dataset` makes them from lists of numbers or texts, and the channels' units.

    Those whose names end in "time" are in seconds.
    """
    variables, indexes = {"output_units": xr.Variable(("output",), list(output_units))}, {}
    if input_units is not None:
        variables["input_units"] = xr.Variable(("input",), list(input_units))
    for name, values in labels.items():
        given = np.asarray(values)
        index = _repeated(name, tuple(given.tolist())) if given.dtype.kind == "U" else PandasIndex(given, name)
        indexes[name] = index
        variables.update(index.create_variables())
        if name.endswith("time"):
            variables[name].attrs["units"] = "s"
    return xr.Coordinates(variables, indexes=indexes)


@lru_cache(maxsize=256)
def _repeated(name: str, texts: tuple[str, ...]) -> PandasIndex:
    """The index of names: the same ones come again with every result of a system."""
    given = np.asarray(texts)
    return PandasIndex(given.astype(object), name, coord_dtype=given.dtype)
