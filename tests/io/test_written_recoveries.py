"""Recovery rows through Nastran's files: every name, label and unit, and DTI tables where other programs can use them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from flexplant.cli import app
from flexplant.errors import InputError, ReadError
from flexplant.io import convert, read_component, write_component
from flexplant.model.component import Component
from flexplant.model.geometry import Nodes
from flexplant.model.recovery import Recovery

RNG = np.random.default_rng(12)
GRID = [f"{node}.{d}" for node in (45, 7) for d in range(1, 7)]
BARS = [f"CBAR.{e}.{i}" for e in (3, 1) for i in range(1, 9)]


def rows(n: int) -> np.ndarray:
    found = RNG.standard_normal((n, 9))
    found[n // 2] = 0.0
    return found


def component() -> Component:
    half = RNG.standard_normal((9, 9))
    recovery = [
        Recovery("displacement", ["20.1", "20.3"], displacement=rows(2), units="m"),
        Recovery("mug1", GRID, displacement=rows(12)),
        Recovery("mef1", BARS, displacement=rows(16)),
        Recovery("Mug2", ['say "so"', "Säule"], displacement=rows(2)),
        Recovery("mxx", ["1", "2"], displacement=rows(2), units="N"),
        Recovery("m_long_name_of_a_set", GRID, displacement=rows(12)),
        Recovery("mrec2", ["a"], displacement=rows(1)),
    ]
    nodes = Nodes(ids=[5], positions=np.zeros((1, 3)))
    return Component(name="part", mass=half @ half.T, stiffness=half.T @ half, boundary=[(5, "123456")], nodes=nodes,
                     modal_ids=[101, 102, 103], recovery=recovery)  # fmt: skip


@pytest.mark.parametrize(("ending", "rtol"), [("op4", 0.0), ("pch", 1e-9)])
def test_every_recovery_comes_back(ending: str, rtol: float, tmp_path: Path) -> None:
    given = component()
    back = read_component(write_component(given, tmp_path / f"x.{ending}"))
    assert list(back.recovery) == list(given.recovery)
    assert back.source["unused"] == []
    for name, ours in given.recovery.items():
        theirs = back.recovery[name]
        np.testing.assert_allclose(theirs.displacement, ours.displacement, rtol=rtol, atol=0)
        assert (theirs.labels, theirs.units) == (ours.labels, ours.units)


@pytest.mark.parametrize("ending", ["op4", "pch"])
def test_tables_label_the_rows_of_nastrans_own_sets(ending: str, tmp_path: Path) -> None:
    """Without our comments, as another program sees the files: mug1 and mef1 by their DTI tables."""
    given = component()
    path = write_component(given, tmp_path / f"x.{ending}")
    pch = tmp_path / "x.pch"
    pch.write_text("".join(line for line in pch.read_text().splitlines(keepends=True) if not line.startswith("$ flexplant")))
    back = read_component(path)
    assert set(back.recovery) == {"mug1", "mef1"}
    for name, found in back.recovery.items():
        assert found.labels == given.recovery[name].labels


def test_pyyeti_reads_the_tables(tmp_path: Path) -> None:
    pytest.importorskip("pyyeti")
    options = np.get_printoptions()
    from pyyeti.nastran import bulk

    np.set_printoptions(**options)
    write_component(component(), tmp_path / "x.op4")
    table = bulk.rddtipch(str(tmp_path / "x.pch"), "TUG1")
    np.set_printoptions(**options)
    assert table[:, 0].tolist() == [45] * 6 + [7] * 6
    assert table[:, 1].tolist() == [1, 2, 3, 4, 5, 6] * 2


def test_labels_that_do_not_fit_the_rows_are_refused(tmp_path: Path) -> None:
    path, pch = write_component(component(), tmp_path / "x.op4"), tmp_path / "x.pch"
    text = pch.read_text()
    for old, new, said in (
        ('$ flexplant row "20.3"\n', "", "2 rows, but 1 labels"),
        ('$ flexplant recovery "displacement"\n', "", "without its recovery"),
        ('row "20.3"', 'row "20\\q"', "cannot be read"),
    ):
        pch.write_text(text.replace(old, new))
        with pytest.raises(ReadError, match=said):
            read_component(path)


@pytest.mark.parametrize("ending", ["op4", "pch", "extptfm", "m"])
def test_what_a_format_cannot_hold_is_refused_and_can_be_dropped(ending: str, tmp_path: Path) -> None:
    """Rates, and where there is no place at all every recovery: as interior DOF, by name, with the way out."""
    part = replace(component(), recovery=[Recovery("v", ["a"], velocity=rows(1))], boundary=[(5, d) for d in range(1, 7)])
    target = tmp_path / f"x.{ending}"
    with pytest.raises(InputError, match=r"does not hold the (velocity|recovery).* v?.*--drop recovery"):
        write_component(part, target)
    source = write_component(part, tmp_path / "x.npz")
    with pytest.raises(InputError, match="drop takes a list of recovery, interior, structural_damping, got 'all'"):
        convert(source, target, drop=["all"])
    done = CliRunner().invoke(app, ["convert", str(source), str(target), "--drop", "recovery"])
    assert (done.exit_code, target.exists()) == (0, True), done.output
