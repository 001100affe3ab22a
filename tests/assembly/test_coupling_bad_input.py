"""Bad input to coupling: one clear line each, CouplingError, never a numpy traceback."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from structures import chain, chain_halves

from flexplant.assembly import Connection, couple
from flexplant.errors import CouplingError, FlexplantError, ModelError
from flexplant.model.geometry import Placement

LEFT, RIGHT = chain_halves()
PARTS = [LEFT, RIGHT]


def joint(**options):
    return Connection(**{"a": "left", "b": "right", "pairs": [(4, 4)], **options})


BAD_CONNECTIONS = {
    "direction 7": ({"directions": "17"}, "directions '17'"),
    "no directions": ({"directions": ""}, "directions ''"),
    "directions none": ({"directions": None}, "'left-right'"),
    "scalar direction of a node": ({"directions": "0"}, r"nodes couple in 1-6"),
    "direction twice": ({"directions": "11"}, "distinct digits"),
    "frame that does not exist": ({"frame": "optic"}, r"frame 'optic' does not exist; use 'a', 'b', 'system'"),
    "frame not a rotation": ({"frame": np.ones((3, 3))}, "frame: not a right-handed rotation"),
    "offset unknown": ({"offset": "maybe"}, "offset 'maybe' is not one of"),
    "pairs by magic": ({"pairs": "by magic"}, "'by position', got 'by magic'"),
    "pairs none": ({"pairs": None}, "pairs must be a list, got NoneType"),
    "pairs a number": ({"pairs": 4}, "pairs must be a list, got int"),
    "pairs empty": ({"pairs": []}, "no pairs"),
    "ground first": ({"a": "ground"}, "name the component first"),
    "ground by position": ({"b": "ground", "pairs": "by position"}, "list the nodes to ground"),
    "ground twice named": ({"b": "ground", "pairs": [4], "nodes": [4]}, "pairs and nodes both list nodes to ground"),
    "ground without nodes": ({"b": "ground", "pairs": "by position", "nodes": []}, "nodes must be a list of node ids"),
    "name with a dot": ({"name": "a.b"}, "connection name 'a.b'"),
    "tolerance negative": ({"tolerance": -1.0}, "tolerance -1.0"),
    "tolerance NaN": ({"tolerance": np.nan}, "tolerance nan"),
    "tolerance a text": ({"tolerance": "1 mm"}, "tolerance 1 mm must be a length"),
    "tolerance complex": ({"tolerance": 1j}, "must be a length"),
    "no nodes by position": ({"pairs": "by position", "nodes": []}, r"nodes must be a list of node ids of 'left'.*got \[\]"),
    "one node by position": ({"pairs": "by position", "nodes": 4}, "nodes must be a list of node ids"),
    "nodes a text": ({"pairs": "by position", "nodes": "4"}, "nodes must be a list of node ids"),
    "nodes with a fraction": ({"pairs": "by position", "nodes": [4.9]}, "nodes must be a list of node ids"),
    "a component instead of its name": ({"a": LEFT}, "a and b are names of components, got Component"),
    "no component": ({"a": None}, "a and b are names of components, got NoneType"),
}


@pytest.mark.parametrize("case", list(BAD_CONNECTIONS))
def test_bad_connections(case):
    options, message = BAD_CONNECTIONS[case]
    with pytest.raises((CouplingError, ModelError), match=message) as error:
        joint(**options)
    assert "\n" not in str(error.value)


BAD_COUPLINGS = {
    "unknown component": ({"b": "rigth"}, r"no component is called 'rigth'\. Did you mean 'right'"),
    "unknown node": ({"pairs": [(44, 4)]}, r"'left' has no boundary node 44\. Did you mean '4'"),
    "unknown node on the other side": ({"pairs": [(4, 1)]}, "'right' has no boundary node 1"),
    "missing DOF": ({"pairs": [((4, 1), (4, 0))]}, r"component 'right' has no DOF 4-0; node 4 has directions"),
    "missing node of a DOF": ({"pairs": [((9, 1), (4, 1))]}, "component 'left' has no node 9"),
    "half a DOF pair": ({"pairs": [((4, 1), 4)]}, r"is not \(\(node, direction\), \(node, direction\)\)"),
    "fraction in a DOF pair": ({"pairs": [((4.5, 1), (4, 1))]}, r"is not \(\(node, direction\), \(node, direction\)\)"),
    "three in a pair": ({"pairs": [(4, 4, 4)]}, "is not a pair of node ids"),
    "text in a pair": ({"pairs": [("four", 4)]}, r"\('four', 4\) is not a pair of node ids"),
    "fractions in a pair": ({"pairs": [(4.5, 4)]}, r"\(4\.5, 4\) is not a pair"),
    "mixed pairs": ({"pairs": [(4, 4), ((4, 1), (4, 1))]}, "is not a pair of node ids"),
    "DOF to ground": ({"b": "ground", "pairs": [(4, 1)]}, r"\(4, 1\) is not a node to ground.*directions='123'"),
    "unknown ground node": ({"b": "ground", "pairs": [77]}, "'left' has no boundary node 77"),
    "the same pair twice": ({"pairs": [(4, 4), (4, 4)]}, "coupled twice"),
    "a node to itself": ({"b": "left"}, r"ties node 4 of 'left' to itself"),
    "a DOF to itself": ({"b": "left", "pairs": [((4, 1), (4, 1))]}, "ties node 4 of 'left' to itself"),
    "itself by position": ({"b": "left", "pairs": "by position"}, "to itself"),
}


@pytest.mark.parametrize("method", ["dual", "primal"])
@pytest.mark.parametrize("case", list(BAD_COUPLINGS))
def test_bad_couplings(case, method):
    options, message = BAD_COUPLINGS[case]
    with pytest.raises(CouplingError, match=message) as error:
        couple(PARTS, [joint(**options)], method=method)
    text = str(error.value)
    assert "\n" not in text
    assert len(text) < 500


@pytest.mark.parametrize("pairs", [[(4, 4, 4)], [("four", 4)], [None], [[]], [((4, 1), 4)], [(4.5, 4)]])
def test_a_pair_is_looked_at_where_it_is_written(pairs):
    with pytest.raises(CouplingError, match=r"left-right.* is not "):
        joint(pairs=pairs)
    with pytest.raises(CouplingError, match=r"left-ground.* is not a node to ground"):
        joint(b="ground", pairs=pairs)


def test_bad_component_lists():
    with pytest.raises(CouplingError, match="at least one component"):
        couple([])
    with pytest.raises(CouplingError, match=r"'left' appear 2 times; give copies names"):
        couple([LEFT, LEFT])
    with pytest.raises(CouplingError, match="must not be called 'ground'"):
        couple({"ground": LEFT})
    with pytest.raises(CouplingError, match="couple takes Components, got FiniteElementModel; reduce"):
        couple([chain()])
    with pytest.raises(CouplingError, match="couple takes Components, got str"):
        couple({"a": "left.op4"})
    with pytest.raises(FlexplantError, match=r"component name 'a\.b'"):
        couple({"a.b": LEFT})


def test_units_that_clash_are_named():
    with pytest.raises(CouplingError, match=r"units clash: 'left' in SI, 'right' in mm-tonne-s; convert while reading"):
        couple([LEFT, replace(RIGHT, units="mm-tonne-s")], [joint()])


def test_bad_placements():
    with pytest.raises(CouplingError, match=r"placements: no component is called 'lft'\. Did you mean 'left'"):
        couple(PARTS, [joint()], placements={"lft": Placement()})
    with pytest.raises(CouplingError, match="placements: 'left' needs a Placement, got tuple"):
        couple(PARTS, [joint()], placements={"left": (1, 2, 3)})


def test_coordinates_tied_on_the_users_word():
    """Crossed axes ground the rigid-body motion: refused, unless offset="ignore" says that it is meant."""
    crossed = [((4, 1), (4, 2))]
    with pytest.raises(CouplingError, match=r"contradicts rigid-body motion.*offset='ignore'"):
        couple(PARTS, [joint(pairs=crossed)])
    assert couple(PARTS, [joint(pairs=crossed, offset="ignore")]).n_constraints == 1


def test_unnamed_connections_get_distinct_names():
    system = couple(PARTS, [joint(directions="12"), joint(directions="34"), Connection("left", None, [1], name=None)])
    assert [r.connection.name for r in system.connections] == ["left-right", "left-right-2", "left-ground"]
    assert len(set(system.constraint_labels)) == system.n_constraints == 10


def test_inputs_stay_unchanged():
    before = [(c.mass.copy(), c.stiffness.copy()) for c in PARTS]
    couple(PARTS, [joint()], method="primal").stiffness  # noqa: B018
    for c, (mass, stiffness) in zip(PARTS, before, strict=True):
        np.testing.assert_array_equal(c.mass, mass)
        np.testing.assert_array_equal(c.stiffness, stiffness)


@pytest.mark.parametrize("bad", [None, "left-right", [("left", "right", [(4, 4)])], {"joint": joint()}])
def test_connections_must_be_connections(bad):
    with pytest.raises(CouplingError, match="connections must be a list of Connection") as error:
        couple(PARTS, bad)
    assert "\n" not in str(error.value)


def test_components_may_come_from_a_generator():
    assert couple((part for part in PARTS), [joint()]).n == couple(PARTS, [joint()]).n
    with pytest.raises(CouplingError, match="couple takes a list of Components, got NoneType"):
        couple(None)


@pytest.mark.parametrize("bad", [Placement(), [Placement()]])
def test_placements_are_a_mapping(bad):
    with pytest.raises(CouplingError, match=r"placements must be \{component name: Placement\}"):
        couple(PARTS, [joint()], placements=bad)


def test_a_bad_pair_of_an_array_stays_on_one_line():
    with pytest.raises(CouplingError, match="is not a pair of node ids") as error:
        couple(PARTS, [joint(pairs=np.array([[[4, 1], [4, 1]]]))])
    assert "\n" not in str(error.value)
