"""The 3-D view: meshes are checked once, shapes scaled to one size, packed arrays read back bit by bit."""

import base64

import numpy as np
import pytest

from flexplant.errors import InputError
from flexplant.report import DisplayMesh, StructureView, joined


def square(x: float = 0.0) -> DisplayMesh:
    positions = np.array([[x, 0, 0], [x + 1, 0, 0], [x + 1, 1, 0], [x, 1, 0]])
    return DisplayMesh(nodes=[1, 2, 3, 4], positions=positions, quads=[[0, 1, 2, 3]], lines=[[0, 2]])


def unpacked(text: str, dtype: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype=dtype)


def test_the_page_gets_the_mesh_and_shapes_of_one_size():
    shapes = np.random.default_rng(5).normal(size=(3, 4, 3)) * np.array([1e-6, 1.0, 300.0])[:, None, None]
    payload = StructureView(square(), shapes, [0.0, 107.0, 112.8]).payload()
    np.testing.assert_array_equal(unpacked(payload["quads"], "<u4"), [0, 1, 2, 3])
    np.testing.assert_array_equal(unpacked(payload["lines"], "<u4"), [0, 2])
    np.testing.assert_array_equal(unpacked(payload["positions"], "<f4").reshape(4, 3), square().positions)
    sent = unpacked(payload["shapes"], "<f4").reshape(3, 4, 3)
    np.testing.assert_allclose(np.linalg.norm(sent, axis=2).max(axis=1), 1, rtol=1e-6)
    ratio = sent / shapes
    np.testing.assert_allclose(ratio, ratio[:, :1, :1] * np.ones_like(ratio), rtol=1e-5)


def test_a_mode_that_does_not_move_the_mesh_stays_still():
    payload = StructureView(square(), np.zeros((1, 4, 3)), [5.0]).payload()
    assert not unpacked(payload["shapes"], "<f4").any()


def test_modes_are_named_with_their_frequency():
    view = StructureView(square(), np.ones((2, 4, 3)), [0.0, 112.756], labels=["Rigid body 1", "X bending 1"])
    assert view.captions == ["Rigid body 1 · 0 Hz", "X bending 1 · 112.8 Hz"]
    assert StructureView(square(), np.ones((1, 4, 3)), [7.0]).captions == ["Mode 1 · 7.0 Hz"]


def test_joined_meshes_keep_their_own_faces():
    both = joined([square(), square(2.0)])
    np.testing.assert_array_equal(both.positions[both.quads[1]], square(2.0).positions)
    np.testing.assert_array_equal(both.positions[both.lines[1]], square(2.0).positions[[0, 2]])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: DisplayMesh([1], np.zeros((2, 3)), [], []), r"1 nodes with positions \(2, 3\)"),
        (lambda: DisplayMesh([], np.zeros((0, 3)), [], []), "n > 0"),
        (lambda: DisplayMesh([1], [[0, 0, np.nan]], [], []), "positions has entries that are not finite"),
        (lambda: DisplayMesh([1], np.zeros((1, 3)), [[0, 0, 0, 7]], []), "quads name places 0 ... 7, but there are 1"),
        (lambda: StructureView(square(), np.zeros((1, 3, 3)), [1.0]), r"\(1, 3, 3\) do not fit 1 frequencies and 4 nodes"),
        (lambda: StructureView(square(), np.zeros((1, 4, 3)), [1.0], labels=["a", "b"]), "2 labels for 1 modes"),
        (lambda: StructureView(square(), np.zeros((1, 4, 3)), [1.0], first_mode=1), "first mode 1 of 1"),
        (lambda: joined([]), "nothing to join"),
    ],
)
def test_what_cannot_be_shown_is_said_plainly(make, words):
    with pytest.raises(InputError, match=words):
        make()
