"""Superelements whose rows are told by the cards beside them: matrices in `.op2`, and modal coordinates held by grids."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from nx_files import TRUSS
from op2_files import write_op2

from flexplant.errors import ReadError
from flexplant.io import read_component
from flexplant.io.parse.op4 import read_op4
from flexplant.model.arrays import dense
from flexplant.modes import normal_modes

RNG = np.random.default_rng(4)
UNITS = "mm-kg-s"


def as_op2(folder: Path) -> Path:
    """The delivered outboard superelement with its matrices in OUTPUT2 instead of OUTPUT4."""
    for ending in (".asm", ".pch"):
        shutil.copyfile(TRUSS / f"outboard{ending}", folder / f"outboard{ending}")
    matrices = {name: dense(m) for name, m in read_op4(TRUSS / "outboard.op4").items()}
    return write_op2(folder / "outboard.op2", matrices)


def test_matrices_in_output2_are_the_same_superelement(tmp_path: Path) -> None:
    """Bit by bit what the .op4 gives: matrices, boundary, frames, recovery and its labels."""
    theirs, ours = read_component(TRUSS / "outboard.op4", units=UNITS), read_component(as_op2(tmp_path), units=UNITS)
    assert (theirs.source["format"], ours.source["format"]) == ("nastran_extseout", "nastran_op2")
    assert ours.dofs.pairs == theirs.dofs.pairs
    for kind in ("mass", "stiffness"):
        np.testing.assert_array_equal(getattr(ours, kind), getattr(theirs, kind))
    assert ours.recovery["mef1"].labels == theirs.recovery["mef1"].labels
    np.testing.assert_array_equal(dense(ours.recovery["mug1"].displacement), dense(theirs.recovery["mug1"].displacement))
    np.testing.assert_array_equal(ours.nodes.frames, theirs.nodes.frames)
    assert len(ours.source["files"]) == 2


def test_another_reader_takes_the_files_of_this_test(tmp_path: Path) -> None:
    """pyYeti reads the same matrices from them, so that they are OUTPUT2 and not only ours."""
    op2 = pytest.importorskip("pyyeti.nastran.op2")
    with op2.OP2(str(as_op2(tmp_path))) as file:
        matrices = file.rdop2mats()
    np.testing.assert_array_equal(matrices["KXX"], dense(read_op4(TRUSS / "outboard.op4")["KXX"]))


def test_alone_it_says_what_is_missing(tmp_path: Path) -> None:
    path = as_op2(tmp_path)
    path.with_suffix(".pch").unlink()
    path.with_suffix(".asm").unlink()
    with pytest.raises(ReadError, match=r"\.asm and \.pch .EXTSEOUT with MATOP2."):
        read_component(path)
    (tmp_path / "outboard.pch").write_text("ASET1   123456  3\n")
    with pytest.raises(ReadError, match=r"has shape \(46, 46\), but the files beside it list 6 DOF"):
        read_component(path)


def held_by_grids(folder: Path) -> tuple[Path, np.ndarray, np.ndarray]:
    """Two interface grids and five modes on grids 901 and 902 (six and one components of them), rows in the order of EXTRN."""
    rows = [(901, "123456"), (11, "123"), (902, "1"), (3, "123456")]
    n = sum(len(digits) for _, digits in rows)
    half = RNG.standard_normal((n, n))
    mass, stiffness = half @ half.T + n * np.eye(n), np.diag(np.arange(1.0, n + 1)) * 1e4
    path = write_op2(folder / "held.op2", {"KAA": stiffness, "MAA": mass})
    extern = "".join(f"EXTRN,{grid},{digits}\n" for grid, digits in rows)
    grids = "GRID,3,,0.,0.,0.\nGRID,11,,1.,0.,0.\nGRID,901,,0.,5.,0.\nGRID,902,,0.,6.,0.\n"
    (folder / "held.pch").write_text(extern + "QSET1,123456,901\nQSET,902,1\n" + grids)
    return path, mass, stiffness


def test_modal_coordinates_held_by_grids(tmp_path: Path) -> None:
    """A q-set on grids, not scalar points: their rows are modal, wherever they stand, and their places are no nodes."""
    path, mass, stiffness = held_by_grids(tmp_path)
    part = read_component(path)
    assert part.boundary.pairs == [(11, 1), (11, 2), (11, 3), *((3, d) for d in range(1, 7))]
    assert part.modal_ids.tolist() == [*range(9011, 9017), 9021]
    order = [6, 7, 8, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 9]
    np.testing.assert_array_equal(part.mass, mass[np.ix_(order, order)])
    np.testing.assert_array_equal(part.stiffness, stiffness[np.ix_(order, order)])
    assert part.nodes.ids.tolist() == [3, 11]
    omega2 = np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)
    np.testing.assert_allclose(normal_modes(part).frequency_hz, np.sqrt(omega2) / (2 * np.pi), rtol=1e-9)


def test_a_q_set_that_takes_part_of_a_grid(tmp_path: Path) -> None:
    """Only the components that are named are modal."""
    path, _, _ = held_by_grids(tmp_path)
    pch = path.with_suffix(".pch")
    pch.write_text(pch.read_text().replace("QSET1,123456,901", "QSET1,456,901"))
    part = read_component(path)
    assert (901, 3) in part.boundary
    assert part.modal_ids.tolist() == [9014, 9015, 9016, 9021]
    assert part.nodes.ids.tolist() == [3, 11, 901]
