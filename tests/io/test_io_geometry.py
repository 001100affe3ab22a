"""Bulk data: cards in every field layout, coordinate systems against an independent reader, outlines of decks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nx_files import TRUSS

from flexplant.errors import ReadError
from flexplant.io import read_component, read_geometry
from flexplant.io.parse.bulk import read_cards
from flexplant.io.parse.coordinates import Geometry
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import rigid_body_vectors

EXAMPLES = Path(__file__).parents[2] / "examples" / "shocksat" / "data"


def deck(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "deck.bdf"
    path.write_text(text)
    return path


def geometry(tmp_path: Path, text: str) -> Geometry:
    return Geometry.of(read_cards(deck(tmp_path, text)))


SAME_GRID = {
    "small": "GRID          12             1.5    -2.5     3.0\n",
    "short exponent": "GRID    12              1.5     -25.-1  300.-2\n",
    "fortran double": "GRID,12,,15.D-1,-2.5D0,3.\n",
    "free": "GRID,12,,1.5,-2.5,3.0\n",
    "free lower case": "grid,12,,1.5,-2.5,3.0 $ a comment\n",
    "large": "GRID*                 12                            1.50            -2.5\n*                    3.0\n",
    "large free": "GRID*,12,,1.5,-2.5,*A\n*A,3.0\n",
    "tabs": "GRID\t12\t\t1.5\t-2.5\t3.0\n",
    "after begin bulk": "SOL 103\nGRID = NONSENSE\nBEGIN BULK\nGRID,12,,1.5,-2.5,3.\nENDDATA\nGRID,12,,9.,9.,9.\n",
    "continued": "GRID,12,,1.5,-2.5,3.0\n",
}


@pytest.mark.parametrize("layout", SAME_GRID)
def test_one_grid_in_every_layout(tmp_path: Path, layout: str) -> None:
    nodes = geometry(tmp_path, SAME_GRID[layout]).nodes()
    assert nodes.ids.tolist() == [12]
    assert np.array_equal(nodes.positions, [[1.5, -2.5, 3.0]])


def test_continuation_lists_and_thru(tmp_path: Path) -> None:
    text = (
        "RBE2,7,12,123,1,2,3,4,5\n,6,7\nSPOINT,5,THRU,8\nSPOINT  11      12\n"
        "CBAR           1       2       3       4+C1\n+C1            5\n"
    )
    cards = read_cards(deck(tmp_path, text))
    assert cards[0].ids(3) == [1, 2, 3, 4, 5, 6, 7]
    assert Geometry.of(cards).scalars == [5, 6, 7, 8, 11, 12]
    assert cards[3].fields[8] == "5"


SYSTEMS = """\
CORD2R,10,0,1.,2.,3.,1.5,2.,4.
,3.,2.5,3.
CORD2C,20,10,0.5,-1.,2.,0.5,-1.,3.
,2.,-1.5,2.5
CORD2S,30,20,1.,30.,2.,1.,40.,5.
,3.,100.,2.
GRID,1,0,0.3,0.4,0.5,10
GRID,2,10,1.,2.,3.,20
GRID,3,20,2.,35.,-1.,20
GRID,4,30,2.,50.,70.,30
GRID,5,20,1.,200.,4.,30
GRID,6,0,4.,5.,6.,0
CORD1R,40,1,2,3
CORD1C,50,3,5,6
GRID,7,40,1.,1.,1.,50
GRID,8,50,2.,45.,1.,40
"""


def test_positions_and_frames_against_an_independent_reader(tmp_path: Path) -> None:
    """pyYeti's USET table has, for each grid, its basic position, and origin and axes of its displacement system."""
    with np.printoptions():
        from pyyeti.nastran import bulk, n2p

        lines = [line for line in SYSTEMS.splitlines() if not line.startswith(("CORD1", "GRID,7", "GRID,8"))]
        uset, _ = bulk.bulk2uset(str(deck(tmp_path, "\n".join(lines))))
        uset = uset[0] if isinstance(uset, tuple) else uset
    nodes = geometry(tmp_path, SYSTEMS).nodes()
    rigid = n2p.rbgeom_uset(uset)
    for grid in range(1, 7):
        rows = rigid[6 * (grid - 1) : 6 * grid]
        assert np.allclose(nodes.frame(grid), rows[:3, :3], atol=1e-12)
        ours = rigid_body_vectors(nodes, DofSet.of([(grid, "123456")]))
        assert np.allclose(ours, rows, atol=1e-11)


def test_systems_by_grids(tmp_path: Path) -> None:
    """CORD1: origin at the first grid, z towards the second, the third in the x-z plane: by hand."""
    nodes = geometry(tmp_path, SYSTEMS).nodes()
    a, b, c = (nodes.position(i) for i in (1, 2, 3))
    z = (b - a) / np.linalg.norm(b - a)
    x = (c - a) - z * ((c - a) @ z)
    x /= np.linalg.norm(x)
    axes = np.array([x, np.cross(z, x), z])
    assert np.allclose(nodes.position(7), a + axes.T @ [1, 1, 1], atol=1e-12)
    assert np.allclose(nodes.frame(8), axes, atol=1e-12)
    about = nodes.frame(7)  # cylindrical at grid 3, axis towards 5
    axis = nodes.position(5) - nodes.position(3)
    assert np.allclose(about[2], axis / np.linalg.norm(axis), atol=1e-12)
    arm = nodes.position(7) - nodes.position(3)
    assert arm @ about[1] == pytest.approx(0.0, abs=1e-12)
    assert arm @ about[0] > 0


WRONG = {
    "GRID,1,5,0.,0.,0.\n": "line 1: GRID refers to coordinate system 5, which is not in the file",
    "GRID,1,,a,0.,0.\n": "line 1: GRID field 4 is 'a'; a number is needed",
    "GRID,1,,1.+400,0.,0.\n": "a number is needed",
    "GRID,x,,0.,0.,0.\n": "line 1: GRID field 2 is 'x'; an integer is needed",
    "GRID,99999999999999999999,,0.,0.,0.\n": "an integer is needed",
    "GRID,1,,0.,0.,0.\nCORD2R,5,5,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nGRID,2,5,0.,0.,0.\n": "line 2: CORD2R is defined by itself",
    "CORD1R,5,1,2,3\nGRID,1,5,0.,0.,0.\nGRID,2,,0.,0.,1.\nGRID,3,,1.,0.,0.\n": "is defined by itself",
    "CORD2R,5,0,0.,0.,0.,0.,0.,1.\n,0.,0.,2.\nGRID,1,5,1.,1.,1.\n": "three points on one line",
    "CORD1R,5,1,2,3\nGRID,7,5,0.,0.,0.\n": "line 1: CORD1R refers to grid 1, which is not in the file",
    "GRID,1,,0.,0.,0.\nCBAR,1,1,1,2\n": r"line 2: CBAR refers to grids \[2\]",
    "GRID,1,,0.,0.,0.\nRBE2,1,1,123,2,3\n": r"line 2: RBE2 refers to grids \[2, 3\]",
    "GRID,1,,0.,0.,0.\nSPOINT,1,THRU,999999999999\n": "lists 1 THRU 999999999999",
    "GRID,1,,0.,0.,0.\nINCLUDE 'deck.bdf'\n": "nested more than 20 deep",
    "GRID,1,,0.,0.,0.\nINCLUDE '../x.bdf'\n": "lies outside the folder",
    "GRID,1,,0.,0.,0.\nINCLUDE 'x.bdf'\n": "no such file",
    "CQUAD4,1,1,1,2,3,4\n": "has no GRID entries",
}


@pytest.mark.parametrize("text", WRONG)
def test_mistakes_in_decks(tmp_path: Path, text: str) -> None:
    with pytest.raises(ReadError, match=WRONG[text]):
        read_geometry(deck(tmp_path, text))


def test_outline_of_the_truss_follows_its_include() -> None:
    mesh = read_geometry(TRUSS / "inboard.dat")
    assert len(mesh.nodes) == 26
    assert mesh.lines.shape == (66, 2)
    assert mesh.quads.shape == (0, 4)


def test_outline_of_the_spacecraft() -> None:
    mesh = read_geometry(EXAMPLES / "whole.bdf")
    assert len(mesh.nodes) == 2015
    assert mesh.quads.shape == (1920, 4)
    assert np.allclose(mesh.positions[mesh.nodes == 9101], [[0, 0, 72 * 0.0254]], atol=1e-12)
    edge = np.linalg.norm(mesh.positions[mesh.quads[:, 0]] - mesh.positions[mesh.quads[:, 1]], axis=1)
    assert edge.max() < 0.12  # a wrong place in `nodes` would span the structure


def test_triangles(tmp_path: Path) -> None:
    text = "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,5,,0.,1.,0.\nCTRIA3,1,1,1,2,5\nRBE2,9,1,123,2,5,1.-5\n"
    mesh = read_geometry(deck(tmp_path, text))
    assert mesh.quads.tolist() == [[0, 1, 2, 2]]
    assert mesh.lines.tolist() == [[0, 1], [0, 2]]


PUNCH = (TRUSS / "inboard.pch").read_bytes()


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.integers(0, 2500), st.integers(1, 255)), min_size=1, max_size=6), st.integers(100, len(PUNCH)))
def test_mutated_punch_files(tmp_path: Path, changes: list[tuple[int, int]], keep: int) -> None:
    data = bytearray(PUNCH)
    for at, value in changes:
        data[at] = value
    (tmp_path / "inboard.op4").write_bytes((TRUSS / "inboard.op4").read_bytes())
    (tmp_path / "inboard.pch").write_bytes(bytes(data[:keep]))
    try:
        component = read_component(tmp_path / "inboard.op4")
    except ReadError:
        return
    assert component.n == 32


def test_solids_show_their_skin_and_rbe3_its_spokes(tmp_path: Path) -> None:
    """Two bricks side by side: 10 faces outside; a tetrahedron has 4; an RBE3 joins its reference grid with three others."""
    grids = [(1 + i + 2 * j + 4 * k, i, j, k) for k in range(3) for j in range(2) for i in range(2)]
    text = "".join(f"GRID,{n},,{float(x)},{float(y)},{float(z)}\n" for n, x, y, z in grids)
    text += "CHEXA,1,1,1,2,4,3,5,6\n,8,7\nCHEXA,2,1,5,6,8,7,9,10\n,12,11\n"
    deck = tmp_path / "bricks.bdf"
    deck.write_text(text)
    assert len(read_geometry(deck).quads) == 10
    deck.write_text(text + "GRID,20,,9.,9.,9.\nCTETRA,3,1,1,2,3,20\nRBE3,9,,20,123,1.0,123,9,10\n,11\nPLOTEL,30,1,12\n")
    mesh = read_geometry(deck)
    assert len(mesh.quads) == 14
    centre = mesh.nodes.tolist().index(20)
    assert sorted(mesh.nodes[mesh.lines[mesh.lines[:, 0] == centre, 1]].tolist()) == [9, 10, 11]
    assert len(mesh.lines) == 4


TWICE = {
    "GRID,1,,0.,0.,0.\nGRID,1,,1.,0.,0.\n": r"line 2: GRID 1 is there already with other numbers \(line 1\)",
    "GRID,1,,0.,0.,0.\nGRID,1,,0.,0.,0.,7\nCORD2R,7,,0.,0.,0.,0.,0.,1.,\n+,1.,0.,0.\n": "line 2: GRID 1 is there already",
    "GRID,-3,,0.,0.,0.\n": "line 1: GRID has id -3; ids are 1 and above",
    "GRID,1,,0.,0.,0.\nCORD2R,7,,0.,0.,0.,0.,0.,1.,\n+,1.,0.,0.\nCORD2R,7,,0.,0.,0.,0.,0.,1.,\n+,0.,1.,0.\n": "CORD2R 7 is",
    "GRID,1,,0.,0.,0.\nCORD1R,-7,1,2,3\n": "line 2: CORD1R has id -7",
}


@pytest.mark.parametrize("text", TWICE)
def test_what_nastran_stops_at_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ReadError, match=TWICE[text]):
        read_geometry(deck(tmp_path, text))


def test_the_same_grid_twice_is_one_and_an_include_is_no_other_file(tmp_path: Path) -> None:
    same = "CORD2R,7,,0.,0.,0.,0.,0.,1.,\n+,1.,0.,0.\nGRID,1,,0.5,0.,0.,7\n"
    (tmp_path / "more.blk").write_text(same + "grid,1,0,5.-1,,,7\n")
    assert read_geometry(deck(tmp_path, same + "INCLUDE 'more.blk'\n")).positions.tolist() == [[0.5, 0, 0]]
    (tmp_path / "more.blk").write_text("GRID,1,,0.6,0.,0.,7\n")
    with pytest.raises(ReadError, match=r"more\.blk.*line 1: GRID 1 is there already with other numbers \(line 3 of deck\.bdf\)"):
        read_geometry(deck(tmp_path, same + "INCLUDE 'more.blk'\n"))
