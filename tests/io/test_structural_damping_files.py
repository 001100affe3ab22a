"""K4 of Nastran's files becomes D of K + i D: sums of GE K_e, so D = g K of one material, and the response is the complex one."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from nx_files import TRUSS
from op2_files import write_op2

import flexplant as fp
from flexplant.errors import FlexplantError, InputError, ReadError
from flexplant.io import read_component
from flexplant.io.parse.op4 import read_op4_sequence
from flexplant.model.arrays import dense

K = np.array([[5.0, -2.0, 0.0], [-2.0, 6.0, -1.0], [0.0, -1.0, 4.0]]) * 1e3
M = np.diag([2.0, 3.0, 1.0])
LOSS = 0.04


def entries(name: str, matrix: np.ndarray, form: int = 6) -> str:
    """DMIG entries of DOF 11-1, 11-2 and the scalar point 901."""
    dofs = [(11, 1), (11, 2), (901, 0)]
    text = f"DMIG,{name},0,{form},2,0\n"
    for j, (node, direction) in enumerate(dofs):
        for i, (row, component) in enumerate(dofs):
            if matrix[i, j] and (i >= j or form == 1):
                text += f"DMIG,{name},{node},{direction},,{row},{component},{matrix[i, j]!r}\n"
    return text.replace("np.float64(", "").replace(")", "")


def deck(folder: Path, *parts: str, case: str = "") -> Path:
    path = folder / "part.pch"
    body = "GRID,11,,0.,0.,0.\nSPOINT,901\nASET1,12,11\nQSET1,0,901\n" + "".join(parts)
    path.write_text(f"{case}BEGIN BULK\n{body}" if case else body)
    return path


def extseout(folder: Path, **matrices: np.ndarray) -> Path:
    (folder / "part.pch").write_text("EXTRN,11,12\nEXTRN,901,0\nSPOINT,901\nGRID,11,,0.,0.,0.\n")
    return write_op2(folder / "part.op2", matrices)


def written(folder: Path, kind: str, loss: np.ndarray) -> Path:
    if kind == "dmig":
        return deck(folder, entries("K10", K), entries("M10", M), entries("K410", loss))
    return extseout(folder, **{"KAA": K, "MAA": M, "K4AA": loss} if kind == "kaa" else {"KXX": K, "MXX": M, "K4XX": loss})


@pytest.mark.parametrize("kind", ["dmig", "kaa", "kxx"])
def test_the_response_is_that_of_the_complex_stiffness(tmp_path: Path, kind: str) -> None:
    """The plant of what was read, and three complex equations solved by hand."""
    component = read_component(written(tmp_path, kind, LOSS * K))
    np.testing.assert_allclose(component.structural_damping, LOSS * K, rtol=1e-15)
    hz = np.array([2.0, 6.0, 11.0])
    names = {"inputs": [f"{component.name}.11.1"], "outputs": [f"{component.name}.11.2"]}
    ours = fp.structural_frequency_response(fp.couple([component]), frequency_hz=hz, **names)
    w2 = (2 * np.pi * hz) ** 2
    theirs = [np.linalg.solve((1 + 1j * LOSS) * K - w * M, np.eye(3)[0])[1] for w in w2]
    np.testing.assert_allclose(np.asarray(ours).ravel(), theirs, rtol=1e-10)


@pytest.mark.parametrize("kind", ["dmig", "kaa", "kxx"])
def test_it_is_refused_or_left_out_only_where_asked(tmp_path: Path, kind: str) -> None:
    path = written(tmp_path, kind, LOSS * K)
    with pytest.raises(ReadError, match=r"has structural damping K4.*structural='read'"):
        read_component(path, structural="error")
    left = read_component(path, structural="ignore")
    assert left.structural_damping is None
    assert any(text.startswith("K4") for text in left.source["unused"])
    with pytest.raises(InputError, match="structural='sometimes'"):
        read_component(path, structural="sometimes")
    assert not read_component(path).source["unused"]


def test_plants_with_real_damping_refuse_what_was_read(tmp_path: Path) -> None:
    """It is not dropped on the way either."""
    component = read_component(written(tmp_path, "kaa", LOSS * K))
    names = {"inputs": [f"{component.name}.11.1"], "outputs": [f"{component.name}.11.2"]}
    with pytest.raises(FlexplantError, match="structural damping"):
        fp.descriptor(fp.couple([component]), **names)


@pytest.mark.parametrize(
    ("loss", "message"),
    [
        (np.triu(K), "structural damping matrix is not symmetric"),
        (np.full((3, 3), np.nan), "not finite"),
        (np.eye(2), r"K4AA has shape \(2, 2\), but the files beside it list 3 DOF"),
    ],
)
def test_a_k4_that_does_not_fit_is_named(tmp_path: Path, loss: np.ndarray, message: str) -> None:
    with pytest.raises(FlexplantError, match=message):
        read_component(written(tmp_path, "kaa", loss))


def test_a_k4_in_entries_that_does_not_fit_is_named(tmp_path: Path) -> None:
    stray = "DMIG,K410,0,6,2,0\nDMIG,K410,77,1,,77,1,3.0\n"
    with pytest.raises(ReadError, match="K410 has the DOF 77-1, which is not among the 3"):
        read_component(deck(tmp_path, entries("K10", K), entries("M10", M), stray))
    with pytest.raises(FlexplantError, match="structural damping matrix is not symmetric"):
        read_component(deck(tmp_path, entries("K10", K), entries("M10", M), entries("K410", np.tril(K), form=1)))


def test_what_case_control_selects_is_structural_damping(tmp_path: Path) -> None:
    parts = entries("K10", K), entries("M10", M), entries("LOSSY", LOSS * K)
    np.testing.assert_array_equal(read_component(deck(tmp_path, *parts)).source["unused"], ["LOSSY"])
    chosen = read_component(deck(tmp_path, *parts, case="CEND\n  k42gg = lossy\n"))
    np.testing.assert_allclose(chosen.structural_damping, LOSS * K, rtol=1e-15)
    assert chosen.source["unused"] == []
    missing = deck(tmp_path, *parts, case="K42GG = 2.0*LOSSY\n")
    with pytest.raises(ReadError, match=r"K42GG = 2.0\*LOSSY, but has the DMIG matrices K10, M10, LOSSY"):
        read_component(missing)
    assert read_component(missing, structural="ignore").structural_damping is None
    two = deck(tmp_path, *parts, entries("K410", K), case="K42GG = LOSSY\n")
    with pytest.raises(ReadError, match="has K410 too"):
        read_component(two)


def test_nas2cam_has_it_in_the_op4(tmp_path: Path) -> None:
    """The delivered run with K4AA written after each superelement's matrices."""
    peer = pytest.importorskip("pyyeti.nastran.op4")
    shutil.copyfile(TRUSS / "nas2cam.op2", tmp_path / "nas2cam.op2")
    names, matrices = [], []
    for name, matrix in read_op4_sequence(TRUSS / "nas2cam.op4"):
        names.append(name.lower())
        matrices.append(dense(matrix))
        if name == "KAA":
            names.append("k4aa")
            matrices.append(LOSS * dense(matrix))
    peer.write(str(tmp_path / "nas2cam.op4"), names, matrices)
    read = read_component(tmp_path / "nas2cam.op2", superelement=101)
    np.testing.assert_allclose(dense(read.structural_damping), LOSS * dense(read.stiffness), rtol=1e-14)
    assert read_component(tmp_path / "nas2cam.op2", superelement=101, structural="ignore").structural_damping is None
    with pytest.raises(ReadError, match="K4AA"):
        read_component(tmp_path / "nas2cam.op2", superelement=101, structural="error")
