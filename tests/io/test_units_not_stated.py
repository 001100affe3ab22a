"""A file that does not state its units leaves them open: through our own files, through coupling, up to the check report."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import flexplant as fp
from flexplant.cli import app
from flexplant.errors import CouplingError, InputError, PlausibilityWarning, ReadError
from flexplant.io import read_component, read_model, write_component, write_model
from flexplant.model.units import UNSTATED

POSITIONS = np.array([[0.0, 0, 0], [2000, 0, 0], [0, 3000, 0]])
K3 = np.array([[2.0, -1, -1], [-1, 2, -1], [-1, -1, 2]])


def part(name: str = "part", scale: float = 1.0) -> fp.Component:
    """Three nodes in a triangle held by springs that know no rotation: it moves freely in translation."""
    nodes = fp.Nodes(ids=[1, 2, 3], positions=scale * POSITIONS)
    pairs = [(n, d) for n in (1, 2, 3) for d in range(1, 7)]
    K, M = np.kron(K3, np.diag([1e5] * 3 + [0] * 3)), np.kron(np.eye(3), np.diag([5.0] * 3 + [1e5] * 3))
    return fp.Component(name=name, mass=M, stiffness=K, boundary=pairs, nodes=nodes)


def unstated(tmp_path: Path, name: str = "part") -> fp.Component:
    return read_component(write_component(part(name), tmp_path / f"{name}.op4"))


@pytest.mark.parametrize("ending", ["npz", "h5"])
def test_units_stay_open_through_our_own_files(ending: str, tmp_path: Path) -> None:
    vendor = unstated(tmp_path)
    assert (vendor.units, vendor.source["units"]) == (UNSTATED, "not stated: numbers as in the file")
    own = write_component(vendor, tmp_path / f"own.{ending}")
    back = read_component(own)
    assert (back.units, back.source["units"]) == (vendor.units, vendor.source["units"])
    direct = read_component(tmp_path / "part.op4", units="mm-kg-s")
    later = read_component(own, units="mm-kg-s")
    assert (later.units, later.source["units"]) == ("SI", "mm-kg-s")
    np.testing.assert_array_equal(later.stiffness, direct.stiffness)
    np.testing.assert_array_equal(later.nodes.positions, direct.nodes.positions)
    said = read_component(own, units="SI")
    assert said.units == "SI"
    np.testing.assert_array_equal(said.stiffness, vendor.stiffness)
    stated = write_component(later, tmp_path / f"si.{ending}")
    with pytest.raises(ReadError, match="says its units are 'SI'"):
        read_component(stated, units="mm-kg-s")


def test_recovery_rows_are_converted_when_the_units_are_said_later(tmp_path: Path) -> None:
    rows = fp.Recovery("mug1", ["1.1", "1.4"], displacement=np.eye(18)[[0, 3]])
    write_component(replace(part(), recovery=[rows]), tmp_path / "r.op4")
    own = write_component(read_component(tmp_path / "r.op4"), tmp_path / "own.npz")
    direct, later = read_component(tmp_path / "r.op4", units="mm-kg-s"), read_component(own, units="mm-kg-s")
    np.testing.assert_array_equal(later.recovery["mug1"].displacement, direct.recovery["mug1"].displacement)
    assert later.recovery["mug1"].units == direct.recovery["mug1"].units == "m or rad"


def test_a_reduction_of_a_model_without_units(tmp_path: Path) -> None:
    """Saying "SI" later keeps the basis usable; a conversion does not, and says so."""
    whole, K = part(), np.kron(K3, np.eye(6))
    given = {"mass": whole.mass, "stiffness": K, "dofs": whole.boundary, "nodes": whole.nodes}
    model = fp.FiniteElementModel(name="m", **given, units=UNSTATED)
    again = read_model(write_model(model, tmp_path / "m.npz"))
    assert again.units == UNSTATED
    component = fp.craig_bampton(again, [(1, "123456")], n_modes=2, keep_basis=True)
    path = write_component(component, tmp_path / "c.npz", basis=True)
    for units in (None, "SI"):
        assert fp.expand(read_component(path, units=units), np.ones(8)).shape == (18,)
    with pytest.raises(InputError, match="changed units"):
        fp.expand(read_component(path, units="mm-kg-s"), np.ones(8))


def test_files_of_earlier_versions_that_call_it_si(tmp_path: Path) -> None:
    path = write_component(part(), tmp_path / "old.npz")
    arrays = dict(np.load(path))
    header = json.loads(str(arrays["flexplant"])) | {"source": {"units": "not stated: numbers as in the file"}}
    np.savez(path, **(arrays | {"flexplant": np.asarray(json.dumps(header))}))
    assert read_component(path).units == UNSTATED
    assert read_component(path, units="mm-kg-s").units == "SI"


def test_openfast_is_not_given_numbers_of_unknown_units(tmp_path: Path) -> None:
    one = replace(part(), mass=np.eye(6), stiffness=np.eye(6), boundary=[(1, d) for d in range(1, 7)])
    read = read_component(write_component(one, tmp_path / "x.op4"))
    with pytest.raises(InputError, match="units are 'not stated', but ExtPtfm reads SI; pass units="):
        write_component(read, tmp_path / "x.extptfm")
    write_component(read_component(tmp_path / "x.op4", units="SI"), tmp_path / "x.extptfm")


def joined(a: fp.Component, b: fp.Component) -> fp.System:
    return fp.couple([a, b], [fp.Connection(a.name, b.name, [(n, n) for n in (1, 2, 3)])])


def test_coupling_what_states_its_units_with_what_does_not(tmp_path: Path) -> None:
    given = unstated(tmp_path, "b")
    with pytest.warns(PlausibilityWarning, match="units of b are not stated, while others are in SI"):
        system = joined(part("a"), given)
    check = fp.verify(system)["units stated by all components"]
    assert (check.passed, check.value) == (False, 1)
    both = joined(unstated(tmp_path, "a"), given)
    assert all("units" not in c.name for c in fp.verify(both).checks)
    with pytest.raises(CouplingError, match="units clash"):
        joined(part("a"), replace(part("b"), units="inch"))


def test_a_link_longer_than_what_it_joins_is_told(tmp_path: Path) -> None:
    """Millimetres on one side and metres on the other: the nodes are joined over kilometres."""
    with pytest.warns(PlausibilityWarning, match=r"a-b: a rigid link 2997 long between components whose nodes span 3:"):
        system = joined(part("a"), part("b", 1e-3))
    check = fp.verify(system)["longest rigid link / extent"]
    np.testing.assert_allclose(check.value, 999, rtol=1e-12)
    assert not check.passed
    bracket = fp.couple([part("a"), part("b")], [fp.Connection("a", "b", [(1, 2)])])
    check = fp.verify(bracket)["longest rigid link / extent"]
    np.testing.assert_allclose(check.value, 2 / 3, rtol=1e-12)
    assert check.passed
    paths = [str(write_component(part("a"), tmp_path / "a.npz")), str(write_component(part("b", 1e-3), tmp_path / "b.npz"))]
    told = CliRunner().invoke(app, ["couple", *paths, "--connect", "a:b:1,2,3"])
    assert told.exit_code == 1
    assert "flexplant: note: a-b: a rigid link 2997 long" in told.output
    assert "longest rigid link / extent" in told.output
