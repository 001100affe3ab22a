"""MYSTRAN takes our external superelement as a matrix element and gives its matrices back bit-equal."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from mystran_program import MYSTRAN, needs_mystran
from nx_files import TRUSS

from flexplant.io import read_component, write_component
from flexplant.io.parse.op4 import read_op4
from flexplant.model.arrays import dense
from flexplant.model.component import Component
from flexplant.model.geometry import Nodes

DECK = """SOL 3
IN4 1 = PART.OP4
OUTPUT4 KGG,MGG,,,//-1/21
CEND
TITLE = MATRIX ELEMENT
METHOD = 1
SPC = 1
BEGIN BULK
EIGRL,1,,,{count}
SPC1,1,123456,{held}
{bulk}
ENDDATA
"""


def scrambled() -> Component:
    """Partial DOF, nodes in descending order with axes of their own, modal ids with a gap."""
    rng = np.random.default_rng(3)
    half = rng.standard_normal((2, 14, 14))
    q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    nodes = Nodes(ids=[12, 31], positions=rng.standard_normal((2, 3)), frames=np.array([np.eye(3), q * np.linalg.det(q)]))
    stiffness, mass = (part @ part.T + np.eye(14) for part in half)
    return Component(
        name="panel",
        mass=mass,
        stiffness=stiffness * 1e6,
        boundary=[(12, "123456"), (31, "13456")],
        nodes=nodes,
        modal_ids=[1001, 1002, 1007],
    )


def bulk_for_mystran(asm: str) -> str:
    """The `.asm` as a user edits it: SECONCT out, the dollar signs of the last entries away."""
    lines = asm.splitlines()
    begin = next(i for i, line in enumerate(lines) if line.startswith("GRID"))
    entries = next(i for i, line in enumerate(lines) if line.startswith("$ MYSTRAN"))
    return "\n".join([*lines[begin:entries], *(line.removeprefix("$") for line in lines[entries + 1 :])])


@needs_mystran
@pytest.mark.parametrize(("kind", "count"), [("nx truss", 6), ("scrambled", 3)])
def test_mystran_gives_the_same_matrices_and_frequencies(tmp_path: Path, kind: str, count: int) -> None:
    given = read_component(TRUSS / "outboard.op4", units="mm-kg-s") if kind == "nx truss" else scrambled()
    write_component(given, tmp_path / "PART.OP4", superelement=4)
    held = given.boundary.nodes[0]
    (tmp_path / "run.bdf").write_text(
        DECK.format(held=held, count=count, bulk=bulk_for_mystran((tmp_path / "PART.asm").read_text()))
    )
    done = subprocess.run([MYSTRAN, "run.bdf"], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    printed = (tmp_path / "run.F06").read_text()
    assert "MYSTRAN terminated normally" in done.stdout, printed[-3000:]
    theirs = read_op4(tmp_path / "run.OU1")
    expected = {"KGG": dense(given.stiffness), "MGG": dense(given.mass)}
    rows = [6 * given.boundary.nodes.index(n) + d - 1 for n, d in given.boundary.pairs]
    rows += [6 * len(given.boundary.nodes) + i for i in range(given.n_modal)]  # MYSTRAN has six rows a grid
    for name, matrix in expected.items():
        np.testing.assert_array_equal(dense(theirs[name])[np.ix_(rows, rows)], matrix)
    free = np.arange(6, given.n)
    values = scipy.linalg.eigh(*(m[np.ix_(free, free)] for m in expected.values()), eigvals_only=True)
    table = printed[printed.index("R E A L   E I G E N V A L U E S") :].splitlines()[4 : 4 + count]
    np.testing.assert_allclose([float(line.split()[2]) for line in table], values[:count], rtol=1e-6)


def test_rows_that_mystran_would_order_otherwise_get_no_entries(tmp_path: Path) -> None:
    nodes = Nodes(ids=[1], positions=np.zeros((1, 3)))
    swapped = Component(name="p", mass=np.eye(2), stiffness=np.eye(2), boundary=[(1, 2), (1, 1)], nodes=nodes)
    write_component(swapped, tmp_path / "p.op4")
    assert "CUSERIN" not in (tmp_path / "p.asm").read_text()
