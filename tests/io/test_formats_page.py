"""The documentation's table of formats is the registry's; inspecting and converting files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from nx_files import TRUSS

from flexplant.errors import InputError, ReadError
from flexplant.io import convert, inspect, plausibility, read_component, read_plant, write_model, write_plant
from flexplant.io.format_table import markdown
from flexplant.model.component import FiniteElementModel
from flexplant.model.geometry import Nodes
from flexplant.plant.modal import ModalPlant

ROOT = Path(__file__).parents[2]
PLANT = ModalPlant(omega=[0.0, 9.0], zeta=0.01, shape_in=np.ones((2, 1)), shape_out=np.ones((1, 2)), inputs=["f"], outputs=["y"])


@pytest.mark.parametrize("page", ["README.md", "docs/formats.md"])
def test_the_pages_have_the_current_table(page: str) -> None:
    """When this fails: python -c "from flexplant.io.format_table import update; update('README.md')", and so for the docs."""
    assert markdown() in (ROOT / page).read_text(encoding="utf-8")


def test_inspecting_a_superelement() -> None:
    text = str(inspect(TRUSS / "outboard.op4", units="mm-kg-s"))
    for expected in ("component", "24 DOF at nodes 3, 11, 19, 27", "mug1 (42 rows", "1.590384", "0.3", "1.7577", "VA (46, 1)"):
        assert expected in text


def test_inspecting_models_plants_and_decks(tmp_path: Path) -> None:
    write_plant(PLANT, tmp_path / "p.npz")
    assert "2, 1 rigid" in str(inspect(tmp_path / "p.npz"))
    assert "geometry" in str(inspect(TRUSS / "outboard.blk"))
    (tmp_path / "noise.bin").write_bytes(bytes(range(256)))
    with pytest.raises(ReadError, match="not recognised"):
        inspect(tmp_path / "noise.bin")


def test_converting(tmp_path: Path) -> None:
    target = convert(TRUSS / "outboard.op4", tmp_path / "o.h5", units="mm-kg-s", name="left")
    component = read_component(target)
    assert component.name == "left"
    assert component.units == "SI"
    np.testing.assert_array_equal(component.stiffness, read_component(TRUSS / "outboard.op4", units="mm-kg-s").stiffness)
    write_plant(PLANT, tmp_path / "p.npz")
    assert read_plant(convert(tmp_path / "p.npz", tmp_path / "p.h5")).inputs == ("f",)
    assert convert(tmp_path / "p.npz", tmp_path / "p.c", dt=0.01).exists()
    with pytest.raises(InputError, match="is that file already"):
        convert(tmp_path / "p.npz", tmp_path / "p.npz")
    with pytest.raises(InputError, match="which choose the format"):
        convert(tmp_path / "p.npz", tmp_path / "p.op4")


def test_implausible_units_are_told_not_changed(tmp_path: Path) -> None:
    """A 300 mm frame in mm and tonnes, read as if it were SI."""
    frame = Nodes(ids=[1, 2], positions=[[0, 0, 0], [5000.0, 0, 0]])
    dofs = [(n, d) for n in (1, 2) for d in (1, 2, 3)]
    spring = np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(3)) * 1e3
    model = FiniteElementModel(name="m", mass=np.eye(6) * 1e-4, stiffness=spring, dofs=dofs, nodes=frame)
    notes = plausibility(model)
    assert "mass 0.0002 kg is outside" in notes[0]
    assert "size 5000 m" in notes[1]
    assert "mass over size cubed 1.6e-15" in notes[2]
    assert len(notes) == 4
    assert "note" in str(inspect(write_model(model, tmp_path / "m.npz")))
    assert plausibility(read_component(TRUSS / "outboard.op4", units="mm-kg-s")) == []
