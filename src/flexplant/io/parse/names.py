"""Names for models, from file names."""

from __future__ import annotations

import re
from pathlib import Path

WRITTEN_BY = "written_by"  # attribute of a NetCDF file of ours: not a part of the results


def name_from(path: Path) -> str:
    """The file's stem with what a name may not contain (dots, colons, blanks) replaced by "_"."""
    return re.sub(r"[.:/\s]", "_", path.stem) or "model"
