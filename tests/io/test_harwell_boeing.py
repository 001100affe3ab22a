"""Harwell-Boeing text as HBMAT writes it, against scipy's writer and against fields without blanks between them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from test_matrix_formats import IDS, NODES, PAIRS, model

from flexplant.errors import ReadError
from flexplant.io import read_component, read_model
from flexplant.io.parse.harwell_boeing import read_harwell_boeing
from flexplant.model.component import FiniteElementModel

NAMES = ["UX", "UY", "UZ"]


def fixed(numbers: list[str], width: int, each: int) -> list[str]:
    fields = [text.rjust(width) for text in numbers]
    return ["".join(fields[i : i + each]) for i in range(0, len(fields), each)]


def harwell_boeing(matrix: np.ndarray, kind: str = "RSA", right: bool = False) -> str:
    """Lower triangle by columns; values fill their fields to the last character, with D exponents."""
    half = sp.csc_array(np.tril(matrix) if kind == "RSA" else matrix)
    half.sort_indices()
    parts = [
        fixed([str(i + 1) for i in half.indptr], 8, 10),
        fixed([str(i + 1) for i in half.indices], 8, 10),
        fixed([f"{v:25.16E}".replace("E", "D") for v in half.data], 25, 3),
    ]
    n, loads = matrix.shape[0], fixed(["0.1"] * matrix.shape[0], 25, 3) if right else []
    cards = "".join(f"{c:14d}" for c in (sum(map(len, parts)) + len(loads), *map(len, parts), len(loads)))
    head = [f"{'STIFFNESS':72}{'FILE':8}", cards, f"{kind:14}" + "".join(f"{c:14d}" for c in (n, n, half.nnz, 0))]
    head += ["(10I8)          (10I8)          (1P,3D25.16)        (1P,3D25.16)        "] + ["F" + " " * 13] * right
    return "\n".join([*head, *(line for part in parts for line in part), *loads]) + "\n"


def folder_of(folder: Path, m: FiniteElementModel, order: np.ndarray, **options: object) -> Path:
    """K and M in the solver's order with the mapping text."""
    for what, matrix in (("stiff", m.stiffness), ("mass", m.mass)):
        (folder / f"job_{what}.matrix").write_text(harwell_boeing(matrix[np.ix_(order, order)], **options))
    rows = [f"{i + 1:10d}{PAIRS[k][0]:10d}  {NAMES[PAIRS[k][1] - 1]}" for i, k in enumerate(order)]
    (folder / "job_stiff.mapping").write_text(" Matrix Eqn      Node   DOF\n" + "\n".join(rows) + "\n")
    return folder / "job_stiff.matrix"


@pytest.mark.parametrize(("kind", "right"), [("RSA", False), ("RSA", True), ("RUA", False)])
def test_matrices_and_mapping_give_the_model_back(tmp_path: Path, kind: str, right: bool) -> None:
    order = np.random.default_rng(2).permutation(12)
    given = model()
    path = folder_of(tmp_path, given, order, kind=kind, right=right)
    table = "\n".join(f"{n} " + " ".join(map(repr, NODES.position(n).tolist())) for n in IDS)
    (tmp_path / "nodes.txt").write_text(table)
    read = read_model(path, coordinates=tmp_path / "nodes.txt")
    assert read.source["format"] == "ansys_hbmat"
    at = read.dofs.rows(PAIRS)
    np.testing.assert_array_equal(read.stiffness.toarray()[np.ix_(at, at)], given.stiffness)
    np.testing.assert_array_equal(read.mass.toarray()[np.ix_(at, at)], given.mass)
    np.testing.assert_array_equal(read.nodes.position(7), NODES.position(7))
    assert len(read.source["files"]) == 3


def test_the_numbers_are_those_written(tmp_path: Path) -> None:
    """Every digit, whichever program wrote the file."""
    m = model().stiffness
    (tmp_path / "ours").write_text(harwell_boeing(m))
    np.testing.assert_array_equal(read_harwell_boeing(tmp_path / "ours").toarray(), m)
    scipy.io.hb_write(tmp_path / "theirs", sp.csc_matrix(m))
    np.testing.assert_array_equal(read_harwell_boeing(tmp_path / "theirs").toarray(), m)


def test_a_superelement_with_modal_rows(tmp_path: Path) -> None:
    """A table of node,direction says which rows are modal; damping is found by its name."""
    path = folder_of(tmp_path, model(), np.arange(12))
    (tmp_path / "job_stiff.mapping").unlink()
    (tmp_path / "job_damp.matrix").write_text(harwell_boeing(0.1 * np.eye(12)))
    (tmp_path / "job_stiff.csv").write_text("node,direction\n" + "".join(f"{n},{d}\n" for n, d in [(1, 0), *PAIRS[:11]]))
    part = read_component(path)
    assert (part.n_boundary, part.n_modal) == (11, 1)
    np.testing.assert_allclose(part.damping.toarray(), 0.1 * np.eye(12))
    with pytest.raises(ReadError, match="use read_component"):
        read_model(path)


@pytest.mark.parametrize(("number", "ending"), [(8, ".sub"), (2, ".emat")])
def test_binary_files_say_which_commands_make_text_of_them(tmp_path: Path, number: int, ending: str) -> None:
    path = tmp_path / f"job{ending}"
    path.write_bytes(struct.pack("<103i", 100, 0, number, *([0] * 99), 100))
    with pytest.raises(ReadError, match=rf"binary \{ending} file.*FILE,job,{ending[1:]}.*HBMAT"):
        read_component(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("RSA", "CSA"), r"line 3.*'CSA'; RSA and RUA"),
        (("RSA", "RSE"), r"'RSE'"),
        (("            12            12", "            12            13"), "12 rows and 13 columns"),
        (("            12            12", "         99999         99999"), "column pointers: 100000 numbers"),
        (("(10I8)  ", "(10Q8)  "), r"line 4.*format '\(10Q8\)' is not understood"),
        (("(10I8)          (10I8)          (1P,3D25.16)", "(10I8)"), "2 formats; three are needed"),
        (("\n       1", "\n       2"), "do not rise from 1"),
    ],
)
def test_malformed_files_name_the_line(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    text = harwell_boeing(model().stiffness)
    assert change[0] in text
    (tmp_path / "K").write_text(text.replace(*change, 1))
    with pytest.raises(ReadError, match=message):
        read_harwell_boeing(tmp_path / "K")


def test_lines_that_are_missing_are_announced(tmp_path: Path) -> None:
    lines = harwell_boeing(model().stiffness).splitlines()
    (tmp_path / "K").write_text("\n".join(lines[:-2]))
    with pytest.raises(ReadError, match=r"announces \d+ lines of numbers, \d+ are left"):
        read_harwell_boeing(tmp_path / "K")
    (tmp_path / "K").write_text("\n".join([*lines[:-1], lines[-1][:-9] + "x" * 9]))
    with pytest.raises(ReadError, match="values"):
        read_harwell_boeing(tmp_path / "K")
