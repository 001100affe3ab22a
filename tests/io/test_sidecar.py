"""Plain matrices with a sidecar: what is accepted, and what each mistake is answered with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flexplant.errors import ReadError
from flexplant.io import read_component, read_display_mesh, read_model
from flexplant.io.parse.npz_matrices import pack_matrix
from flexplant.model.geometry import cylindrical_frame

MASS = np.array([[4.0, 0.0, 0.5], [0.0, 4.0, 0.1], [0.5, 0.1, 1.0]])
STIFFNESS = np.diag([0.0, 0.0, 400.0])
GOOD = """\
name: plate
matrices: {mass: M, stiffness: K}
boundary:
  - [7, "12"]
modal: 1
nodes:
  - [7, 3.0, 4.0, 5.0]
units: SI
source: by hand
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    np.savez(tmp_path / "plate.npz", M=MASS, K=STIFFNESS)
    (tmp_path / "plate.yaml").write_text(GOOD)
    return tmp_path


def with_text(folder: Path, text: str) -> Path:
    (folder / "plate.yaml").write_text(text)
    return folder / "plate.npz"


def test_good(folder: Path) -> None:
    component = read_component(folder / "plate.npz")
    assert component.name == "plate"
    assert component.boundary.pairs == [(7, 1), (7, 2)]
    assert np.array_equal(component.mass, MASS)
    assert component.fixed_interface_hz == pytest.approx(20 / (2 * np.pi), rel=1e-15)
    assert component.source["description"] == "by hand"
    assert component.source["units"] == "SI"
    assert read_display_mesh(folder / "plate.npz") is None


def test_matlab_and_sparse_are_the_same_component(folder: Path) -> None:
    dense = read_component(folder / "plate.npz")
    scipy.io.savemat(folder / "m.mat", {"M": sp.csc_matrix(MASS), "K": STIFFNESS}, do_compression=True)
    np.savez(folder / "s.npz", **pack_matrix("M", sp.csr_array(MASS)), K=STIFFNESS)
    for name in ("m.mat", "s.npz"):
        format_name = {".mat": "mat_matrices", ".npz": "npz_matrices"}[name[-4:]]
        other = read_component(folder / name, sidecar=folder / "plate.yaml", format=format_name)
        assert sp.issparse(other.mass)
        assert np.array_equal(other.mass.toarray(), dense.mass)
        assert np.array_equal(other.stiffness, dense.stiffness)


def test_model_with_dofs(folder: Path) -> None:
    text = (
        'matrices: {mass: M, stiffness: K}\ndofs: [[7, "12"], [8, 3]]\nunits: mm-tonne-s\nnodes: [[7, 1, 2, 3], [8, 0, 0, 0]]\n'
    )
    model = read_model(with_text(folder, text))
    assert model.dofs.pairs == [(7, 1), (7, 2), (8, 3)]
    assert np.allclose(model.mass, MASS * 1000)
    assert np.allclose(model.nodes.position(7), [1e-3, 2e-3, 3e-3])


def test_frames_by_matrix_and_by_system(folder: Path) -> None:
    system = "systems: {rim: {type: cylindrical, origin: [0, 0, 1], axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}}\n"
    component = read_component(with_text(folder, GOOD + "frames: {7: rim}\n" + system))
    assert np.allclose(component.nodes.frame(7), [[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]], atol=1e-15)
    assert np.allclose(component.nodes.frame(7), cylindrical_frame([3, 4, 5], [0, 0, 1], np.eye(3)))
    component = read_component(with_text(folder, GOOD + "frames: {7: [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]}\n"))
    assert np.array_equal(component.nodes.frame(7), [[0, 1, 0], [-1, 0, 0], [0, 0, 1]])


def test_recovery_and_display(folder: Path) -> None:
    np.savez(folder / "plate.npz", M=MASS, K=STIFFNESS, C=np.arange(6.0).reshape(2, 3))
    shapes = np.arange(18.0).reshape(6, 3)
    np.savez(folder / "d.npz", nodes=[5, 9], positions=np.ones((2, 3)), matrix=shapes, quads=[[0, 1, 1, 1]], lines=[[0, 1]])
    text = (
        GOOD.replace("units: SI", "units: mm-kg-s") + "display: d.npz\nrecovery: {tip: {matrix: C, labels: [x, y.2], units: m}}\n"
    )
    component = read_component(with_text(folder, text))
    assert component.recovery["tip"].labels == ("x", "y.2")
    display = component.recovery["display"]
    assert display.labels == ("5.1", "5.2", "5.3", "9.1", "9.2", "9.3")
    # u[mm] = D p[mm, sqrt(kg) mm]; in SI translations of rows and columns scale alike
    assert np.allclose(display.displacement, shapes, rtol=1e-14)
    mesh = read_display_mesh(folder / "plate.npz")
    assert np.allclose(mesh.positions, 1e-3)
    assert mesh.quads.tolist() == [[0, 1, 1, 1]]


WRONG = {
    "unknown key": (GOOD.replace("boundary:", "boundry:"), r"line 3: unknown key 'boundry'\. Did you mean 'boundary'"),
    "unknown kind": (
        GOOD.replace("stiffness: K", "stifness: K"),
        r"line 2: unknown key 'stifness' in matrices\. Did you mean 'stiffness'",
    ),
    "no stiffness": (GOOD.replace(", stiffness: K", ""), "line 2: matrices must name stiffness"),
    "no boundary": ("matrices: {mass: M, stiffness: K}\n", "boundary is missing"),
    "unknown matrix": (GOOD.replace("mass: M", "mass: MM"), r"line 2: matrices.mass: plate.npz has no matrix 'MM'"),
    "boundary too long": (
        GOOD.replace('"12"', '"123456"'),
        "line 3: boundary lists 6 DOF, but the matrices of plate.npz have 3 rows",
    ),
    "modal count": (GOOD.replace("modal: 1", "modal: 4"), "line 5: 3 rows less 2 boundary DOF leave 1 modal rows, not 4"),
    "twice": (GOOD.replace('[7, "12"]', '[7, "11"]'), "line 3: boundary: directions"),
    "direction": (GOOD.replace('[7, "12"]', '[7, "17"]'), "line 3: boundary: directions '17'"),
    "not pairs": (GOOD.replace('- [7, "12"]', "- 7"), "line 3: boundary must be a list"),
    "no position": (GOOD.replace("[7, 3.0", "[8, 3.0"), r"line 3: boundary: nodes \[7\] have no position"),
    "node row": (GOOD.replace("[7, 3.0, 4.0, 5.0]", "[7, 3.0]"), "line 6: nodes must be a list of"),
    "node id": (GOOD.replace("[7, 3.0, 4.0", "[7.5, 3.0, 4.0"), "line 6: nodes: 'float'"),
    "node text": (GOOD.replace("3.0", "here"), "line 6: nodes: could not convert"),
    "node not finite": (GOOD.replace("3.0", ".nan"), "line 6: nodes: .*not finite"),
    "units": (GOOD.replace("units: SI", "units: mm-kg"), r"line 8: units: unknown unit system 'mm-kg'\. Did you mean 'mm-kg-s'"),
    "units list": (GOOD.replace("units: SI", "units: [1]"), "line 8: units"),
    "name": (GOOD.replace("name: plate", "name: a plate"), "line 1: name: model name 'a plate'"),
    "no system": (
        GOOD + "frames: {7: rim}\nsystems: {rin: {type: rectangular}}\n",
        "line 10: frames: there is no system 'rim'. Did you mean 'rin'",
    ),
    "no frame node": (GOOD + "frames: {8: rim}\n", "line 10: frames: node 8 is not in nodes"),
    "left-handed": (GOOD + "frames: {7: [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}\n", "line 10: frames: node 7: not a right-handed"),
    "frames without nodes": (
        'matrices: {mass: M, stiffness: K}\nboundary: [[7, "12"]]\nframes: {}\n',
        "line 3: frames need nodes",
    ),
    "system type": (GOOD + "systems: {rim: {type: conical}}\nframes: {7: rim}\n", "line 10: systems.rim: unknown type 'conical'"),
    "outside": (GOOD + "display: ../secret.npz\n", "line 10: display: '../secret.npz' lies outside the folder"),
    "absolute": (GOOD + "display: /etc/passwd\n", "lies outside the folder"),
    "absent": (GOOD + "display: nope.npz\n", "line 10: display: there is no file 'nope.npz'"),
    "recovery key": (
        GOOD + "recovery: {tip: {matix: C}}\n",
        "line 10: unknown key 'matix' in recovery.tip. Did you mean 'matrix'",
    ),
    "recovery empty": (GOOD + "recovery: {tip: {}}\n", "line 10: recovery.tip names no matrix"),
    "recovery absent": (GOOD + "recovery: {tip: {matrix: C}}\n", "line 10: recovery.tip: plate.npz has no matrix 'C'"),
    "recovery shape": (GOOD + "recovery: {tip: {matrix: K, labels: [a]}}\n", r"shape \(3, 3\), but \(1, any\)"),
    "not yaml": ("name: [1, 2\nboundary: ]:\n", "line 2: is not YAML"),
    "not a mapping": ("- 1\n- 2\n", "must be a YAML mapping"),
    "alias": ("source: &a x\nname: *a\n", "uses an alias"),
    "tag": ("name: !!python/object/apply:os.system ['true']\n", "is not YAML"),
    "empty": ("", "is empty"),
}


@pytest.mark.parametrize("case", WRONG)
def test_mistakes_are_told_in_one_line(folder: Path, case: str) -> None:
    text, message = WRONG[case]
    with pytest.raises(ReadError, match=message) as caught:
        read_component(with_text(folder, text))
    assert "\n" not in str(caught.value)


def test_no_sidecar(folder: Path) -> None:
    (folder / "plate.yaml").unlink()
    with pytest.raises(ReadError, match=r"need a sidecar .*plate\.yaml"):
        read_component(folder / "plate.npz", format="npz_matrices")
    with pytest.raises(ReadError, match="format is not recognised"):
        read_component(folder / "plate.npz")


def test_units_that_clash(folder: Path) -> None:
    with pytest.raises(ReadError, match="file says its units are 'SI', the argument units says 'mm-kg-s'"):
        read_component(folder / "plate.npz", units="mm-kg-s")
    assert read_component(folder / "plate.npz", units=(1.0, 1.0)).name == "plate"


def test_a_link_out_of_the_folder_is_outside(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    target = tmp_path_factory.mktemp("other") / "d.npz"
    np.savez(target, nodes=[1])
    (folder / "d.npz").symlink_to(target)
    with pytest.raises(ReadError, match="outside the folder"):
        read_component(with_text(folder, GOOD + "display: d.npz\n"))


@pytest.mark.parametrize(
    ("mass", "message"),
    [
        (np.ones((3, 2)), r"mass has shape \(3, 2\)"),
        (np.eye(4), r"stiffness has shape \(3, 3\), mass \(4, 4\)"),
        (np.array([[1, 2, 0], [0, 1, 0], [0, 0, 1.0]]), "not symmetric"),
        (np.diag([1, np.nan, 1]), "not finite at row 1"),
        (np.eye(3) * 1j, "real numbers are needed"),
        (np.array([["a"] * 3] * 3), "real numbers are needed"),
        (np.array(5.0), "a matrix is needed"),
    ],
)
def test_matrices_that_cannot_be(folder: Path, mass: np.ndarray, message: str) -> None:
    np.savez(folder / "plate.npz", M=mass, K=STIFFNESS)
    with pytest.raises(ReadError, match=message):
        read_component(folder / "plate.npz")


def test_a_display_file_that_does_not_fit(folder: Path) -> None:
    path = with_text(folder, GOOD + "display: d.npz\n")
    np.savez(folder / "d.npz", nodes=[5], positions=np.ones((1, 3)), matrix=np.ones((3, 4)), quads=[[0, 0, 0, 0]], lines=[[0, 0]])
    with pytest.raises(ReadError, match=r"shape \(3, 4\); 3 rows a node and 3 columns"):
        read_component(path)
    np.savez(folder / "d.npz", nodes=[5])
    with pytest.raises(ReadError, match="lines', 'positions', 'quads'"):
        read_component(path)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, len(GOOD) - 1), st.text(alphabet="[]{}:,-&*!'\"#|>%@` \n0.7ex", max_size=4), st.integers(0, 6))
def test_mutated_sidecars(folder: Path, at: int, text: str, cut: int) -> None:
    path = with_text(folder, GOOD[:at] + text + GOOD[at + cut :])
    try:
        component = read_component(path)
    except ReadError:
        return
    assert component.n == 3
