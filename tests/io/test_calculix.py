"""Files that CalculiX 2.20 wrote, against its own eigenvalues (`*.dat`: the same deck without SOLVER=MATRIXSTORAGE)."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from flexplant.errors import InputError, ReadError
from flexplant.io import read_model
from flexplant.model.geometry import rigid_body_vectors
from flexplant.modes import normal_modes
from flexplant.reduction import craig_bampton
from flexplant.verification import mass_properties

FILES = Path(__file__).parent / "calculix"
DIGITS = 6e-7  # the .dat has seven digits


def frequencies(job: str) -> np.ndarray:
    """Cycles per time of the table E I G E N V A L U E   O U T P U T."""
    text = (FILES / f"{job}.dat").read_text().split("P A R T I C I P A T I O N")[0]
    rows = [line.split() for line in text.splitlines()]
    return np.array([float(row[3]) for row in rows if len(row) == 5 and row[0].isdigit()])


def test_bricks_and_tetrahedra_reach_calculix_frequencies() -> None:
    """Held DOF are not among the rows; a rectangular *TRANSFORM leaves the rows in global directions."""
    model = read_model(FILES / "clamped.sti", units="SI")
    assert (len(model.dofs), model.source["format"]) == (29, "calculix")
    assert (8, 1) not in model.dofs
    assert (8, 2) in model.dofs
    hz = frequencies("clamped")
    np.testing.assert_allclose(normal_modes(model, n_modes=5).frequency_hz, hz, rtol=DIGITS)


def test_a_rigid_face_gives_six_dof_at_its_reference_node() -> None:
    """The rotation node's rows are rotations 4-6 of the reference node; equations and the tip mass are in the rows left."""
    model = read_model(FILES / "rigid.sti", units="SI")
    assert [(101, d) in model.dofs for d in range(1, 7)] == [True] * 6
    assert not {1, 4, 5, 8, 31, 102} & set(model.dofs.nodes)
    modes = normal_modes(model, n_modes=8).frequency_hz
    np.testing.assert_array_equal(modes[:6], 0.0)
    np.testing.assert_allclose(modes[6:], frequencies("rigid")[6:], rtol=DIGITS)
    rigid = rigid_body_vectors(model.nodes, model.dofs)
    assert abs(model.stiffness @ rigid).max() < 1e-12 * abs(model.stiffness).max()
    body = 2700 * (3 * 0.1**3 + 0.1**2 * 0.1 / 3)  # three bricks and a pyramid of two tetrahedra
    np.testing.assert_allclose((rigid.T @ model.mass @ rigid)[:3, :3], (body + 0.4) * np.eye(3), atol=1e-11)


def test_a_rigid_face_is_an_interface() -> None:
    """Reduced to the six DOF of the reference node, the component has the mass of the model and its frequencies."""
    model = read_model(FILES / "rigid.sti", units="SI")
    component = craig_bampton(model, [(101, "123456")], n_modes=len(model.dofs) - 6)
    np.testing.assert_allclose(normal_modes(component, n_modes=8).frequency_hz[6:], frequencies("rigid")[6:], rtol=DIGITS)
    assert mass_properties(component).mass == pytest.approx(2700 * (0.003 + 0.001 / 3) + 0.4, rel=1e-10)


def test_expanded_shells_are_refused_or_renumbered() -> None:
    """CalculiX names the rows of the nodes it makes after old nodes: 2.1 stands for the upper and the lower one."""
    with pytest.raises(ReadError, match=r"panel\.dof.*line 5.*2\.1 is listed twice.*internal='keep'"):
        read_model(FILES / "panel.sti")
    model = read_model(FILES / "panel.sti", internal="keep")
    assert (2, 1) in model.dofs
    assert len({node for node in model.dofs.nodes if node > 20}) == 2  # the repeats of nodes 2 and 5, whole nodes
    assert model.nodes is None
    assert model.source["internal"].startswith("15 rows")
    np.testing.assert_allclose(normal_modes(model, n_modes=2).frequency_hz, frequencies("panel"), rtol=DIGITS)
    with pytest.raises(InputError, match="'error' or 'keep'"):
        read_model(FILES / "panel.sti", internal="drop")


def test_without_the_deck_rows_keep_their_numbers(tmp_path: Path) -> None:
    for ending in (".sti", ".mas", ".dof"):
        shutil.copyfile(FILES / f"rigid{ending}", tmp_path / f"rigid{ending}")
    alone = read_model(tmp_path / "rigid.sti")
    assert (102, 1) in alone.dofs
    assert alone.nodes is None
    beside = read_model(tmp_path / "rigid.sti", geometry=FILES / "rigid.inp")
    assert (101, 4) in beside.dofs
