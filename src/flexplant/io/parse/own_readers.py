"""The readers of the project's own layout, whichever container holds its arrays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexplant.io.parse.files import provenance
from flexplant.io.parse.npz import MAX_BYTES
from flexplant.io.parse.own import unpack_component, unpack_model
from flexplant.model.component import Component, FiniteElementModel


def own_readers(load: Callable[..., dict[str, Any]], format_name: str, module: str) -> dict[str, Callable[..., Any]]:
    """read_component and read_model over `load`(path, max_bytes=): values as they were written, source["origin"] as it was."""

    def read_component(path: Path, *, name: str | None = None, max_bytes: float = MAX_BYTES) -> Component:
        return unpack_component(load(path, max_bytes=max_bytes), path, provenance(path, format_name, module), name)

    def read_model(path: Path, *, name: str | None = None, max_bytes: float = MAX_BYTES) -> FiniteElementModel:
        return unpack_model(load(path, max_bytes=max_bytes), path, provenance(path, format_name, module), name)

    return {"read_component": read_component, "read_model": read_model}
