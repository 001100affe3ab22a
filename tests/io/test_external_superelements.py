"""Superelements whose rows are told by the cards beside them: matrices in `.op2`, and modal coordinates held by grids."""

from __future__ import annotations

import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from nx_files import TRUSS
from op2_files import dmig_words, write_op2
from structures import shared

from flexplant.errors import ReadError
from flexplant.io import read_component
from flexplant.io.parse.bulk import read_cards
from flexplant.io.parse.dmig import dmig_matrices
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
    with pytest.raises(ReadError, match=r"\.asm and \.pch .EXTSEOUT."):
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


KEY = struct.pack("<3i", 114, 1, 120)


def dmig_tables(pch: Path) -> list[bytes]:
    """The DMIG entries of a punch file in the words of OUTPUT2, a matrix each."""
    out = []
    for name, matrix in dmig_matrices(read_cards(pch)).items():
        columns: dict[tuple[int, int], list[tuple[int, int, float]]] = {}
        for (row, column), value in sorted(matrix.terms.items(), key=lambda item: (item[0][1], item[0][0])):
            if matrix.form != 6 or row >= column:
                columns.setdefault(column, []).append((*row, value))
        out.append(dmig_words(name, columns, matrix.form, matrix.columns))
    return out


@pytest.mark.parametrize("pool", [False, True])
def test_dmig_entries_in_output2_are_those_of_the_punch_file(tmp_path: Path, pool: bool) -> None:
    """MSC's DMIG superelement, its entries moved to OUTPUT2: in one table, or in a data block a matrix."""
    pch = shared("cofe_dmig_bar", "barmat.pch")
    words = dmig_tables(pch)
    tables = {"MATPOOL": KEY + b"".join(words)} if pool else {w[:8].decode().strip(): KEY + w for w in words}
    path = write_op2(tmp_path / "bar.op2", {}, tables)
    rest = [card for card in read_cards(pch) if card.name in ("ASET", "ASET1", "BSET1", "GRID", "QSET1", "SPOINT")]
    (tmp_path / "bar.pch").write_text("".join(",".join((card.name, *card.fields)) + "\n" for card in rest))
    theirs, ours = read_component(pch, units="SI"), read_component(path, units="SI")
    assert (ours.source["format"], ours.dofs.pairs) == ("nastran_op2", theirs.dofs.pairs)
    np.testing.assert_array_equal(ours.stiffness, theirs.stiffness)
    np.testing.assert_array_equal(ours.mass, theirs.mass)
    if not pool:
        bulk = pytest.importorskip("pyyeti.nastran.bulk")
        name = next(w[:8].decode().strip() for w in words if w.startswith(b"K"))
        table = bulk.rddmig(str(path))[name.lower()]
        rows = [theirs.dofs.row(int(n), int(d)) for n, d in table.index]
        np.testing.assert_array_equal(table.to_numpy(), dense(theirs.stiffness)[np.ix_(rows, rows)])


def test_dmig_entries_alone_give_a_component_without_positions(tmp_path: Path) -> None:
    columns = {(3, 1): [(3, 1, 2.0), (90, 0, -1.0)], (90, 0): [(90, 0, 5.0)]}
    words = dmig_words("KAAX", columns) + dmig_words("MAAX", {(3, 1): [(3, 1, 1.5)], (90, 0): [(90, 0, 1.0)]})
    part = read_component(write_op2(tmp_path / "d.op2", {}, {"MATPOOL": KEY + words}))
    assert (part.boundary.pairs, part.modal_ids.tolist(), part.nodes) == ([(3, 1)], [90], None)
    np.testing.assert_array_equal(part.stiffness, [[2, -1], [-1, 5]])
    (tmp_path / "d.pch").write_text("GRID,3,,1.,2.,3.\n")
    np.testing.assert_array_equal(read_component(tmp_path / "d.op2").nodes.position(3), [1, 2, 3])
    single = dmig_words("KAAX", columns, kind=1) + dmig_words("MAAX", {(3, 1): [(3, 1, 1.5)], (90, 0): [(90, 0, 1.0)]})
    again = read_component(write_op2(tmp_path / "d.op2", {}, {"MATPOOL": KEY + single}))
    np.testing.assert_array_equal(again.stiffness, part.stiffness)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (dmig_words("KAAX", {(3, 1): [(3, 1, 2.0)]})[:-20], "ends within a value"),
        (dmig_words("KAAX", {}).replace(struct.pack("<2i", 2, 2), struct.pack("<2i", 4, 4)), "KAAX is of type 4"),
        (dmig_words("KAAX", {(3, 1): [(3, 1, 2.0), (3, 1, 4.0)]}), "DMIG in MATPOOL.*two values for 3-1, 3-1"),
        (dmig_words("KAAX", {(3, 1): [(3, 1, 2.0)]}), "no pair of square matrices"),
    ],
)
def test_broken_dmig_entries_name_their_block(tmp_path: Path, words: bytes, message: str) -> None:
    path = write_op2(tmp_path / "d.op2", {}, {"MATPOOL": KEY + words})
    with pytest.raises(ReadError, match=message):
        read_component(path)
