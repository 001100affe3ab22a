"""The split of a diagram into modes and a small rest against the whole system of `close`."""

import numpy as np
import pytest

from flexplant.blocks.sampled import saturation
from flexplant.errors import DiagramError
from flexplant.loop.cascade import Cascade, cascade_of
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.line_of_sight import line_of_sight_diagram
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace


def whole(cascade: Cascade) -> tuple[np.ndarray, ...]:
    """A, B, C, D with all states in the places that the cascade names."""
    n, m, other = cascade.omega.size, cascade.modal_states, cascade.other_states
    position, velocity = m[:n], m[n:]
    A = np.zeros((cascade.n_states, cascade.n_states))
    A[position, velocity], A[velocity, position] = 1.0, -(cascade.omega**2)
    A[velocity, velocity] = -2 * cascade.zeta * cascade.omega
    A[np.ix_(other, m)], A[np.ix_(other, other)] = cascade.from_modes, cascade.A
    B, C = np.zeros((cascade.n_states, cascade.D.shape[1])), np.zeros((cascade.D.shape[0], cascade.n_states))
    B[velocity], B[other] = cascade.shape_in, cascade.B
    C[:, m], C[:, other] = cascade.C_modes, cascade.C
    return A, B, C, cascade.D


def two_plants(*, feedback: bool) -> Diagram:
    """A listening plant with all kinds of outputs, a second one that listens or not, and two state spaces."""
    rng = np.random.default_rng(2)
    first = ModalPlant(
        omega=[0.0, 3.0, 7.0],
        zeta=[0.0, 0.01, 0.3],
        shape_in=rng.normal(size=(3, 2)),
        shape_out=rng.normal(size=(2, 3)),
        shape_out_acceleration=rng.normal(size=(2, 3)),
        static_correction=rng.normal(size=(2, 2)),
        inputs=["a", "b"],
        outputs=["y", "z"],
    )
    second = ModalPlant(
        omega=[5.0], zeta=0.02, shape_in=[[1.0]], shape_out=[[0.0]], shape_out_velocity=[[2.0]], inputs=["f"], outputs=["v"]
    )
    one, two = (
        StateSpace(
            rng.normal(size=(k, k)), rng.normal(size=(k, 2)), rng.normal(size=(1, k)), rng.normal(size=(1, 2)), list("pq"), ["r"]
        )
        for k in (2, 1)
    )
    return Diagram(
        blocks={"one": one, "first": first, "two": two, "second": second},
        connections=[("first.y", "one.p"), ("second.v", "one.q"), ("one.r", "two.p")]
        + ([("two.r", "second.f")] if feedback else []),
        inputs={"u": ["first.a", "two.q"], "w": "first.b", **({} if feedback else {"x": "second.f"})},
        outputs={"last": "two.r", "plant": "first.z", "rate": "second.v", "middle": "one.r"},
        allow_algebraic_loops=feedback,
    )


@pytest.mark.parametrize("feedback", [False, True])
def test_split_of_two_plants_is_the_closed_diagram(feedback):
    diagram = two_plants(feedback=feedback)
    cascade, expected = cascade_of(diagram), close(diagram)
    assert cascade.omega.size == (3 if feedback else 4)
    for found, letter in zip(whole(cascade), "ABCD", strict=True):
        assert found == pytest.approx(getattr(expected, letter), rel=1e-13, abs=1e-13)


@pytest.mark.parametrize("closed", [True, False])
def test_split_of_the_line_of_sight_is_the_closed_diagram(published, plant, closed):
    diagram = line_of_sight_diagram(published, plant, closed=closed, signals=("spot", "angle", "tilt"), commands=True)
    cascade, expected = cascade_of(diagram), close(diagram)
    assert cascade.omega.size == plant.n_modes
    for found, letter in zip(whole(cascade), "ABCD", strict=True):
        assert found == pytest.approx(getattr(expected, letter), rel=1e-13, abs=1e-13 * abs(getattr(expected, letter)).max())


def test_a_diagram_of_plants_alone_has_no_rest(plant):
    diagram = Diagram(
        blocks={"plant": plant}, inputs={n: f"plant.{n}" for n in plant.inputs}, outputs={"y": f"plant.{plant.outputs[0]}"}
    )
    cascade = cascade_of(diagram)
    assert cascade.A.shape == (0, 0)
    assert cascade.C_modes.shape == (1, 2 * plant.n_modes)


def test_nonlinear_diagrams_have_no_split(plant):
    name = plant.inputs[0]
    diagram = Diagram(
        blocks={"plant": plant, "clip": saturation(-1.0, 1.0)},
        connections=[("clip.y", f"plant.{name}")],
        inputs={"u": "clip.u", **{n: f"plant.{n}" for n in plant.inputs[1:]}},
        outputs={"y": f"plant.{plant.outputs[0]}"},
    )
    with pytest.raises(DiagramError, match="nonlinear"):
        cascade_of(diagram)
