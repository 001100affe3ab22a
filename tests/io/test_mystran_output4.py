"""MYSTRAN's SOL 31 results with nothing but the deck beside them."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from mystran_program import MYSTRAN, needs_mystran

from flexplant.errors import ReadError
from flexplant.io import inspect, read_component
from flexplant.model.geometry import rigid_body_vectors

HERE = Path(__file__).parent
DATA = HERE.parents[1] / "examples" / "shocksat" / "data"
BOUNDARY = [(10, 2), (10, 4), (10, 6), (12, 1), (12, 3), (12, 5), *((30, d) for d in range(1, 7))]


def beam(folder: Path, deck: tuple[str, str] = ("", "")) -> Path:
    """A real run: boundary DOF scattered over grids and entries, frames of their own at two grids; the deck changed."""
    shutil.copyfile(HERE / "mystran" / "beam.OU1", folder / "beam.OU1")
    text = (HERE / "mystran" / "beam.bdf").read_text()
    assert deck[0] in text
    (folder / "beam.bdf").write_text(text.replace(*deck))
    return folder / "beam.OU1"


def test_the_rows_are_the_suport_entries_by_grid(tmp_path: Path) -> None:
    """A free beam: rigid motions at the boundary's places and frames cost no energy, and weigh what the deck says."""
    read = read_component(beam(tmp_path))
    assert (read.boundary.pairs, read.n_modal, read.source["format"]) == (BOUNDARY, 4, "mystran_output4")
    rigid = rigid_body_vectors(read.nodes, read.boundary)
    n = len(BOUNDARY)
    force = read.stiffness[:n, :n] @ rigid
    assert abs(force).max() < 1e-8 * abs(read.stiffness).max()
    length = np.linalg.norm(np.diff([[0, 0, 0], [0.5, 0, 0], [1, 0.1, 0], [1.5, 0, 0.2], [2, 0, 0]], axis=0), axis=1).sum()
    mass = rigid.T @ read.mass[:n, :n] @ rigid
    np.testing.assert_allclose(np.diag(mass)[:3], 2 + 2700 * 1e-4 * length, rtol=1e-6)
    np.testing.assert_allclose(read.mass[n:, n:], np.eye(4), atol=1e-10)
    assert ("boundary", "12 DOF at nodes 10, 12, 30") in inspect(tmp_path / "beam.OU1").rows


@pytest.mark.parametrize("part", ["bus", "optic"])
def test_the_same_component_as_with_a_sidecar(tmp_path: Path, part: str) -> None:
    for ending in (".OU1", ".bdf"):
        shutil.copyfile(DATA / f"{part}{ending}", tmp_path / f"{part}{ending}")
    plain, described = read_component(tmp_path / f"{part}.OU1"), read_component(DATA / f"{part}.OU1")
    assert (plain.source["format"], described.source["format"]) == ("mystran_output4", "output4")
    assert plain.boundary.pairs == described.boundary.pairs
    for kind in ("mass", "stiffness"):
        np.testing.assert_array_equal(getattr(plain, kind), getattr(described, kind))
    for node in plain.boundary.nodes:
        np.testing.assert_allclose(plain.nodes.position(node), described.nodes.position(node), atol=1e-9)


@needs_mystran
def test_what_mystran_writes_today_is_what_the_stored_file_holds(tmp_path: Path) -> None:
    shutil.copyfile(HERE / "mystran" / "beam.bdf", tmp_path / "beam.bdf")
    done = subprocess.run([MYSTRAN, "beam.bdf"], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert "terminated normally" in done.stdout
    (tmp_path / "stored").mkdir()
    now, stored = read_component(tmp_path / "beam.OU1"), read_component(beam(tmp_path / "stored"))
    hz = [
        scipy.linalg.eigh(c.stiffness + 1e3 * np.eye(c.n), c.mass + 1e-9 * np.eye(c.n), eigvals_only=True) for c in (now, stored)
    ]
    np.testing.assert_allclose(hz[0], hz[1], rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("PARAM,GRIDSEQ,GRID", ""), r"beam\.bdf: has no PARAM,GRIDSEQ,GRID"),
        (("SUPORT,30,123456", ""), "first 6 rows are coupled to the others"),
        (("SUPORT,10,246,12,135", "SUPORT,10,246,12,1356,13,123456"), r"record KXX: is of shape \(16, 16\); .*at least 19 rows"),
        (("SUPORT", "SUPORX"), "has no SUPORT entries"),
        (("GRID,30,", "GRID,31,"), "30"),
    ],
)
def test_decks_that_do_not_fit_are_refused(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    with pytest.raises(ReadError, match=message):
        read_component(beam(tmp_path, change))


def test_without_its_deck_or_of_another_solution_a_sidecar_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(ReadError, match="plain matrices need a sidecar"):
        read_component(beam(tmp_path, ("SOL 31", "SOL 103")))
    (tmp_path / "beam.bdf").unlink()
    with pytest.raises(ReadError, match="plain matrices need a sidecar"):
        read_component(tmp_path / "beam.OU1")
    with pytest.raises(ReadError, match=r"needs its deck \(.bdf, .dat, .nas\) beside it, or geometry="):
        read_component(tmp_path / "beam.OU1", format="mystran_output4")
    assert read_component(tmp_path / "beam.OU1", format="mystran_output4", geometry=HERE / "mystran" / "beam.bdf").n == 16
