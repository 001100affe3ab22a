"""What is written and can be read comes back bit-equal, names and units too; what a format cannot hold is listed here."""

from __future__ import annotations

import re
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from exported_plants import coupled, kinds, plant

import flexplant as fp
from flexplant.errors import InputError, ReadError
from flexplant.io import read_component, read_plant, write_component, write_plant
from flexplant.io.output import plant_endings, writers
from flexplant.model.arrays import dense
from flexplant.model.component import Component
from flexplant.model.geometry import Nodes
from flexplant.model.recovery import Recovery
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor

PLANT_LOSES: dict[str, set[str]] = {"npz": set(), "h5": set(), "hdf5": set(), "mat": {"report", "source"}}
SOURCE = {"components": {"bus": {"file": "bus.op4", "sha256": "00", "format": "nastran_extseout", "units": "SI"}}}
WRITE_ONLY = {"c", "fmu", "jl", "m"}  # programs, not data
# rtol of the matrices, and what does not come back
COMPONENT_LOSES: dict[str, tuple[float, set[str]]] = {
    "npz": (0.0, set()),
    "h5": (0.0, set()),
    "hdf5": (0.0, set()),
    "op4": (0.0, {"units"}),
    "pch": (1e-9, {"units"}),
    "mat": (0.0, {"modal_ids", "structural"}),
    "extptfm": (0.0, {"node", "modal_ids", "recovery", "structural"}),
}


def plants() -> dict[str, Any]:
    rng = np.random.default_rng(6)
    descriptor = Descriptor(
        sp.diags_array([2.0, 0.0, 1.0]), sp.csr_array(-np.eye(3) / 3), rng.standard_normal((3, 1)), sp.csr_array(np.ones((1, 3))),
        [[0.5]], ["u"], ["y"], name="d", input_units=["N"], output_units=["m"],
    )  # fmt: skip
    velocity = plant(shape_out_velocity=rng.standard_normal((2, 20)), feedthrough=rng.standard_normal((2, 3)))
    reported = plant(
        zeta=np.linspace(0, 0.02, 20), report={"modes_kept": 20, "dropped": [1, 2]}, source=SOURCE, input_units=["N", "", "N m"]
    )
    return kinds() | {"descriptor": descriptor, "velocity rows": velocity, "report": reported}


def equal(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) or sp.issparse(a):
        return b is not None and np.array_equal(dense(a), dense(b))
    return a == b


@pytest.mark.parametrize("ending", list(PLANT_LOSES))
@pytest.mark.parametrize("kind", list(plants()))
def test_plants_come_back_bit_equal(tmp_path: Path, kind: str, ending: str) -> None:
    given = plants()[kind]
    back = read_plant(write_plant(given, tmp_path / f"p.{ending}"))
    assert type(back) is type(given)
    for name, value in vars(given).items():
        assert equal(value, getattr(back, name)) or name in PLANT_LOSES[ending] | {"source"}, name
    assert dict(back.source.get("origin", {})) == ({} if "source" in PLANT_LOSES[ending] else given.source)
    for lost in (PLANT_LOSES[ending] - {"source"}) & set(vars(given)):
        assert not vars(back)[lost]


def test_every_plant_format_is_in_this_list(tmp_path: Path) -> None:
    assert set(plant_endings()) == set(PLANT_LOSES) | WRITE_ONLY
    for ending in WRITE_ONLY - {"m"}:
        with pytest.raises(ReadError, match="is not a plant"):
            read_plant(write_plant(plant(), tmp_path / f"p.{ending}", **({"dt": 1.0} if ending == "c" else {})))


def test_names_in_any_script_stay_as_they_are_and_apart(tmp_path: Path) -> None:
    """In .mat as UTF-16 with its units counted, as MATLAB and Octave do; scipy reads that too. In programs by their rules."""
    names = ["Kühler.1", "Kühler.2", "π ²", "Kähler.1"]
    given = fp.gain(np.ones((1, 4)), inputs=names, outputs=["Träger"])
    for ending in PLANT_LOSES:
        back = read_plant(write_plant(given, tmp_path / f"p.{ending}"))
        assert (list(back.inputs), list(back.outputs)) == (names, ["Träger"]), ending
    stored = scipy.io.loadmat(tmp_path / "p.mat")
    assert [str(cell.item()) for cell in stored["InputName"].ravel()] == names
    scipy.io.savemat(tmp_path / "scipy.mat", {**{k: stored[k] for k in "ABCD"}, "InputName": stored["InputName"]})
    assert list(read_plant(tmp_path / "scipy.mat").inputs) == names  # UTF-8 with its characters counted
    assert '["Kühler.1", "Kühler.2", "π ²", "Kähler.1"]' in write_plant(given, tmp_path / "p.jl").read_text("utf-8")
    write_plant(given, tmp_path / "p.c", dt=1.0)
    constants = re.findall(r"P_INPUT_\w+ = \d", (tmp_path / "p.h").read_text("utf-8"))
    assert len({c.split()[0] for c in constants}) == len(names)
    root = fromstring(zipfile.ZipFile(write_plant(given, tmp_path / "p.fmu", binary=False)).read("modelDescription.xml"))
    assert [v.get("name") for v in root.iter("ScalarVariable") if v.get("causality") == "input"] == names


def test_matrices_changed_in_matlab_are_taken_as_they_are(tmp_path: Path) -> None:
    """The modes beside them are then no longer those of the plant."""
    stored = scipy.io.loadmat(write_plant(coupled(), tmp_path / "p.mat"))
    changed = {k: v for k, v in stored.items() if not k.startswith("_")} | {"B": 2 * stored["B"]}
    scipy.io.savemat(tmp_path / "p.mat", changed)
    back = read_plant(tmp_path / "p.mat")
    assert not isinstance(back, ModalPlant)
    np.testing.assert_array_equal(back.B, 2 * stored["B"])


def component() -> Component:
    rng = np.random.default_rng(8)
    half = rng.standard_normal((4, 10, 10)) * 10.0 ** rng.integers(-6, 9, (4, 10, 10))
    stiffness, mass, damping, structural = half + half.transpose(0, 2, 1)
    return Component(
        name="panel", mass=mass, stiffness=stiffness, damping=damping, boundary=[(12, "123456")],
        nodes=Nodes(ids=[12], positions=rng.standard_normal((1, 3))), modal_ids=[101, 102, 107, 108], units="mm-tonne-s",
        structural_damping=structural,
        recovery={"mug1": Recovery(name="mug1", labels=["a", "b"], displacement=rng.standard_normal((2, 10)), units="m")},
    )  # fmt: skip


@pytest.mark.parametrize("ending", list(COMPONENT_LOSES))
def test_components_come_back(tmp_path: Path, ending: str) -> None:
    given, (rtol, lost) = component(), COMPONENT_LOSES[ending]
    if "structural" in lost:
        with pytest.raises(InputError, match="structural damping"):
            write_component(given, tmp_path / f"panel.{ending}")
        given = replace(given, structural_damping=None)
    if "recovery" in lost:
        with pytest.raises(InputError, match=r"recovery rows \(mug1\).*recovery=\{\}.*--drop recovery"):
            write_component(given, tmp_path / f"panel.{ending}")
        given = replace(given, recovery={})
    if ending == "mat":
        given = replace(given, units="SI")  # of another preset, the reader converts
    if ending == "extptfm":
        with pytest.raises(InputError, match="ExtPtfm reads SI"):
            write_component(given, tmp_path / "panel.extptfm")
        given = replace(given, units="SI")
    back = read_component(write_component(given, tmp_path / f"panel.{ending}"))
    for kind in ("mass", "stiffness", "damping"):
        np.testing.assert_allclose(getattr(back, kind), getattr(given, kind), rtol=rtol, atol=0)
    if "structural" not in lost:
        np.testing.assert_allclose(back.structural_damping, given.structural_damping, rtol=rtol, atol=0)
    assert back.name == given.name
    assert (back.boundary.pairs == given.boundary.pairs) == ("node" not in lost)
    assert equal(given.modal_ids, back.modal_ids) == ("modal_ids" not in lost)
    assert (back.units == given.units) == ("units" not in lost)
    if "recovery" in lost:
        assert not back.recovery
    else:
        ours, theirs = given.recovery["mug1"], back.recovery["mug1"]
        np.testing.assert_allclose(theirs.displacement, ours.displacement, rtol=rtol, atol=0)
        assert (theirs.labels, theirs.units) == (ours.labels, "m")


def test_every_component_format_is_in_this_list() -> None:
    able = {suffix[1:] for w in writers().values() if "write_component" in w.writers for suffix in w.suffixes}
    assert able == set(COMPONENT_LOSES) | {"m"}  # Simscape's script is a program
