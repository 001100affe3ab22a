"""KGG and MGG that MYSTRAN 18.0 kept, against the frequencies of the same run (its .F06, seven digits)."""

from __future__ import annotations

import shutil
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexplant.errors import ReadError
from flexplant.io import read_model
from flexplant.model.component import FiniteElementModel
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import rigid_body_vectors
from flexplant.modes import normal_modes

PANEL = Path(__file__).parent / "mystran" / "panel.L1L"
CYCLES = [4.285427, 5.740432, 12.95723, 57.69636, 102.3805, 114.3929]


def without(model: FiniteElementModel, held: set[tuple[int, int]]) -> FiniteElementModel:
    """The model with the held DOF struck out."""
    rows = [i for i, pair in enumerate(model.dofs.pairs) if pair not in held]
    dofs = DofSet(model.dofs.node[rows], model.dofs.direction[rows])
    return replace(model, mass=model.mass[rows][:, rows], stiffness=model.stiffness[rows][:, rows], dofs=dofs)


def test_frequencies_are_mystrans_own() -> None:
    """The SPC of the deck applied to what was read (drilling rotations have no stiffness and are held too, as AUTOSPC does)."""
    model = read_model(PANEL, units="SI")
    assert (model.source["format"], sorted(model.dofs.nodes)) == ("mystran_sparse", [3, 7, 9, 12, 15, 21, 40])
    held = {(n, d) for n in (3, 21) for d in range(1, 7)} | {(40, 6)}
    held |= {(n, d) for n, d in model.dofs.pairs if model.stiffness[[model.dofs.row(n, d)]].nnz == 0}
    clamped = without(model, held)
    np.testing.assert_allclose(normal_modes(clamped, n_modes=6).frequency_hz, CYCLES, rtol=5e-7)


def test_rows_stand_in_the_frames_of_their_grids() -> None:
    """Grid 15 has a cylindrical displacement frame: rigid motion costs nothing, and weighs what the deck says."""
    model = read_model(PANEL, units="SI")
    rigid = rigid_body_vectors(model.nodes, model.dofs)
    assert abs(model.stiffness @ rigid).max() < 1e-14 * abs(model.stiffness).max()
    weight = 2700 * (0.004 * 0.08 + 1e-4 * 0.3) + 1.5
    np.testing.assert_allclose((rigid.T @ model.mass @ rigid)[:3, :3], weight * np.eye(3), atol=1e-12)
    assert model.nodes.frames is not None


def folder(tmp_path: Path) -> Path:
    for ending in (".L1L", ".L1R", ".bdf"):
        shutil.copyfile(PANEL.with_suffix(ending), tmp_path / f"p{ending}")
    return tmp_path / "p.L1L"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("PARAM,GRIDSEQ,GRID", "PARAM,GRIDSEQ,BANDIT", "own sequence"),
        ("PARAM,GRIDSEQ,GRID\n", "", "own sequence"),
        ("SPC1,1,6,40", "RBE2,7,12,123456,40", r"has RBE2, which KGG leaves out"),
        ("SPC1,1,6,40", "SPOINT,90", "scalar points"),
        ("GRID,40,,0.4,0.2,0.3\n", "", r"term \d+ is \(.* in 36 rows"),
    ],
)
def test_decks_whose_rows_are_not_the_structure(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = folder(tmp_path)
    deck = path.with_suffix(".bdf")
    assert old in deck.read_text()
    deck.write_text(deck.read_text().replace(old, new))
    with pytest.raises(ReadError, match=message):
        read_model(path)


def test_missing_files_and_broken_records(tmp_path: Path) -> None:
    path = folder(tmp_path)
    data = path.read_bytes()
    for broken, message in (
        (data[:-5], r"announces 401 terms.*byte 16|byte 16.*announces 401 terms"),
        (data[:16] + struct.pack("<i", 2**31 - 1) + data[20:], "announces 2147483647"),
        (data[:24] + struct.pack("<i", 17) + data[28:], "term 1 "),
        (data[:28] + struct.pack("<i", -3) + data[32:], r"byte 24.*\(-3, 1\)"),
        (struct.pack("<i", 8) + data[4:], "time stamp"),
        (data[:20], "first two records"),
    ):
        path.write_bytes(broken)
        with pytest.raises(ReadError, match=message):
            read_model(path, format="mystran_sparse")
    path.write_bytes(data)
    path.with_suffix(".bdf").unlink()
    with pytest.raises(ReadError, match="needs its deck"):
        read_model(path)
    path.with_suffix(".L1R").unlink()
    with pytest.raises(ReadError, match=r"\.L1R"):
        read_model(path)
