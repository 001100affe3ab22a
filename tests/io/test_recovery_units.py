"""Rows of recovery matrices in SI: rigid motion, the quantities of every row by hand, and what is not known stays and says so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from nx_files import TRUSS

from flexplant.io import read_component, read_geometry, write_component
from flexplant.model.geometry import rigid_body_vectors
from flexplant.model.recovery import Recovery
from flexplant.model.recovery_units import recovery_in_si
from flexplant.model.units import unit_system

MM = unit_system("mm-tonne-s")  # N, MPa


def test_a_rigid_motion_in_metres_recovers_metres_and_radians() -> None:
    """Grids inside the truss move with its boundary, by theta x r + t, r in metres from the deck."""
    component = read_component(TRUSS / "inboard.op4", units="mm-kg-s")
    rigid = rigid_body_vectors(component.nodes, component.boundary)
    seen = component.recovery["mug1"].displacement[:, : len(component.boundary)] @ rigid
    deck = read_geometry(TRUSS / "inboard.dat")
    for node in (4, 16):
        r = 1e-3 * deck.positions[list(deck.nodes).index(node)]
        expected = np.eye(6)
        expected[:3, 3:] = [[0, r[2], -r[1]], [-r[2], 0, r[0]], [r[1], -r[0], 0]]
        rows = [component.recovery["mug1"].row(f"{node}.{d}") for d in range(1, 7)]
        np.testing.assert_allclose(seen[rows], expected, atol=1e-6 * abs(r).max())
    assert component.recovery["mug1"].units == "m or rad"


def test_forces_and_stresses_of_a_motion_are_those_of_the_file_in_si() -> None:
    """The same motion in both units: translations in mm, q in sqrt(kg) mm; mN, mN mm and mN/mm^2 to N, N m and Pa."""
    file, si = (read_component(TRUSS / "inboard.op4", units=u) for u in (None, "mm-kg-s"))
    p = np.random.default_rng(1).standard_normal(si.n)
    in_file = p * np.where((si.dofs.direction >= 4), 1.0, 1e3)
    for name, factor in (("mef1", np.tile([1e-6] * 4 + [1e-3] * 3 + [1e-6], 2)), ("mes1", 1e3)):
        expected = factor * (file.recovery[name].displacement @ in_file)
        np.testing.assert_allclose(si.recovery[name].displacement @ p, expected, rtol=1e-9, atol=1e-12 * abs(expected).max())
    assert (si.recovery["mef1"].units, si.recovery["mes1"].units) == ("N m or N", "Pa")
    assert file.recovery["mes1"].units == ""


@pytest.mark.parametrize(
    ("name", "label", "unit", "factor"),
    [
        ("mug1", "7.2", "m", 1e-3),
        ("mug1", "7.6", "rad", 1.0),
        ("mug1", "901.0", "", np.sqrt(1e3) * 1e-3),
        ("mqg1", "7.3", "N", 1.0),
        ("mqmg1", "7.4", "N m", 1e-3),
        ("mef1", "CBAR.1.7", "N", 1.0),
        ("mef1", "CROD.1.2", "N m", 1e-3),
        ("mef1", "CBUSH.1.4", "N m", 1e-3),
        ("mef1", "CQUAD4.1.3", "N/m", 1e3),
        ("mef1", "CTRIA3.1.6", "N", 1.0),
        ("mes1", "CHEXA.3.1", "Pa", 1e6),
        ("mee1", "CBAR.1.1", "", 1.0),
    ],
)
def test_every_quantity_has_its_factor(name: str, label: str, unit: str, factor: float) -> None:
    given = Recovery(name, [label], np.array([[2.0, 3.0]]), acceleration=np.array([[1.0, 0.0]]))
    found = recovery_in_si(given, MM, [901])
    assert found.units == unit
    np.testing.assert_allclose(found.displacement, [[2 * factor, 3 * factor]], rtol=1e-14)
    np.testing.assert_allclose(found.acceleration, [[factor, 0.0]], rtol=1e-14)


@pytest.mark.parametrize(
    ("name", "label"),
    [("mug1", "901.0"), ("mug1", "7"), ("mef1", "CBAR.1.9"), ("mef1", "CELAS1.4.1"), ("mes1", "CBUSH.4.1"), ("drm", "tip.x"),
     ("mgf1", "CBAR.1.2")],
)  # fmt: skip
def test_what_is_not_known_stays_and_says_so(name: str, label: str) -> None:
    given = Recovery(name, ["7.1" if name == "mug1" else "CBAR.1.1", label], np.eye(2))
    found = recovery_in_si(given, MM, [])
    np.testing.assert_array_equal(found.displacement, np.eye(2))
    assert found.units == "units of the file (mm-tonne-s)"
    assert recovery_in_si(given, unit_system("SI"), []).units == ""


def test_rows_whose_unit_the_file_states_are_left_alone() -> None:
    given = Recovery("mug1", ["7.1"], np.eye(1), units="mm")
    assert recovery_in_si(given, MM, []) is given


@pytest.mark.parametrize("ending", [".npz", ".h5"])
def test_our_own_files_are_not_converted_again(tmp_path: Path, ending: str) -> None:
    given = read_component(TRUSS / "inboard.op4", units="mm-kg-s")
    back = read_component(write_component(given, tmp_path / f"a{ending}"))
    for name, recovery in given.recovery.items():
        np.testing.assert_array_equal(back.recovery[name].displacement, recovery.displacement)
        assert back.recovery[name].units == recovery.units
