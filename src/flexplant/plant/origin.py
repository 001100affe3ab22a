"""Where a plant's components came from, for the files that it is written to."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

from flexplant.assembly import System

KEPT = ("sha256", "format", "reader", "units")


def origin(system: System) -> dict[str, Any]:
    """{"components": {name: file, sha256, format, reader, units, files beside it}} of the components read from files, else {}.

    Files by name alone: a plant is passed on, and the folders of the computer that made it are nobody's business.
    """
    read = {c.name: _record(c.source) for c in system.components if "path" in c.source}
    return {"components": read} if read else {}


def _record(source: Mapping[str, Any]) -> dict[str, Any]:
    """One component's provenance without its folders."""
    beside = source.get("files", {})
    record = {"file": PurePath(str(source["path"])).name} | {key: source[key] for key in KEPT if key in source}
    return record | ({"files": {PurePath(str(name)).name: digest for name, digest in beside.items()}} if beside else {})
