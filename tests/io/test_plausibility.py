"""Numbers that are no structure in the given units are told while reading, once a file; right units raise no alarm."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from nx_files import TRUSS
from structures import shared
from typer.testing import CliRunner

import flexplant as fp
from flexplant.cli import app
from flexplant.io import plausibility, read_component, read_model, write_component, write_model
from flexplant.io.plausibility import Quantities, quantities

CALCULIX = Path(__file__).parent / "calculix"
SHOCKSAT = Path(__file__).parents[2] / "examples" / "shocksat" / "data"
POUND, INCH, G = 4.4482216152605, 0.0254, 9.80665


@pytest.fixture(autouse=True)
def warnings_are_errors():
    with warnings.catch_warnings():
        warnings.simplefilter("error", fp.PlausibilityWarning)
        yield


def in_units(model, length: float, mass: float, factor: float = 1.0):
    """An SI model's numbers in another system; mass times factor."""
    d = np.where((model.dofs.direction >= 1) & (model.dofs.direction <= 3), length, 1.0)
    energy = mass * length**2
    matrices = {k: d[:, None] * getattr(model, k).toarray() * d / energy for k in ("mass", "stiffness")}
    matrices["mass"] *= factor
    nodes = replace(model.nodes, positions=model.nodes.positions / length)
    return replace(model, **matrices, nodes=nodes, units="as written", source={})


def alarms(*readings) -> list[str]:
    """What is told while files are read."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", fp.PlausibilityWarning)
        for read in readings:
            read()
    return [str(w.message) for w in told]


def test_right_units_raise_no_alarm() -> None:
    """Our own files, each with its units."""
    calculix = [partial(read_model, CALCULIX / f"{job}.sti", units="SI") for job in ("clamped", "rigid")]
    truss = [partial(read_component, TRUSS / f"{name}.op4", units="mm-kg-s") for name in ("outboard", "inboard")]
    truss.append(partial(read_component, TRUSS / "nas2cam.op2", units="mm-kg-s", superelement=101))
    assert alarms(*calculix, *truss, *(partial(read_component, SHOCKSAT / f"{part}.OU1") for part in ("bus", "optic"))) == []
    assert len(alarms(partial(read_component, TRUSS / "outboard.op4", units="SI"))) == 1, "the same ears hear a wrong unit"


def test_delivered_files_with_right_units_raise_no_alarm() -> None:
    """Every delivered file, each with its units."""
    readings = [
        partial(read_model, shared("shocksat", f"{part}_KM.npz"), geometry=shared("shocksat", f"cb_{part}.bdf"))
        for part in ("bus", "optic")
    ]
    readings.append(partial(read_component, shared("cofe_dmig_bar", "barmat.pch")))
    readings.append(partial(read_model, shared("exudyn_rotor", "rotorDiscTestSTIF1.mtx"), stiffness_factor=1e-2))
    readings.append(partial(read_model, shared("exudyn_rotor", "rotorAnsysStiffnessMatrixSparse.txt")))
    beams = shared("cofe_cb_beams", "cantilever_components_KM.npz")
    for i in (1, 2):
        deck = shared("cofe_cb_beams", "cantilever_bar", f"cantileverBar{i}.dat")
        readings.append(partial(read_model, beams, part=i, geometry=deck, units="inch-slinch-s"))
    assert alarms(*readings) == []


def test_a_truss_in_millimetres_read_as_si_warns_once() -> None:
    """The millimetre truss is 300 m long as SI: its mass and frequencies are possible, its density is not."""
    for name in ("outboard.op4", "inboard.op4"):
        with pytest.warns(fp.PlausibilityWarning, match=rf"{name}: mass over size cubed .*units= to convert") as told:
            wrong = read_component(TRUSS / name, units="SI")
        assert len(told) == 1
        assert told[0].filename == __file__, "the caller's line"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fp.PlausibilityWarning)
            again = read_component(TRUSS / name)
        np.testing.assert_array_equal(wrong.mass, again.mass)


@pytest.mark.parametrize(
    ("length", "mass", "units"), [(1e-3, 1e3, "mm-tonne-s"), (1e-3, 1.0, "mm-kg-s"), (INCH, POUND / INCH, "inch-slinch-s")]
)
def test_a_block_in_other_units_warns_only_when_read_as_si(tmp_path: Path, length: float, mass: float, units: str) -> None:
    block = read_model(CALCULIX / "rigid.sti", units="SI")
    path = write_model(in_units(block, length, mass), tmp_path / "b.npz")
    same = read_model(path, units=units)
    np.testing.assert_allclose(same.mass, block.mass.toarray(), rtol=1e-12, atol=1e-12)
    with pytest.warns(fp.PlausibilityWarning, match="mass over size cubed"):
        read_model(path, units="SI")


def test_weight_taken_for_mass_warns(tmp_path: Path) -> None:
    """Weight read as slinch is 386 times too dense; slinch read as weight is too light and sounds 20 times too fast."""
    block = read_model(CALCULIX / "rigid.sti", units="SI")
    weight = write_model(in_units(block, INCH, POUND / INCH, G / INCH), tmp_path / "weight.npz")
    np.testing.assert_allclose(read_model(weight, units="inch-lbf").mass, block.mass.toarray(), rtol=1e-12, atol=1e-12)
    with pytest.warns(fp.PlausibilityWarning, match=r"mass over size cubed 5\.671e\+04 kg/m\^3"):
        read_model(weight, units="inch-slinch-s")
    slinch = write_model(in_units(block, INCH, POUND / INCH), tmp_path / "slinch.npz")
    notes = plausibility(read_model(slinch, units="inch-lbf"))
    assert len(notes) == 1
    assert "frequency times size 3.1" in notes[0]


def test_a_component_is_judged_by_its_boundary_only_where_that_says_something(tmp_path: Path) -> None:
    """Three tonnes on a small ring are no error; a boundary 300 m wide is."""
    nodes = fp.Nodes(ids=[1, 2], positions=[[0, 0, 0], [0.1, 0, 0]])
    boundary = [(n, d) for n in (1, 2) for d in (1, 2, 3)]
    tie = np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(3)) * 1e6
    heavy = fp.Component(name="h", mass=np.eye(6) * 1500, stiffness=tie, boundary=boundary, nodes=nodes)
    assert read_component(write_component(heavy, tmp_path / "h.npz")).n == 6
    assert quantities(heavy, modes=False).mass == pytest.approx(3000)
    far = replace(heavy, nodes=replace(nodes, positions=nodes.positions * 3e4))
    with pytest.warns(fp.PlausibilityWarning, match=r"size 3000 m"):
        read_component(write_component(far, tmp_path / "f.npz"))


def test_absurd_numbers_are_told_without_arithmetic_warnings(tmp_path: Path) -> None:
    nodes = fp.Nodes(ids=[1, 2], positions=[[0, 0, 0], [1, 0, 0]])
    dofs = [(n, d) for n in (1, 2) for d in (1, 2, 3)]
    model = fp.FiniteElementModel(name="a", mass=np.eye(6) * 1e308, stiffness=np.eye(6) * 1e-308, dofs=dofs, nodes=nodes)
    path = write_model(model, tmp_path / "a.npz")
    with pytest.warns(fp.PlausibilityWarning, match="mass inf kg"):
        read_model(path)


def test_a_model_with_few_finite_modes_is_described() -> None:
    """Massless rotations: six finite modes are fewer than are shown."""
    beams = shared("cofe_cb_beams", "cantilever_components_KM.npz")
    deck = shared("cofe_cb_beams", "cantilever_bar", "cantileverBar1.dat")
    rows = dict(fp.io.inspect(beams, part=1, geometry=deck, units="inch-slinch-s").rows)
    assert rows["first frequencies [Hz]"].count(",") == 5


def test_the_command_line_tells_it_in_one_line(tmp_path: Path) -> None:
    run = CliRunner().invoke
    for command in (["check", str(TRUSS / "outboard.op4")], ["convert", str(TRUSS / "outboard.op4"), str(tmp_path / "o.npz")]):
        result = run(app, command)
        notes = [line for line in result.stderr.splitlines() if "note:" in line]
        assert len(notes) == 1, result.output
        assert "outboard.op4: mass over size cubed" in notes[0]
        assert "note:" not in run(app, [*command, "--units", "mm-kg-s"]).stderr
        if command[0] == "check":
            assert "outboard.op4: units are not stated; the numbers are taken as SI" in result.stdout
            assert "not stated" not in run(app, [*command, "--units", "mm-kg-s"]).stdout
    shown = run(app, ["inspect", str(TRUSS / "outboard.op4")])
    assert "is outside 5e-05 to 20000" in shown.stdout
    assert shown.stderr == ""


def test_units_that_nobody_stated_are_named_so() -> None:
    with pytest.warns(fp.PlausibilityWarning, match=r"\(units not stated: numbers as in the file\)"):
        read_component(TRUSS / "outboard.op4")


@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_sizes_beyond_any_structure_are_judged_too(size):
    rows = dict(Quantities(mass=1.0, size=size, frequency_hz=1.0).rows())
    assert rows["mass over size cubed"] == (np.inf if size < 1 else 0.0)
