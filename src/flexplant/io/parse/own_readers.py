"""The readers of the project's own layout, whichever container holds its arrays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexplant.io.parse.files import provenance
from flexplant.io.parse.npz import MAX_BYTES
from flexplant.model.component import Component, FiniteElementModel

HEADER = "flexplant"  # the array that says what the others are


def own_readers(load: Callable[..., dict[str, Any]], format_name: str, module: str) -> dict[str, Callable[..., Any]]:
    """read_component and read_model over `load`(path, max_bytes=): values as they were written, source["origin"] as it was.

    What is particular to the layout is loaded with the first file: every format is known to the registry, few are read.
    """

    def read_component(path: Path, *, name: str | None = None, max_bytes: float = MAX_BYTES) -> Component:
        from flexplant.io.parse.own import unpack_component

        return unpack_component(load(path, max_bytes=max_bytes), path, provenance(path, format_name, module), name)

    def read_model(path: Path, *, name: str | None = None, max_bytes: float = MAX_BYTES) -> FiniteElementModel:
        from flexplant.io.parse.own import unpack_model

        return unpack_model(load(path, max_bytes=max_bytes), path, provenance(path, format_name, module), name)

    return {"read_component": read_component, "read_model": read_model}
