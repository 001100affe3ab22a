"""Reading and writing: the only place that knows a file format."""

from typing import Any

from flexplant.io.inspection import convert, inspect
from flexplant.io.output import read_plant, write_component, write_model, write_plant, write_results, writers
from flexplant.io.plausibility import plausibility
from flexplant.io.read_reference import read_reference, read_response_functions
from flexplant.io.registry import formats, read_component, read_display_mesh, read_geometry, read_model
from flexplant.model.display import DisplayMesh

__all__ = [
    "DisplayMesh",
    "convert",
    "formats",
    "inspect",
    "plausibility",
    "read_component",
    "read_display_mesh",
    "read_geometry",
    "read_model",
    "read_plant",
    "read_reference",
    "read_response_functions",
    "read_results",
    "write_component",
    "write_model",
    "write_plant",
    "write_results",
    "writers",
]


def __getattr__(name: str) -> Any:
    if name == "read_results":  # needs xarray, which takes a while to import
        from flexplant.io.parse.netcdf import read_results

        return read_results
    raise AttributeError(f"module 'flexplant.io' has no attribute {name!r}")
