"""One small model in every solver's text layout; each reader gives it back."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from flexplant.errors import ReadError
from flexplant.io import read_component, read_model
from flexplant.io.registry import recognise
from flexplant.model.component import FiniteElementModel
from flexplant.model.geometry import Nodes

RNG = np.random.default_rng(11)
IDS = [4, 7, 19, 20]
NODES = Nodes(ids=IDS, positions=RNG.standard_normal((4, 3)))
PAIRS = [(node, d) for node in IDS for d in (1, 2, 3)]


def model(n: int = 12) -> FiniteElementModel:
    half = np.triu(RNG.standard_normal((n, n)) * (RNG.random((n, n)) < 0.4))
    stiffness = half + half.T + 8 * np.eye(n)
    return FiniteElementModel(name="m", mass=np.diag(RNG.random(n) + 1), stiffness=stiffness, dofs=PAIRS, nodes=NODES)


def triplets(matrix: np.ndarray, keep: str) -> list[tuple[int, int, float]]:
    part = {"lower": np.tril, "upper": np.triu, "both": np.asarray}[keep](matrix)
    return [(int(i), int(j), float(part[i, j])) for i, j in np.argwhere(part)]


def deck(path: Path) -> None:
    rows = "\n".join(f"{n}, {x!r}, {y!r}, {z!r}" for n, (x, y, z) in zip(IDS, NODES.positions.tolist(), strict=True))
    path.write_text(f"*Heading\n** a comment\n*Node, nset=all\n{rows}\n*Element, type=C3D8\n1, 4, 7\n")


def abaqus(folder: Path, m: FiniteElementModel) -> Path:
    deck(folder / "job.inp")
    for kind, matrix in (("STIF1", m.stiffness), ("MASS1", m.mass)):
        (folder / f"job_{kind}.mtx").write_text("".join(f"{i + 1} {j + 1} {v:.17e}\n" for i, j, v in triplets(matrix, "both")))
    return folder / "job_STIF1.mtx"


def abaqus_labels(folder: Path, m: FiniteElementModel) -> Path:
    for kind, matrix in (("STIF1", m.stiffness), ("MASS1", m.mass)):
        lines = [f"{PAIRS[i][0]},{PAIRS[i][1]}, {PAIRS[j][0]},{PAIRS[j][1]}, {v:.17e}" for i, j, v in triplets(matrix, "lower")]
        (folder / f"lab_{kind}.mtx").write_text("** Abaqus\n" + "\n".join(lines) + "\n")
    return folder / "lab_STIF1.mtx"


def calculix(folder: Path, m: FiniteElementModel) -> Path:
    for ending, matrix in ((".sti", m.stiffness), (".mas", m.mass)):
        (folder / f"ccx{ending}").write_text("".join(f"{i + 1} {j + 1} {v:.17e}\n" for i, j, v in triplets(matrix, "upper")))
    (folder / "ccx.dof").write_text("".join(f"{n}.{d}\n" for n, d in PAIRS))
    deck(folder / "ccx.inp")
    return folder / "ccx.sti"


def table(path: Path, pairs: list[tuple[int, int]] = PAIRS) -> None:
    path.write_text("node,direction,x,y,z\n" + "".join(f"{n},{d},{','.join(map(repr, _at(n)))}\n" for n, d in pairs))


def _at(node: int) -> list[float]:
    return NODES.position(node).tolist() if node in IDS else [0.0, 0.0, 0.0]


def market(folder: Path, m: FiniteElementModel) -> Path:
    scipy.io.mmwrite(folder / "K_part.mtx", sp.coo_matrix(m.stiffness), symmetry="symmetric", precision=17)
    scipy.io.mmwrite(folder / "M_part.mtx", m.mass, precision=17)
    table(folder / "K_part.csv")
    return folder / "K_part.mtx"


def sierra(folder: Path, m: FiniteElementModel) -> Path:
    for name, matrix in (("Kaa", m.stiffness), ("Maa", m.mass)):
        rows = "\n".join(f"  {i + 1} {j + 1} {v:.17e}" for i, j, v in triplets(matrix, "upper"))
        (folder / f"{name}.m").write_text(f"function {name} = {name}()\ntmp = [\n{rows}\n];\n{name} = spconvert(tmp);\n")
    table(folder / "dofs.csv")
    return folder / "Kaa.m"


LAYOUTS: dict[str, Callable[[Path, FiniteElementModel], Path]] = {
    "abaqus_matrices": abaqus, "abaqus labels": abaqus_labels, "calculix": calculix, "matrix_market": market,
    "sierra_text": sierra,
}  # fmt: skip


@pytest.mark.parametrize("layout", list(LAYOUTS))
def test_each_layout_gives_the_model_back(tmp_path: Path, layout: str) -> None:
    m = model()
    path = LAYOUTS[layout](tmp_path, m)
    read = read_model(path)
    assert read.dofs.pairs == PAIRS
    np.testing.assert_array_equal(read.stiffness.toarray(), m.stiffness)
    mass = read.mass.toarray() if sp.issparse(read.mass) else read.mass
    np.testing.assert_array_equal(mass, m.mass)
    if read.nodes is not None:
        np.testing.assert_array_equal(read.nodes.positions, NODES.positions)
    assert read.source["path"] == str(path)
    assert len(read.source["files"]) >= 1
    assert recognise(path, what="read_model")[1].name == layout.replace("abaqus labels", "abaqus_matrices")


def test_ansys_hbmat_mapping_and_decimal_commas(tmp_path: Path) -> None:
    """Rows in the solver's order, named by "equation node UX" lines; coordinates with commas."""
    m = model()
    order = RNG.permutation(12)
    for name, matrix in (("Stiffness", m.stiffness), ("Mass", m.mass)):
        half = triplets(matrix[np.ix_(order, order)], "lower")
        body = "".join(f"{i + 1} {j + 1} {v:.17e}\n" for i, j, v in half)
        head = f"%%MatrixMarket matrix coordinate real symmetric\n% Creator: ANSYS Inc\n12 12 {len(half)}\n"
        (tmp_path / f"a{name}MatrixSparse.txt").write_text(head + body)
    names = ["UX", "UY", "UZ"]
    lines = [f"{i + 1:8d} {PAIRS[k][0]:8d}  {names[PAIRS[k][1] - 1]}" for i, k in enumerate(order)]
    (tmp_path / "aMatrixDofMappingVector.txt").write_text("Matrix Eqn   Node  DOF\n" + "\n".join(lines))
    rows = [f"{n}\t" + "\t".join(repr(v).replace(".", ",") for v in _at(n)) for n in IDS]
    (tmp_path / "aNodalCoordinates.txt").write_text("Node\tX (m)\tY (m)\tZ (m)\n" + "\n".join(rows) + "\n")
    read = read_model(tmp_path / "aStiffnessMatrixSparse.txt")
    at = read.dofs.rows(PAIRS)
    np.testing.assert_array_equal(read.stiffness.toarray()[np.ix_(at, at)], m.stiffness)
    np.testing.assert_array_equal(read.nodes.positions, NODES.positions)


def test_the_four_files_of_the_ansys_lines_in_the_documentation(tmp_path: Path) -> None:
    """As *EXPORT,,MMF writes matrices and the integer vector BACK, and *VWRITE with (F9.0,3E24.15) the coordinates."""
    page = (Path(__file__).parents[2] / "docs" / "formats.md").read_text(encoding="utf-8")
    named = re.findall(r"^    \*(?:EXPORT,\w+,MMF|CFOPEN),(\w+)[.,]txt$", page, flags=re.MULTILINE)
    assert len(named) == 4
    assert set(re.findall(r"^    \*EXPORT,(\w+),", page, flags=re.MULTILINE)) <= set(
        re.findall(r"^    \*(?:SMAT|VEC),(\w+),[DI],IMPORT,FULL,", page, flags=re.MULTILINE)
    )
    m, back = model(), RNG.permutation(IDS)
    order = [PAIRS.index((node, d)) for node in back.tolist() for d in (1, 2, 3)]
    head = "%%MatrixMarket matrix {} {} \n% Creator: ANSYS Inc\n% \n"
    for name, matrix in zip(named[:2], (m.stiffness, m.mass), strict=True):
        half = triplets(matrix[np.ix_(order, order)], "lower")
        body = "".join(f"{i + 1} {j + 1} {v:.17E}\n" for i, j, v in half)
        (tmp_path / f"{name}.txt").write_text(head.format("coordinate", "real symmetric") + f"12 12 {len(half)}\n{body}")
    vector = "".join(f"{node}\n" for node in back)
    (tmp_path / f"{named[2]}.txt").write_text(head.format("array", "integer general") + f"4 1\n{vector}")
    numbers = ["".join(f"{v:24.14E}" for v in _at(node)) for node in IDS]
    (tmp_path / f"{named[3]}.txt").write_text("".join(f"{node:8d}.{xyz}\n" for node, xyz in zip(IDS, numbers, strict=True)))
    read = read_model(tmp_path / f"{named[0]}.txt")
    at = read.dofs.rows(PAIRS)
    np.testing.assert_array_equal(read.stiffness.toarray()[np.ix_(at, at)], m.stiffness)
    np.testing.assert_allclose(read.nodes.positions, NODES.positions, rtol=1e-14)


def test_sierra_reductions_in_either_order(tmp_path: Path) -> None:
    """cbmap of the boundary alone: modal rows first; a full cbmap may have them anywhere."""
    m = model()
    for name, cbmap, boundary in (
        ("short", np.array(PAIRS[:9]), slice(3, 12)),
        ("full", np.array([*PAIRS[:5], (0, 1), (0, 2), *PAIRS[5:10]]), np.r_[0:5, 7:12]),
    ):
        path = tmp_path / f"{name}.nc4"
        with scipy.io.netcdf_file(path, "w") as file:
            file.createDimension("n", 12)
            file.createDimension("two", 2)
            file.createDimension("rows", len(cbmap))
            for key, matrix in (("Kr", m.stiffness), ("Mr", m.mass)):
                file.createVariable(key, "d", ("n", "n"))[:] = matrix
            file.createVariable("cbmap", "i", ("rows", "two"))[:] = cbmap
        read = read_component(path)
        assert read.boundary.pairs == PAIRS[: len(read.boundary)]
        order = np.r_[np.arange(12)[boundary], np.setdiff1d(np.arange(12), np.arange(12)[boundary])]
        np.testing.assert_array_equal(read.stiffness, m.stiffness[np.ix_(order, order)])


def test_matrix_market_component_with_modal_rows(tmp_path: Path) -> None:
    m = model()
    path = market(tmp_path, m)
    table(tmp_path / "K_part.csv", [(101, 0), *PAIRS[:10], (102, 0)])
    read = read_component(path)
    assert (read.n_boundary, read.modal_ids.tolist()) == (10, [101, 102])
    order = [*range(1, 11), 0, 11]
    np.testing.assert_array_equal(read.stiffness.toarray(), m.stiffness[np.ix_(order, order)])
    with pytest.raises(ReadError, match=r"modal rows.*read_component"):
        read_model(path)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("K.mtx", "%%MatrixMarket matrix coordinate real symmetric\n99999999 99999999 1\n1 1 1.0\n", "claims shape"),
        ("K.mtx", "%%MatrixMarket matrix coordinate real symmetric\n3 3 9\n1 1 1.0\n", "claims 9 entries, 1 lines are left"),
        ("K.mtx", "%%MatrixMarket matrix coordinate complex general\n3 3 1\n1 1 1.0 0\n", "complex"),
        ("K.mtx", "%%MatrixMarket matrix coordinate real general\n3 3 1\n1 x 1.0\n", r"line 3.*is not 3 numbers"),
        ("K.mtx", "%%MatrixMarket matrix array real general\n3 3\n1.0\n", "has 1 numbers"),
    ],
)
def test_malformed_matrix_market_names_its_line(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    (tmp_path / "M.mtx").write_text(text)
    (tmp_path / "dofs.csv").write_text("1,1\n1,2\n1,3\n")
    with pytest.raises(ReadError, match=message):
        read_model(tmp_path / name)


def test_missing_partners_say_which_file_is_looked_for(tmp_path: Path) -> None:
    path = abaqus(tmp_path, model())
    (tmp_path / "job_MASS1.mtx").unlink()
    with pytest.raises(ReadError, match=r"job_MASS1\.mtx is not beside it; pass mass="):
        read_model(path)
    path = abaqus(tmp_path, model())
    (tmp_path / "job.inp").unlink()
    with pytest.raises(ReadError, match=r"pass geometry= .* or dofs_per_node="):
        read_model(path)
    assert read_model(path, dofs_per_node=3).dofs.pairs[3] == (2, 1)
