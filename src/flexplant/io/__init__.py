"""Reading and writing: the only place that knows a file format."""

from flexplant.io.parse.display import DisplayMesh
from flexplant.io.registry import formats, read_component, read_display_mesh, read_geometry, read_model

__all__ = ["DisplayMesh", "formats", "read_component", "read_display_mesh", "read_geometry", "read_model"]
