"""Reading and writing: the only place that knows a file format. Readers come at once, the rest loads on first use."""

import importlib
from typing import TYPE_CHECKING, Any

from flexplant.io.plausibility import plausibility
from flexplant.io.registry import formats, read_component, read_display_mesh, read_geometry, read_model
from flexplant.model.display import DisplayMesh

if TYPE_CHECKING:
    from flexplant.io.inspection import convert, inspect
    from flexplant.io.output import read_plant, write_component, write_model, write_plant, write_results, writers
    from flexplant.io.parse.netcdf import read_results
    from flexplant.io.universal_files import read_reference, read_response_functions

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

_HOME = {  # none of these modules is called like a name in it, which would hide the name
    "flexplant.io.inspection": ("convert", "inspect"),
    "flexplant.io.output": ("read_plant", "write_component", "write_model", "write_plant", "write_results", "writers"),
    "flexplant.io.parse.netcdf": ("read_results",),
    "flexplant.io.universal_files": ("read_reference", "read_response_functions"),
}
_WHERE = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'flexplant.io' has no attribute {name!r}")
    value = getattr(importlib.import_module(_WHERE[name]), name)
    globals()[name] = value
    return value
