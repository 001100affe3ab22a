"""The *USER ELEMENT layout of substructures: a file that CalculiX wrote, and the variants of the layout."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexplant.errors import ReadError
from flexplant.io import read_component, read_model

CALCULIX = Path(__file__).parent / "calculix"
RNG = np.random.default_rng(8)


def triangle(matrix: np.ndarray) -> str:
    """Rows of the lower triangle, each from a new line on, four numbers a line, with Abaqus' commas."""
    rows = [row[: i + 1] for i, row in enumerate(matrix.tolist())]
    return "".join(", ".join(f"{v:.13e}" for v in row[at : at + 4]) + ",\n" for row in rows for at in range(0, len(row), 4))


def substructure(matrices: dict[str, np.ndarray], nodes: str = "** 101, 102,\n** 7", dofs: str = "1, 2, 3\n3, 1, 6\n") -> str:
    head = f"**\n** SUBSTRUCTURE Z101\n*USER ELEMENT, NODES=           3, LINEAR\n** ELEMENT NODES\n{nodes}\n{dofs}"
    return head + "".join(f"*MATRIX,TYPE={kind}\n{triangle(m)}" for kind, m in matrices.items())


def symmetric(n: int) -> np.ndarray:
    half = np.round(RNG.standard_normal((n, n)), 8)
    return half + half.T + 8 * np.eye(n)


def test_a_substructure_that_calculix_wrote() -> None:
    """*SUBSTRUCTURE GENERATE of CalculiX 2.20 writes this layout; entry by entry it is the part of its own stored stiffness.

    (That build leaves the interior at rest, so what it writes is Kbb, not the condensed stiffness.)
    """
    whole = read_model(CALCULIX / "brickall.sti", units="SI")
    brick = read_component(CALCULIX / "brick.mtx", massless=True, units="SI")
    assert brick.boundary.pairs == [(n, d) for n in (1, 4, 5, 8) for d in (1, 2, 3)]
    assert brick.source["format"] == "abaqus_substructure"
    rows = whole.dofs.rows(brick.boundary.pairs)
    stored = whole.stiffness.toarray()[np.ix_(rows, rows)]
    np.testing.assert_allclose(brick.stiffness, stored, atol=1e-12 * abs(stored).max())
    np.testing.assert_array_equal(brick.nodes.position(8), [0, 0.1, 0.1])
    with pytest.raises(ReadError, match="MASS=YES"):
        read_component(CALCULIX / "brick.mtx")


def test_structural_damping_is_read_where_it_is_asked_for(tmp_path: Path) -> None:
    """No public page shows it in such a file: an error, unless the caller says to take the words as they stand."""
    k, m, d = (symmetric(8) for _ in range(3))
    path = tmp_path / "job.mtx"
    path.write_text(substructure({"STIFFNESS": k, "MASS": m, "STRUCTURAL DAMPING": d}))
    np.testing.assert_allclose(read_component(path, structural="read").structural_damping, d, rtol=1e-13)
    left = read_component(path, structural="ignore")
    assert (left.structural_damping, left.source["unused"]) == (None, ["STRUCTURAL DAMPING"])


def test_the_layout_of_abaqus(tmp_path: Path) -> None:
    """DOF lists that change at a node, comment lines of several lengths, mass and viscous damping."""
    k, m, c = (symmetric(8) for _ in range(3))
    (tmp_path / "job_sub.mtx").write_text(substructure({"STIFFNESS": k, "MASS": m, "VISCOUS DAMPING": c}))
    (tmp_path / "job.inp").write_text("*Node\n7, 0., 0., 1.\n101, 1., 0., 0.\n102, 2., 0., 0.\n103, 3., 0., 0.\n")
    read = read_component(tmp_path / "job_sub.mtx")
    assert read.boundary.pairs == [(101, 1), (101, 2), (101, 3), (102, 1), (102, 2), (102, 3), (7, 1), (7, 6)]
    for kind, matrix in (("stiffness", k), ("mass", m), ("damping", c)):
        np.testing.assert_allclose(getattr(read, kind), matrix, rtol=1e-13, err_msg=kind)
    assert read.nodes.position(7).tolist() == [0, 0, 1]
    assert read.n_modal == 0


def test_retained_eigenmodes_become_modal(tmp_path: Path) -> None:
    k, m = symmetric(8), symmetric(8)
    path = tmp_path / "s.mtx"
    path.write_text(substructure({"STIFFNESS": k, "MASS": m}, nodes="** 101, 900, 102", dofs="1, 2, 3\n2, 1, 2\n3, 1, 2, 3\n"))
    read = read_component(path, modal_nodes=[900])
    assert (read.n_boundary, read.n_modal) == (6, 2)
    order = [0, 1, 2, 5, 6, 7, 3, 4]
    np.testing.assert_allclose(read.stiffness, k[np.ix_(order, order)], rtol=1e-13)
    assert read_component(path).n_modal == 0
    path.write_text(path.read_text().replace("900", "0"))
    assert read_component(path).n_modal == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("** ELEMENT NODES", "** NODES"), "has no .. ELEMENT NODES"),
        (("1, 2, 3\n3, 1, 6\n", ""), "no DOF for its first node"),
        (("3, 1, 6\n", "4, 1, 6\n"), r"line 8.*no place of 3 nodes"),
        (("3, 1, 6\n", "3, 1, 9\n"), r"DOF from 1 to 6"),
        (("3, 1, 6\n", ""), r"has 36 numbers; 9 DOF need 45"),
        (("TYPE=STIFFNESS\n", "TYPE=STIFFNESS\nnonsense,\n"), r"line 9.*text among the numbers"),
        (("TYPE=MASS", "TYPE=STIFFNESS"), "two matrices of one type"),
        (("TYPE=MASS", "TYPE=STRUCTURAL DAMPING"), "not documented; pass structural='read'.*'ignore'"),
        (("TYPE=STIFFNESS", "TYPE=LOAD"), "has no .MATRIX,TYPE=STIFFNESS; it holds LOAD, MASS"),
        (("*MATRIX,TYPE=MASS", "*USER ELEMENT, NODES=3\n*MATRIX,TYPE=MASS"), "has 2 .USER ELEMENT blocks"),
        (("101, 102,", "101, 1o2,"), r"line 5.*not a list of integers"),
        (("101, 102,", "101, 101,"), "listed twice: 101-1"),
    ],
)
def test_malformed_substructures_name_the_line(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    text = substructure({"STIFFNESS": symmetric(8), "MASS": symmetric(8)})
    assert change[0] in text
    (tmp_path / "s.mtx").write_text(text.replace(*change, 1))
    with pytest.raises(ReadError, match=message):
        read_component(tmp_path / "s.mtx", format="abaqus_substructure")
