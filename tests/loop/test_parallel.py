"""The parallel form of a cascade: its defining equation, the same answers, and the fall-back near a pole of the loop."""

from dataclasses import replace

import numpy as np
import pytest

from flexplant.loop import fused, tiled
from flexplant.loop.cascade import cascade_of
from flexplant.loop.diagram import Diagram
from flexplant.loop.lifted import stepped
from flexplant.loop.line_of_sight import LineOfSight, line_of_sight_diagram
from flexplant.loop.parallel import separated, separation
from flexplant.loop.simulate import simulate
from flexplant.loop.stepping import stepper
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace

POLE = 40.0  # rad/s, of the lightly damped other block


def driven(omega, zeta=0.01):
    """Modes that drive an oscillator of 1 % damping through positions, and through velocities."""
    n = len(omega)
    rng = np.random.default_rng(n)
    plant = ModalPlant(
        omega=omega,
        zeta=zeta,
        shape_in=rng.normal(size=(n, 2)),
        shape_out=rng.normal(size=(1, n)),
        shape_out_velocity=rng.normal(size=(1, n)),
        inputs=["a", "b"],
        outputs=["y"],
    )
    A = [[0.0, 1.0], [-(POLE**2), -0.02 * POLE]]
    block = StateSpace(np.array(A), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)), ["y"], ["z"])
    return cascade_of(
        Diagram(
            blocks={"plant": plant, "block": block},
            connections=[("plant.y", "block.y")],
            inputs={"a": "plant.a", "b": "plant.b"},
            outputs={"y": "plant.y", "z": "block.z"},
        )
    )


def test_the_other_states_listen_to_the_inputs_alone():
    """A T - T F = -[P, V] with F of all modes, and a rigid-body mode among them."""
    cascade = driven([0.0, 3.0, 55.0, 900.0])
    T, n = separation(cascade), 4
    F = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(cascade.omega**2), -np.diag(2 * cascade.zeta * cascade.omega)]])
    residual = cascade.A @ T - T @ F + cascade.from_modes
    assert abs(residual).max() < 1e-13 * abs(cascade.A @ T).max()
    assert not separated(cascade, T).from_modes.any()


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize(("near", "parallel"), [(55.0, True), (POLE * 1.0001, False)])
def test_parallel_or_not_the_motion_is_that_of_the_cascade(near, parallel, hold):
    """A mode beside the pole would make T large: then the cascade is stepped as it is."""
    cascade, dt = driven([0.0, 3.0, near, 900.0]), 1e-3
    rng = np.random.default_rng(0)
    w, state = rng.normal(size=(2, 1001)), rng.normal(size=cascade.n_states)
    order = np.r_[cascade.modal_states, cascade.other_states]
    one, rows, x, expected = stepper(cascade, dt, hold), np.hstack([cascade.C_modes, cascade.C]), state[order], []
    for k in range(1000):
        expected.append(rows @ x + cascade.D @ w[:, k])
        x = stepped(one, x[None])[0] + np.r_[w[:, k], w[:, k + 1] - w[:, k]] @ one.drive
    runner = fused.FusedRecursion(cascade, dt, state, hold)
    assert (runner._T is not None) == parallel
    assert isinstance(runner._steps, tiled.TileSteps)
    outputs = np.vstack([runner.run(w[:, :502].T, 501), runner.run(w[:, 501:].T, 499)])
    assert (abs(outputs - expected).max(axis=0) <= 1e-12 * abs(np.array(expected)).max(axis=0)).all()
    assert abs(runner.state - x).max() <= 1e-12 * abs(x).max()


def test_an_integrator_behind_a_rigid_body_mode_stays_in_the_cascade():
    cascade = driven([0.0, 3.0])
    assert separation(replace(cascade, A=np.array([[0.0, 1.0], [0.0, 0.0]]))) is None


@pytest.mark.parametrize("zeta", [1e-4, 0.005, 0.0071])
@pytest.mark.parametrize("offset", [0.0, 1e-3, 0.1])
def test_a_mode_beside_the_loops_own_pole_keeps_its_digits(monkeypatch, zeta, offset):
    """The steered loop's pole is at 100 sqrt(1801) rad/s; with and without separation, up to the limit of the terms' growth."""
    sight = LineOfSight(focal_length=1.5, gain=1800.0, mirror_omega=100.0, mirror_zeta=0.3)
    plant = ModalPlant(
        omega=[300.0, 100 * np.sqrt(1801) * (1 + offset), 9000.0],
        zeta=zeta,
        shape_in=[[1.0], [2.0], [1.0]],
        shape_out=[[1.0, 0.5, 0.2], [0.3, 1.0, -1.0]],
        inputs=["u"],
        outputs=["x", "y"],
    )
    loop = line_of_sight_diagram(sight, plant, plant_outputs=["x", "y"], signals=("spot", "angle", "tilt"))
    t, u = np.arange(4000) * 1e-4, np.random.default_rng(0).normal(size=(1, 4000))
    apart = simulate(loop, t, u).outputs.values
    monkeypatch.setattr("flexplant.loop.fused.separation", lambda cascade: None)
    together = simulate(loop, t, u).outputs.values
    assert (abs(apart - together).max(axis=1) < 1e-12 * abs(together).max(axis=1)).all()
