"""Recognising formats from content; and the published example's own files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from flexplant.errors import InputError, ReadError
from flexplant.io import formats, read_component, read_display_mesh, read_model, writers
from flexplant.io.registry import recognise
from flexplant.model.geometry import rigid_body_vectors

EXAMPLES = Path(__file__).parents[2] / "examples" / "shocksat" / "data"
STORED = [EXAMPLES / f"{name}_KM.npz" for name in ("whole", "bus", "optic")]


def test_each_format_is_one_module_and_says_what_it_does() -> None:
    for name, found in formats().items():
        assert found.sniff.__module__ == f"flexplant.io.read.{name}"
        assert found.description
        assert set(found.readers) <= {"read_component", "read_model", "read_geometry", "read_display_mesh"}
    assert {"flexplant_npz", "flexplant_h5", "mat", "netcdf", "c_source", "fmu"} <= set(writers())


def test_unknown_things_list_what_is_known(tmp_path: Path) -> None:
    path = tmp_path / "noise.bin"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(ReadError, match=r"not recognised; read_component knows: .*nastran_extseout.*output4"):
        read_component(path)
    with pytest.raises(ReadError, match="no format 'op44' for read_component"):
        read_component(path, format="op44")
    with pytest.raises(InputError, match="has no option 'sidcar'"):
        read_component(path, format="output4", sidcar="x")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("absent.op4", "no such file"),
        ("nowhere/a.op4", "the folder .* does not exist"),
        (".", "this is a folder"),
        ("e", "is empty"),
    ],
)
def test_paths_that_cannot_be_read(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "e").write_bytes(b"")
    for reader in (read_component, read_model, read_display_mesh):
        with pytest.raises(ReadError, match=message):
            reader(tmp_path / name)
    with pytest.raises(ReadError):
        read_component("\x00")
    with pytest.raises(ReadError):
        read_component("x" * 5000)


def test_no_sniff_raises(tmp_path: Path) -> None:
    for i, head in enumerate(
        (b"\x18\x00", b"PK\x03\x04.npy", b"MATLAB ", b"\x89HDF\r\n\x1a\n", b"       1       1", b"\xff" * 5000)
    ):
        path = tmp_path / f"{i}.op4"
        path.write_bytes(head)
        for found in formats().values():
            assert found.sniff(head[:4096], path) in (True, False)


@pytest.mark.parametrize("name", ["bus", "optic"])
def test_the_example_components(name: str) -> None:
    """A free-free component: its boundary moves rigidly without force; the display rows follow the boundary rigidly."""
    component = read_component(EXAMPLES / f"{name}.OU1", damping=0.005)
    assert component.name == name
    rigid = np.vstack([rigid_body_vectors(component.nodes, component.boundary), np.zeros((component.n_modal, 6))])
    scale = abs(component.stiffness).max()
    assert abs(component.stiffness @ rigid).max() < 1e-9 * scale
    mesh = read_display_mesh(EXAMPLES / f"{name}.OU1")
    moved = component.recovery["display"].displacement @ rigid[:, :3]
    assert np.allclose(moved, np.tile(np.eye(3), (len(mesh.nodes), 1)), atol=1e-5)
    assert component.source["surrogate"] is True


@pytest.mark.parametrize("path", STORED, ids=lambda p: p.stem)
def test_triangles_give_symmetric_matrices(path: Path) -> None:
    model = read_model(path)
    with np.load(path) as stored:
        upper = sp.coo_array((stored["Kv"], (stored["Ki"], stored["Kj"])), shape=model.stiffness.shape).tocsr()
        assert (model.stiffness != upper + sp.triu(upper, 1).T).nnz == 0
        assert np.array_equal(model.dofs.node, stored["dof"][:, 0])
    assert recognise(path, None, "read_model")[1].name == "npz_triangles"


def test_positions_of_a_triangle_model_come_from_its_deck() -> None:
    model = read_model(EXAMPLES / "optic_KM.npz", geometry=EXAMPLES / "optic.bdf")
    rigid = rigid_body_vectors(model.nodes, model.dofs)
    assert abs(model.stiffness @ rigid).max() < 1e-7 * abs(model.stiffness).max()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"Ki": np.array([0, 5])}, "record K: places"),
        ({"Kj": np.array([0, -1])}, "record K: places"),
        ({"Kv": np.array([1.0])}, "record K: needs integer Ki, Kj and as many Kv"),
        ({"Mi": np.array([0.0])}, "record M: needs integer"),
        ({"dof": np.zeros((2, 3), int)}, "record dof: must be integers"),
        ({"dof": np.array([[1, 1], [1, 1]])}, "listed twice"),
        ({"Ki": np.array([0, 1]), "Kj": np.array([1, 0])}, "both triangles"),
    ],
)
def test_triangles_that_cannot_be(tmp_path: Path, change: dict[str, np.ndarray], message: str) -> None:
    good = {"dof": np.array([[1, 1], [1, 2]]), "Ki": np.array([0, 0]), "Kj": np.array([0, 1]), "Kv": np.array([2.0, -1.0])}
    good |= {"Mi": np.array([0]), "Mj": np.array([0]), "Mv": np.array([1.0])}
    np.savez(tmp_path / "a.npz", **good)
    assert read_model(tmp_path / "a.npz").stiffness.toarray().tolist() == [[2, -1], [-1, 0]]
    np.savez(tmp_path / "b.npz", **(good | change))
    with pytest.raises(ReadError, match=message):
        read_model(tmp_path / "b.npz")
