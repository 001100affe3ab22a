"""Components written for other programs: read back by pyYeti, Octave and ourselves."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexplant.errors import InputError, ReadError
from flexplant.io import read_component, write_component
from flexplant.io.write.nastran_text import real16
from flexplant.model.component import Component
from flexplant.model.geometry import Nodes
from flexplant.model.recovery import Recovery

RNG = np.random.default_rng(3)


def symmetric(n: int) -> np.ndarray:
    half = RNG.standard_normal((n, n)) * 10.0 ** RNG.integers(-6, 9, (n, n))
    return half + half.T


def turned() -> np.ndarray:
    q, _ = np.linalg.qr(RNG.standard_normal((3, 3)))
    return q * np.linalg.det(q)


def component(*, damping: bool = True) -> Component:
    """Two nodes, one with its own axes and one with three DOF only, and four modes."""
    nodes = Nodes(ids=[12, 31], positions=RNG.standard_normal((2, 3)) * 1e3, frames=np.array([np.eye(3), turned()]))
    return Component(
        name="panel",
        mass=symmetric(13),
        stiffness=symmetric(13),
        damping=symmetric(13) if damping else None,
        boundary=[(12, "123456"), (31, "123")],
        nodes=nodes,
        modal_ids=[1001, 1002, 1003, 1004],
        recovery={"mug1": Recovery(name="mug1", labels=["a", "b"], displacement=RNG.standard_normal((2, 13)))},
    )


@pytest.mark.parametrize("letter", ["", "D"])
@pytest.mark.parametrize("value", [1.0, -1.0 / 3, 1e-300, -2.5e300, 123456789.123456789, -1e-5, 0.0, 4.9e-324])
def test_reals_in_sixteen_columns(value: float, letter: str) -> None:
    text = real16(value, letter)
    assert len(text) <= 16
    assert re.fullmatch(r"-?\d\.\d+" + (r"D[+-]\d+" if letter else r"([+-]\d+)?"), text)
    number = float(re.sub(r"(?<=\d)D?([+-]\d+)$", r"e\1", text))
    assert number == pytest.approx(value, rel=2e-9, abs=0)


def test_dmig_keeps_to_the_rules_of_bulk_data(tmp_path: Path) -> None:
    """Large fields: name in 8 columns, four fields of 16, D exponents; header of form 6, type 2; symmetric part once, sorted."""
    given = replace(component(), recovery={})
    lines = write_component(given, tmp_path / "panel.pch").read_text().splitlines()
    assert max(map(len, lines)) <= 72
    headers = [line for line in lines if line.startswith("DMIG ")]
    assert [[line[i : i + 8].strip() for i in range(0, 56, 8)] for line in headers] == [
        ["DMIG", name, "0", "6", "2", "0", ""] for name in ("KAAX", "MAAX", "BAAX")
    ]
    seen: set[tuple[str, ...]] = set()
    column: tuple[str, ...] = ()
    for line in lines[lines.index(headers[0]) :]:
        fields = tuple(line[i : i + 16].strip() for i in range(8, 72, 16))
        if line.startswith("DMIG*"):
            column = fields[:3]
        elif line.startswith("*"):
            assert (line[:8], fields[0].isdigit(), fields[1].isdigit()) == ("*       ", True, True)
            assert re.fullmatch(r"-?\d\.\d+D[+-]\d+", fields[2])
            name, *below = column
            assert (name, *fields[:2], *below) not in seen - {(name, *below, *below)}  # no term a second time across the diagonal
            seen.add((name, *below, *fields[:2]))
    assert len(seen) == 3 * 13 * 14 // 2


def test_op4_superelement_comes_back_bit_equal(tmp_path: Path) -> None:
    given = component()
    back = read_component(write_component(given, tmp_path / "panel.op4", superelement=7))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["panel.asm", "panel.op4", "panel.pch"]
    assert back.dofs.pairs == given.dofs.pairs
    for kind in ("mass", "stiffness", "damping"):
        np.testing.assert_array_equal(getattr(back, kind), getattr(given, kind))
    np.testing.assert_array_equal(back.recovery["mug1"].displacement, given.recovery["mug1"].displacement)
    np.testing.assert_allclose(back.nodes.positions, given.nodes.positions, rtol=1e-11)
    np.testing.assert_allclose(back.nodes.frames, given.nodes.frames, atol=1e-11)


def test_pyyeti_reads_the_superelement(tmp_path: Path) -> None:
    pytest.importorskip("pyyeti")
    given = component()
    write_component(given, tmp_path / "panel.op4")
    options = np.get_printoptions()
    from pyyeti.nastran import bulk, op4

    matrices = op4.load(str(tmp_path / "panel.op4"))
    extrn = bulk.rdextrn(str(tmp_path / "panel.pch"))
    np.set_printoptions(**options)
    np.testing.assert_array_equal(matrices["kxx"][0], given.stiffness)
    np.testing.assert_array_equal(matrices["mxx"][0], given.mass)
    assert [tuple(row) for row in extrn.tolist()] == given.dofs.pairs


def test_dmig_for_other_solvers(tmp_path: Path) -> None:
    pytest.importorskip("pyyeti")
    given = component()
    path = write_component(given, tmp_path / "panel.pch", suffix="7")
    back = read_component(path)
    assert (back.source["format"], back.dofs.pairs) == ("nastran_dmig", given.dofs.pairs)
    options = np.get_printoptions()
    from pyyeti.nastran import bulk

    theirs = bulk.rddmig(str(path))
    np.set_printoptions(**options)
    for kind, name in (("stiffness", "k7"), ("mass", "m7"), ("damping", "b7")):
        matrix = getattr(given, kind)
        np.testing.assert_allclose(getattr(back, kind), matrix, rtol=1e-9)
        np.testing.assert_allclose(theirs[name].to_numpy(), matrix, rtol=1e-9)


def test_a_zero_row_survives_dmig(tmp_path: Path) -> None:
    given = component(damping=False)
    mass = given.mass.copy()
    mass[3:6], mass[:, 3:6] = 0.0, 0.0
    massless = Component(name="p", mass=mass, stiffness=given.stiffness, boundary=given.boundary, nodes=given.nodes)
    back = read_component(write_component(massless, tmp_path / "p.pch"))
    assert back.n == 13
    np.testing.assert_array_equal(back.mass[3:6], 0.0)


def test_extptfm_text_comes_back_bit_equal(tmp_path: Path) -> None:
    n = 9
    given = Component(
        name="jacket", mass=symmetric(n), stiffness=symmetric(n), damping=symmetric(n), boundary=[(1, "123456")],
        nodes=Nodes(ids=[1], positions=np.zeros((1, 3))),
    )  # fmt: skip
    path = write_component(given, tmp_path / "jacket.extptfm")
    back = read_component(path)
    assert (back.source["format"], back.source["units"], back.n_modal) == ("extptfm", "SI", 3)
    for kind in ("mass", "stiffness", "damping"):
        np.testing.assert_array_equal(getattr(back, kind), getattr(given, kind))
    lines = path.read_text().splitlines()
    assert lines[2] == "!Dimension: 9"  # OpenFAST takes what follows column 11
    assert lines[5:8] == ["", "!Mass Matrix", "!Dimension: 9"]  # as in OpenFAST's own example
    assert lines[-3:] == ["!Dimension: 1 time column - 9 force columns", "0.0" + " 0." * 9, "3600.0" + " 0." * 9]
    with pytest.raises(InputError, match="one boundary node with DOF 1 to 6"):
        write_component(replace(component(), recovery={}), tmp_path / "panel.extptfm")
    (tmp_path / "cut.extptfm").write_text("\n".join(lines[:15]))
    with pytest.raises(ReadError, match="has 7 of 9 rows"):
        read_component(tmp_path / "cut.extptfm")


@pytest.mark.slow
def test_extptfm_lines_of_loads_stay_within_what_openfast_reads(tmp_path: Path) -> None:
    """OpenFAST reads them into 4096 characters, and takes a line that begins with a title for that title."""

    def jacket(n: int) -> Component:
        return Component(name="Dimension", mass=np.eye(n), stiffness=np.eye(n), boundary=[(1, "123456")])

    lines = write_component(jacket(1350), tmp_path / "big.extptfm").read_text().splitlines()
    assert max(map(len, lines[-2:])) < 4096
    assert next(line for line in lines if line.upper().startswith("!DIMENSION")) == "!Dimension: 1350"
    with pytest.raises(InputError, match="at most 1350"):
        write_component(jacket(1351), tmp_path / "bigger.extptfm")


def test_simscape_matrices_stand_along_the_common_frame(tmp_path: Path) -> None:
    """The rigid-body energy of the turned matrices is that of the component; Octave reads every digit."""
    frames = np.array([np.eye(3), turned()])
    nodes = Nodes(ids=[1, 2], positions=RNG.standard_normal((2, 3)), frames=frames)
    given = Component(
        name="arm", mass=symmetric(14), stiffness=symmetric(14), boundary=[(1, "123456"), (2, "123456")], nodes=nodes
    )
    path = write_component(given, tmp_path / "arm.m")
    if shutil.which("octave") is None:
        pytest.skip("octave is not installed")
    command = "arm; x = [rom.K; rom.M]; printf('%.17g\\n', x); printf('%.17g\\n', rom.Origins)"
    done = subprocess.run(
        ["octave", "--no-gui", "-q", "--eval", command], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    numbers = np.array(done.stdout.split(), dtype=float)
    both, origins = numbers[: 28 * 14].reshape(28, 14, order="F"), numbers[28 * 14 :].reshape(2, 3, order="F")
    np.testing.assert_array_equal(origins, nodes.positions)
    turn = np.eye(14)
    turn[6:9, 6:9] = turn[9:12, 9:12] = frames[1]
    expected = turn.T @ given.stiffness @ turn
    np.testing.assert_allclose(both[:14], expected, atol=1e-12 * abs(expected).max())
    assert path.read_text().count("rom.") == 4


def test_what_cannot_be_written_says_why(tmp_path: Path) -> None:
    bare = Component(name="bare", mass=np.eye(1), stiffness=np.eye(1), boundary=[(1, 1)])
    for ending in ("op4", "pch", "m"):
        with pytest.raises(InputError, match="no node positions"):
            write_component(bare, tmp_path / f"bare.{ending}")
    with pytest.raises(InputError, match=r"has no option 'suffx'.*suffix"):
        write_component(component(), tmp_path / "p.pch", suffx="1")
    assert list(tmp_path.iterdir()) == []
