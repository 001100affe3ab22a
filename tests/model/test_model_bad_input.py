"""Bad input to the model room: one clear line each, flexplant's own exceptions, never a numpy traceback."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from flexplant.errors import FlexplantError, InputError, MissingExtraError, ModelError, ReadError, nearest
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.damping import damping_ratios, with_modal_damping
from flexplant.model.dofs import DofSet, expand_directions
from flexplant.model.geometry import Nodes, Placement, check_rotation, cylindrical_frame
from flexplant.model.recovery import Recovery
from flexplant.model.units import unit_system

K2 = np.array([[2.0, -1.0], [-1.0, 2.0]])
GOOD = {"name": "bus", "mass": np.eye(2), "stiffness": K2, "boundary": [(1, 1), (1, 2)]}


def one_line(error):
    text = str(error.value)
    assert "\n" not in text
    assert len(text) < 400
    return text


BAD_COMPONENTS = {
    "another size": ({"stiffness": np.eye(3)}, r"'bus': stiffness matrix has shape \(3, 3\), but \(2, 2\) is needed"),
    "not square": ({"mass": np.ones((2, 3))}, r"\(2, 3\), but a square matrix"),
    "one-dimensional": ({"mass": np.ones(2)}, r"shape \(2,\)"),
    "a number": ({"mass": 3.0}, r"shape \(\)"),
    "unsymmetric": ({"stiffness": [[1.0, 2.0], [2.1, 1.0]]}, r"not symmetric: entries \(0, 1\) and \(1, 0\) differ by 0\.1"),
    "one triangle": ({"stiffness": np.triu(K2)}, "fill the other one first"),
    "unsymmetric sparse": ({"stiffness": sp.csr_array([[1.0, 2.0], [0.0, 1.0]])}, r"entries \(0, 1\) and \(1, 0\)"),
    "NaN": ({"mass": [[1.0, np.nan], [np.nan, 1.0]]}, r"not finite at row 0, column 1"),
    "NaN sparse": ({"mass": sp.csr_array([[1.0, 0], [0, np.nan]])}, r"not finite at row 1, column 1"),
    "infinite": ({"damping": np.diag([1.0, np.inf])}, "damping matrix has an entry that is not finite"),
    "complex": ({"stiffness": K2 * (1 + 0.01j)}, r"is complex.*craig_bampton\(..., structural_damping=D\)"),
    "complex sparse": ({"stiffness": sp.csr_array(K2 * (1 + 0.01j))}, "is complex"),
    "text": ({"mass": [["a", "b"], ["c", "d"]]}, "not a real numeric matrix"),
    "ragged": ({"mass": [[1.0], [1.0, 2.0]]}, "not a real numeric matrix"),
    "none": ({"mass": None}, "mass matrix"),
    "no stiffness": ({"stiffness": None}, r"'bus': stiffness matrix has shape \(\)"),
    "node beyond 64 bits": ({"boundary": [(10**30, 1)]}, "pairs such as"),
    "recovery none": ({"recovery": None}, "recovery must be a mapping by name or a list of Recovery, got NoneType"),
    "too many DOF": ({"boundary": [(1, "123")]}, r"3 boundary DOF but matrices of shape \(2, 2\)"),
    "DOF twice": ({"boundary": [(1, 1), (1, 1)]}, "listed twice: 1-1"),
    "direction 7": ({"boundary": [(1, 7)]}, "directions 7"),
    "direction minus": ({"boundary": [(1, -1)]}, "directions -1"),
    "DOF not pairs": ({"boundary": [1, 2]}, r"pairs such as \(101, 1\)"),
    "fractional node": ({"boundary": [(1.5, 1)]}, "pairs such as"),
    "node not in nodes": ({"nodes": Nodes([2], [[0, 0, 0]])}, r"nodes \[1\] that are not in its 1 nodes"),
    "nodes as a dict": ({"nodes": {1: (0, 0, 0)}}, "nodes must be Nodes"),
    "modal ids miscounted": ({"boundary": [], "modal_ids": [1]}, "1 modal ids for 2"),
    "modal ids twice": ({"boundary": [], "modal_ids": [4, 4]}, "must be distinct"),
    "modal id is a scalar boundary": ({"boundary": [(1, 0)], "modal_ids": [1]}, r"distinct from scalar boundary DOF \[1\]"),
    "name with a dot": ({"name": "bus.1"}, "name 'bus.1'"),
    "name empty": ({"name": ""}, "name ''"),
    "name no text": ({"name": 5}, "name 5"),
    "recovery of another width": ({"recovery": [Recovery("d", ["x"], displacement=np.ones((1, 3)))]}, "3 columns"),
    "recovery twice": ({"recovery": [Recovery("d", ["x"], np.ones((1, 2)))] * 2}, "names must be distinct"),
    "recovery under another key": ({"recovery": {"x": Recovery("d", ["x"], np.ones((1, 2)))}}, "keys must be the names"),
    "recovery as a matrix": ({"recovery": {"d": np.ones((1, 2))}}, "recovery must be Recovery values, got ndarray"),
}  # fmt: skip


@pytest.mark.parametrize("case", list(BAD_COMPONENTS))
def test_bad_components(case):
    change, message = BAD_COMPONENTS[case]
    with pytest.raises(ModelError, match=message) as error:
        Component(**{**GOOD, **change})
    one_line(error)


def test_bad_models():
    with pytest.raises(ModelError, match=r"model 'm': mass matrix has shape \(2, 2\), but \(3, 3\)"):
        FiniteElementModel(name="m", mass=np.eye(2), stiffness=np.eye(3), dofs=[(1, "123")])
    with pytest.raises(ModelError, match=r"nodes \[9\] that are not in its 1 nodes"):
        FiniteElementModel(name="m", mass=np.eye(1), stiffness=np.eye(1), dofs=[(9, 1)], nodes=Nodes([1], [[0, 0, 0]]))


BAD_NODES = {
    "positions of another length": (([1, 2], [[0, 0, 0]]), r"2 ids need positions of shape \(2, 3\), got \(1, 3\)"),
    "ids twice": (([1, 1], np.zeros((2, 3))), "1 node ids are listed twice"),
    "fractional ids": (([1.5], np.zeros((1, 3))), "nodes: ids"),
    "ids as text": ((["a"], np.zeros((1, 3))), "nodes: ids"),
    "positions as text": (([1], [["x", "y", "z"]]), "nodes: positions"),
    "ragged positions": (([1, 2], [[0, 0, 0], [0, 0]]), "nodes: positions"),
    "NaN": (([7], [[0, np.nan, 0]]), "position of node 7 is not finite"),
    "frames of another shape": (([1], np.zeros((1, 3)), np.eye(3)), r"frames must have shape \(1, 3, 3\), got \(3, 3\)"),
    "frame not a rotation": (([5], np.zeros((1, 3)), [np.ones((3, 3))]), "frame of node 5: not a right-handed rotation"),
    "left-handed frame": (([5], np.zeros((1, 3)), [np.diag([1.0, 1, -1])]), "frame of node 5: not a right-handed"),
}


@pytest.mark.parametrize("case", list(BAD_NODES))
def test_bad_nodes(case):
    arguments, message = BAD_NODES[case]
    with pytest.raises(ModelError, match=message) as error:
        Nodes(*arguments)
    one_line(error)


@pytest.mark.parametrize(
    "bad", [np.eye(2), np.full((3, 3), np.nan), 2 * np.eye(3), "turn", [[1, 0], [0, 1, 0]], np.zeros((3, 3))]
)
def test_bad_rotations(bad):
    for make in (lambda: check_rotation(bad, "placement"), lambda: Placement(rotation=bad)):
        with pytest.raises(ModelError, match="placement"):
            make()


@pytest.mark.parametrize("bad", [[1.0, 2.0], [1.0, 2.0, np.inf], "far", [[1, 2, 3]]])
def test_bad_translations(bad):
    with pytest.raises(ModelError, match="translation"):
        Placement(translation=bad)


def test_unknown_nodes_and_dof_are_named_with_their_neighbours():
    nodes = Nodes([101, 102], np.zeros((2, 3)))
    with pytest.raises(ModelError, match=r"no position is known for node 103\. Did you mean '10[12]'"):
        nodes.position(103)
    dofs = DofSet.of([(101, "123"), (102, 1)])
    with pytest.raises(ModelError, match=r"bus has no DOF 101-5; node 101 has directions \[1, 2, 3\]"):
        dofs.row(101, 5, owner="bus")
    with pytest.raises(ModelError, match="has no node 999 among its DOF"):
        dofs.rows([(101, 1), (999, 1)])


@pytest.mark.parametrize("bad", ["", "7", "11", "x", None, [1, 1], 1.5, [[1]]])
def test_bad_directions(bad):
    with pytest.raises((ModelError, TypeError)):
        expand_directions(bad)
    with pytest.raises(ModelError):
        DofSet.of([(1, bad)])


def test_bad_dof_sets():
    with pytest.raises(ModelError, match=r"node has shape \(2,\), direction \(1,\)"):
        DofSet([1, 2], [1])
    with pytest.raises(ModelError, match="directions must lie in 0-6"):
        DofSet([1], [9])
    with pytest.raises(ModelError, match="node ids"):
        DofSet([np.nan], [1])


def test_bad_recovery():
    with pytest.raises(ModelError, match="labels listed twice: a"):
        Recovery("d", ["a", "a"], np.ones((2, 3)))
    with pytest.raises(ModelError, match="at least one of displacement"):
        Recovery("d", ["a"])
    with pytest.raises(ModelError, match=r"velocity matrix has shape \(1, 2\), but \(1, 3\)"):
        Recovery("d", ["a"], np.ones((1, 3)), velocity=np.ones((1, 2)))
    with pytest.raises(ModelError, match=r"has no row 'tipx'\. Did you mean 'tip x'"):
        Recovery("d", ["tip x"], np.ones((1, 3))).row("tipx")


@pytest.mark.parametrize("bad", [-0.1, np.nan, [0.1, 0.2, 0.3], [[1.0, 2.0, 3.0]], [], "much"])
def test_bad_damping(bad):
    part = Component(**{**GOOD, "boundary": []})
    with pytest.raises(ModelError, match="damping ratio"):
        with_modal_damping(part, bad)


def test_damping_of_a_negative_stiffness_is_an_error():
    part = Component(name="x", mass=np.eye(1), stiffness=[[-4.0]], boundary=[])
    with pytest.raises(ModelError, match="negative stiffness have no damping ratio"):
        with_modal_damping(part, 0.01)
    assert np.isnan(part.fixed_interface_hz).all()


@pytest.mark.parametrize("bad", ["imperial", (0.0, 1.0), (1.0, -2.0), (1e-3,), 5, ("mm", "kg"), (np.nan, 1.0)])
def test_bad_units(bad):
    with pytest.raises(InputError, match="unit"):
        unit_system(bad)


def test_errors_form_one_family_and_hint():
    assert issubclass(ModelError, InputError)
    assert issubclass(InputError, FlexplantError)
    assert issubclass(InputError, ValueError)
    assert nearest("bsu", ["bus", "optic"]) == " Did you mean 'bus'?"
    assert nearest("x", []) == " There are none."
    assert nearest("zzz", [str(i) for i in range(100)]).endswith("'7', ....")
    assert "record kaa, byte 12: short" in str(ReadError("a.op4", "short", record="kaa", offset=12))
    assert "pip install 'flexplant[nastran]'" in str(MissingExtraError("pyyeti", "nastran"))


def test_large_sparse_matrices_stay_sparse_in_their_errors():
    n = 60_000  # dense this would be 29 GB
    bad = sp.diags_array(np.r_[np.ones(n - 1), np.nan]).tocsr()
    with pytest.raises(ModelError, match=f"row {n - 1}, column {n - 1}"):
        Component(name="big", mass=bad, stiffness=sp.eye_array(n), boundary=[])
    lopsided = sp.csr_array(sp.eye_array(n) + sp.csr_array(([1.0], ([3], [8])), shape=(n, n)))
    with pytest.raises(ModelError, match=r"\(3, 8\) and \(8, 3\)"):
        Component(name="big", mass=sp.eye_array(n), stiffness=lopsided, boundary=[])


def test_axis_of_a_cylindrical_frame_takes_its_x_axis():
    np.testing.assert_array_equal(cylindrical_frame([0, 0, 5], [0, 0, 0], np.eye(3)), np.eye(3))
    with pytest.raises(ModelError, match="cylindrical frame"):
        cylindrical_frame([1, 0, 0], [0, 0, 0], np.ones((3, 3)))


def test_ratios_take_a_value_a_list_or_a_table():
    hz = np.array([1.0, 10.0, 100.0])
    np.testing.assert_array_equal(damping_ratios(0.02, hz), 0.02)
    np.testing.assert_array_equal(damping_ratios([0.1, 0.2, 0.3], hz), [0.1, 0.2, 0.3])
    np.testing.assert_allclose(damping_ratios([(50.0, 0.02), (5.0, 0.01)], hz), [0.01, 0.01 + 0.01 * 5 / 45, 0.02])


@pytest.mark.parametrize("kind", ["mass", "stiffness"])
def test_a_model_without_a_matrix_is_refused(kind):
    fields = {"name": "m", "mass": np.eye(2), "stiffness": K2, "dofs": [(1, 1), (1, 2)]}
    with pytest.raises(ModelError, match=rf"model 'm': {kind} matrix has shape \(\)"):
        FiniteElementModel(**{**fields, kind: None})


def test_recovery_without_labels_is_refused():
    with pytest.raises(ModelError, match="labels must be a list of names, got NoneType"):
        Recovery("d", None, displacement=np.ones((1, 2)))
