"""The project's own HDF5 file (layout: `flexplant.io.parse.own`)."""

from __future__ import annotations

from pathlib import Path

from flexplant.io.formats import EXTRAS, Writer
from flexplant.io.parse.h5 import write_h5
from flexplant.io.parse.own import pack_component, pack_model
from flexplant.io.parse.own_plant import Plant, pack_plant
from flexplant.model.component import Component, FiniteElementModel


def write_component(component: Component, path: Path, *, basis: bool = False) -> None:
    """A component; basis: with the basis that `expand` needs."""
    write_h5(path, pack_component(component, basis=basis))


def write_model(model: FiniteElementModel, path: Path) -> None:
    """A finite-element model."""
    write_h5(path, pack_model(model))


def write_plant(plant: Plant, path: Path) -> None:
    """A plant."""
    write_h5(path, pack_plant(plant))


WRITER = Writer(
    name="flexplant_h5",
    description="flexplant's own HDF5 file",
    suffixes=(".h5", ".hdf5"),
    holds=frozenset(EXTRAS),
    writers={"write_component": write_component, "write_model": write_model, "write_plant": write_plant},
)
