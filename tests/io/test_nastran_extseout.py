"""Nastran superelements: frequencies, geometry and mass against NX Nastran's own answers; partial boundaries; labels."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from nx_files import CENTER, FIXED_INTERFACE_HZ, INERTIA_DIAGONAL, MASS, PRODUCT_YZ, TRUSS

from flexplant.errors import InputError, ReadError
from flexplant.io import read_component
from flexplant.io.parse.op2 import read_op2_matrices
from flexplant.model.component import Component
from flexplant.model.geometry import rigid_body_vectors

BOUNDARY = [(grid, d) for grid in (3, 11, 19, 27) for d in range(1, 7)]
SIDES = ("outboard", "inboard")


@pytest.fixture(scope="module", params=SIDES)
def component(request: pytest.FixtureRequest) -> Component:
    return read_component(TRUSS / f"{request.param}.op4")


def boundary_mass(component: Component, about: np.ndarray) -> np.ndarray:
    """R^T Mbb R; a Craig-Bampton component moves rigidly when its boundary does, so this is the rigid-body mass."""
    rigid = rigid_body_vectors(component.nodes, component.boundary, about=about)
    n = component.n_boundary
    return rigid.T @ component.mass[:n, :n] @ rigid


def test_boundary_and_modal_rows(component: Component) -> None:
    assert component.boundary.pairs == BOUNDARY
    first = {"outboard": 1995001, "inboard": 2995001}[component.name]
    assert list(component.modal_ids) == list(range(first, first + len(FIXED_INTERFACE_HZ[component.name])))


def test_fixed_interface_frequencies(component: Component) -> None:
    expected = np.array(FIXED_INTERFACE_HZ[component.name])
    assert np.allclose(component.fixed_interface_hz, expected, rtol=1e-12, atol=0)


def test_mass_properties_follow_from_the_boundary(component: Component) -> None:
    at_origin = boundary_mass(component, np.zeros(3))
    assert at_origin[0, 0] == pytest.approx(MASS[component.name], rel=1e-9)
    center = np.array([at_origin[1, 5], at_origin[2, 3], at_origin[0, 4]]) / at_origin[0, 0]
    assert np.allclose(center, CENTER[component.name], rtol=1e-9)
    about = boundary_mass(component, center)
    assert np.allclose(np.diag(about)[3:], INERTIA_DIAGONAL[component.name], rtol=1e-9)
    assert about[4, 5] == pytest.approx(PRODUCT_YZ[component.name], rel=1e-6)


def test_rigid_motion_of_the_boundary_costs_no_energy(component: Component) -> None:
    """K R = 0 holds only with grid 11 in its own frame (CORD2R 10) and the others in the basic one."""
    rigid = rigid_body_vectors(component.nodes, component.boundary, about=np.mean(component.nodes.positions, axis=0))
    n = component.n_boundary
    force = component.stiffness[:n, :n] @ rigid
    scale = abs(component.stiffness[:n, :n]).max() * abs(rigid).max()
    assert abs(force).max() < 1e-12 * scale


def test_frame_of_grid_11(component: Component) -> None:
    """CORD2R 10: x along basic y, y along basic z, z along basic x."""
    assert np.array_equal(component.nodes.frame(11), [[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    assert np.array_equal(component.nodes.frame(3), np.eye(3))
    assert np.array_equal(component.nodes.position(11), [600.0, 300.0, 300.0])


def test_displacement_recovery_returns_the_boundary(component: Component) -> None:
    """MUG1's rows of a boundary grid are unit rows: recovered displacement = that coordinate."""
    table = component.recovery["mug1"]
    for column, (node, direction) in enumerate(component.boundary.pairs):
        row = table.displacement[table.row(f"{node}.{direction}")]
        assert row[column] == pytest.approx(1.0, abs=1e-12)
        assert abs(np.delete(row, column)).max() < 1e-9


def test_recovery_labels(component: Component) -> None:
    grids = {"outboard": (3, 11, 19, 27, 45, 60), "inboard": (3, 4, 11, 16, 19, 27)}[component.name]
    expected = [f"{g}.{d}" for g in grids for d in range(1, 7)]
    labels = list(component.recovery["mug1"].labels)
    assert labels[:36] == expected
    bars = {"outboard": (1, 2, 7), "inboard": (10, 97)}[component.name]
    assert list(component.recovery["mef1"].labels) == [f"CBAR.{bar}.{i}" for bar in bars for i in range(1, 9)]
    if component.name == "outboard":
        assert labels[36:] == ["1995002.0", *[f"1995002.{i}" for i in range(2, 7)]]
        scalar = component.recovery["mug1"].displacement[36]
        assert np.flatnonzero(scalar).tolist() == [24 + 1]
        assert scalar[25] == 1.0
    else:
        assert component.recovery["mes1"].displacement.shape == (27, 32)
        assert component.recovery["mes1"].labels[-1] == "CBAR.89.9"


def test_any_of_the_three_files_or_the_stem_will_do() -> None:
    whole = read_component(TRUSS / "inboard.op4")
    for name in ("inboard.asm", "inboard.pch", "inboard"):
        other = read_component(TRUSS / name) if name != "inboard" else read_component(TRUSS / name, format="nastran_extseout")
        assert np.array_equal(other.stiffness, whole.stiffness)
        assert other.boundary.pairs == whole.boundary.pairs


def test_provenance_names_every_file() -> None:
    source = read_component(TRUSS / "inboard.op4").source
    assert source["path"] == str(TRUSS / "inboard.op4")
    assert len(source["sha256"]) == 64
    assert source["format"] == "nastran_extseout"
    assert {p.rsplit(".", 1)[-1] for p in source["files"]} == {"asm", "pch"}
    assert "PX (32, 30)" in source["unused"]


def test_units_scale_lengths_and_keep_frequencies() -> None:
    raw, si = read_component(TRUSS / "outboard.op4"), read_component(TRUSS / "outboard.op4", units="mm-kg-s")
    assert np.allclose(si.fixed_interface_hz, raw.fixed_interface_hz, rtol=1e-13)
    assert np.allclose(si.nodes.positions, raw.nodes.positions / 1000)
    assert boundary_mass(si, np.zeros(3))[0, 0] == pytest.approx(MASS["outboard"], rel=1e-9)
    assert si.source["units"] == "mm-kg-s"


def test_modal_damping_is_diagonal_in_q() -> None:
    damped = read_component(TRUSS / "inboard.op4", damping=0.005)
    expected = 2 * 0.005 * 2 * np.pi * np.array(FIXED_INTERFACE_HZ["inboard"])
    assert np.allclose(np.diag(damped.damping)[24:], expected, rtol=1e-9)
    assert not damped.damping[:24].any()


def test_partial_boundary() -> None:
    """Grid 475 holds direction 2 only, which the .pch alone knows."""
    component = read_component(TRUSS / "reduced_bset_notall6.pch")
    assert component.n == 29
    assert component.boundary.pairs[-2:] == [(441, 6), (475, 2)]
    assert component.n_modal == 10
    assert component.recovery["mug1"].displacement.shape == (3108, 29)
    rigid = rigid_body_vectors(component.nodes, component.boundary)
    n = component.n_boundary
    residual = component.stiffness[:n, :n] @ rigid
    assert abs(residual).max() < 1e-6 * abs(component.stiffness[:n, :n]).max() * abs(rigid).max()


def test_unknown_option_is_named() -> None:
    with pytest.raises(InputError, match="Did you mean 'structural'"):
        read_component(TRUSS / "inboard.op4", structral="ignore")


@pytest.fixture
def copied(tmp_path):
    for ending in ("op4", "asm", "pch"):
        shutil.copy(TRUSS / f"inboard.{ending}", tmp_path)
    return tmp_path


def test_without_pch_the_asm_must_fit(copied) -> None:
    (copied / "inboard.pch").unlink()
    component = read_component(copied / "inboard.op4")
    assert component.boundary.pairs == BOUNDARY
    assert component.n_modal == 8


def test_damping_in_the_file(copied) -> None:
    """Viscous damping is the component's; structural damping is never dropped in silence."""
    from pyyeti.nastran import op4 as peer

    plain = read_component(copied / "inboard.op4")
    viscous = 0.01 * plain.stiffness
    matrices = {"kxx": plain.stiffness, "mxx": plain.mass, "bxx": viscous, "k4xx": np.zeros((1, 1))}
    peer.write(str(copied / "inboard.op4"), matrices)
    assert np.array_equal(read_component(copied / "inboard.op4").damping, viscous)
    replaced = read_component(copied / "inboard.op4", damping=0.0)
    assert not replaced.damping.any()
    peer.write(str(copied / "inboard.op4"), matrices | {"k4xx": 0.02 * plain.stiffness})
    assert np.array_equal(read_component(copied / "inboard.op4").structural_damping, 0.02 * plain.stiffness)
    with pytest.raises(ReadError, match="structural damping"):
        read_component(copied / "inboard.op4", structural="error")
    assert np.array_equal(read_component(copied / "inboard.op4", structural="ignore").damping, viscous)
    with pytest.raises(InputError, match="structural='sometimes'"):
        read_component(copied / "inboard.op4", structural="sometimes")


def test_missing_matrix_and_wrong_size(copied) -> None:
    pch = copied / "inboard.pch"
    text = pch.read_text()
    pch.write_text(text.replace(" 2995007       0 2995008       0", " 2995007       0", 1))
    with pytest.raises(ReadError, match=r"KXX has shape \(32, 32\), but the files beside it list 31 DOF"):
        read_component(copied / "inboard.op4")
    op4 = copied / "inboard.op4"
    op4.write_bytes(op4.read_bytes().replace(b"MXX     ", b"MYY     "))
    pch.write_text(text)
    with pytest.raises(ReadError, match="no mass matrix MXX or MAA"):
        read_component(op4)


def test_missing_coordinate_system(copied) -> None:
    for ending in ("asm", "pch"):
        file = copied / f"inboard.{ending}"
        file.write_text(file.read_text().replace("CORD2R*               10", "CORD2R*               11"))
    with pytest.raises(ReadError, match="coordinate system 10, which is not in the file"):
        read_component(copied / "inboard.op4")


def test_no_files_beside(copied) -> None:
    (copied / "inboard.pch").unlink()
    (copied / "inboard.asm").unlink()
    with pytest.raises(ReadError, match=r"neither \.pch nor .asm"):
        read_component(copied / "inboard.op4", format="nastran_extseout")


def test_boundary_comes_first_whatever_the_order_of_the_file(copied) -> None:
    """EXTRN with the scalar points first: rows are matched by id, never by place."""
    from pyyeti.nastran import op4 as peer

    before = read_component(copied / "inboard.op4")
    order = np.r_[np.arange(24, 32), np.arange(24)]
    matrices = {"kxx": before.stiffness[np.ix_(order, order)], "mxx": before.mass[np.ix_(order, order)]}
    peer.write(str(copied / "inboard.op4"), matrices)
    scalars = "".join(f"EXTRN   {2995000 + i:8d}       0\n" for i in range(1, 9))
    grids = "".join(f"EXTRN   {g:8d}  123456\n" for g in (3, 11, 19, 27))
    kept = [line for line in (copied / "inboard.pch").read_text().splitlines() if line.startswith(("GRID", "CORD", "*"))]
    (copied / "inboard.pch").write_text("\n".join([*kept, scalars + grids]))
    after = read_component(copied / "inboard.op4")
    assert after.boundary.pairs == BOUNDARY
    assert np.array_equal(after.stiffness, before.stiffness)
    assert np.array_equal(after.mass, before.mass)


@pytest.mark.parametrize(("name", "number"), [("outboard", 101), ("inboard", 102)])
def test_output2_tables_give_the_same_component(name: str, number: int) -> None:
    """The NAS2CAM `.op2` and `.op4` of the same run: bit-equal matrices, DOF, positions and frames, without pyYeti."""
    ours, theirs = read_component(TRUSS / "nas2cam.op2", superelement=number), read_component(TRUSS / f"{name}.op4")
    assert ours.source["format"] == "nastran_op2"
    assert ours.dofs.pairs == theirs.dofs.pairs
    np.testing.assert_array_equal(ours.stiffness, theirs.stiffness)
    np.testing.assert_array_equal(ours.mass, theirs.mass)
    np.testing.assert_array_equal(ours.nodes.positions, theirs.nodes.positions)
    np.testing.assert_allclose(ours.nodes.frames, theirs.nodes.frames, atol=1e-15)
    with pytest.raises(ReadError, match=r"has the superelements 101, 102; pass superelement= \(got None\)"):
        read_component(TRUSS / "nas2cam.op2")


def test_output2_matrices(tmp_path: Path) -> None:
    """KHH of the assembled run is diagonal: the squares of Nastran's circular frequencies; a sidecar makes it a component."""
    matrix = read_op2_matrices(TRUSS / "assemble.op2")["KHH"]
    hz = np.sqrt(np.diag(matrix)[6:]) / (2 * np.pi)
    np.testing.assert_allclose(hz[[0, -1]], [1.6988002150369577, 4937.1522799384065], rtol=1e-7)
    (tmp_path / "modes.yaml").write_text('matrices: {mass: KHH, stiffness: KHH}\nboundary: [[1, "123456"]]\n')
    read = read_component(TRUSS / "assemble.op2", sidecar=tmp_path / "modes.yaml")
    assert (read.n_modal, read.source["format"]) == (48, "nastran_op2")
