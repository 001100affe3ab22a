"""The project's own `.npz` (layout: `flexplant.io.parse.own`), uncompressed so that every bit comes back fast."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexplant.io.formats import EXTRAS, Writer
from flexplant.io.parse.own import pack_component, pack_model
from flexplant.io.parse.own_plant import Plant, pack_plant
from flexplant.model.component import Component, FiniteElementModel


def _write(arrays: dict[str, Any], path: Path) -> None:
    with path.open("wb") as stream:
        np.savez(stream, **{name: np.asarray(value) for name, value in arrays.items()})  # type: ignore[arg-type]


def write_component(component: Component, path: Path, *, basis: bool = False) -> None:
    """A component; basis: with the basis that `expand` needs."""
    _write(pack_component(component, basis=basis), path)


def write_model(model: FiniteElementModel, path: Path) -> None:
    """A finite-element model."""
    _write(pack_model(model), path)


def write_plant(plant: Plant, path: Path) -> None:
    """A plant."""
    _write(pack_plant(plant), path)


WRITER = Writer(
    name="flexplant_npz",
    description="flexplant's own .npz",
    suffixes=(".npz",),
    holds=frozenset(EXTRAS),
    writers={"write_component": write_component, "write_model": write_model, "write_plant": write_plant},
)
