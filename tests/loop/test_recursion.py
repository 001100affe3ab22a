"""The lifted recursion: against stepping one by one, in any chunk, decimated, compiled or not."""

import numpy as np
import pytest

from flexplant.blocks.delay import sample_delay
from flexplant.loop import lifted, recursion
from flexplant.loop.cascade import cascade_of
from flexplant.loop.line_of_sight import line_of_sight_diagram
from flexplant.loop.stepping import stepper
from flexplant.plant.modal import ModalPlant


def one_by_one(cascade, dt, w, state, hold):
    """The defining recursion, in the sorted order of states."""
    one = stepper(cascade, dt, hold)
    rows, x, out = np.hstack([cascade.C_modes, cascade.C]), state.copy(), []
    for k in range(w.shape[1]):
        out.append(rows @ x + cascade.D @ w[:, k])
        if k + 1 < w.shape[1]:
            x = lifted.stepped(one, x[None])[0] + np.r_[w[:, k], w[:, k + 1] - w[:, k]] @ one.drive
    return np.array(out).T, x


def march(cascade, dt, w, state, hold, every=1):
    runner = recursion.Recursion(cascade, dt, state, hold, every)
    return recursion.march(runner, w, w.shape[1], cascade.D.shape[::-1], every)


def error(a, b):
    return float(abs(a - b).max() / abs(b).max())


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("every", [1, 3, 25, 64, 509])
def test_lifted_equals_one_by_one(published, make_plant, hold, every):
    cascade = cascade_of(line_of_sight_diagram(published, make_plant(n_rigid=0), signals=("spot", "angle", "tilt")))
    rng = np.random.default_rng(3)
    w, state = rng.normal(size=(6, 1200)), rng.normal(size=cascade.n_states) * 1e-7
    order = np.r_[cascade.modal_states, cascade.other_states]
    outputs, final = one_by_one(cascade, 2e-4, w, state[order], hold)
    run = march(cascade, 2e-4, w, state, hold, every)
    assert error(run.outputs, outputs[:, ::every]) < 1e-12
    assert error(run.final_state[order], final) < 1e-12


@pytest.mark.parametrize("zeta", [0.0, 1e-4, 0.5, 1.0])
def test_slow_modes_near_one(zeta):
    """Modes whose z is within 1e-9 of 1, and rigid-body modes, at any damping."""
    omega = np.array([0.0, 1e-6, 1e-3, 0.1, 30.0, 2e3])
    rng = np.random.default_rng(0)
    plant = ModalPlant(
        omega=omega, zeta=zeta, shape_in=rng.normal(size=(6, 2)), shape_out=np.eye(6), inputs=["a", "b"], outputs=list("123456")
    )
    cascade, w, state = cascade_of(plant), rng.normal(size=(2, 3000)), np.zeros(12)
    outputs, _ = one_by_one(cascade, 1e-3, w, state, "first")
    run = march(cascade, 1e-3, w, state, "first")
    assert (abs(run.outputs - outputs).max(axis=1) <= 1e-12 * abs(outputs).max(axis=1)).all()


def test_compiled_and_plain_recursion_agree(published, plant):
    rng = np.random.default_rng(1)
    cascade = cascade_of(line_of_sight_diagram(published, plant))
    made = recursion.Recursion(cascade, 1e-4, np.zeros(cascade.n_states), "zero")
    driven = rng.normal(size=(40, cascade.n_states))
    results = []
    for kernel in (lifted.block_starts, lifted.block_starts.fallback, lifted.block_starts.loops):
        x, starts = np.ones(cascade.n_states), np.empty_like(driven)
        kernel(*made._long, driven, x, starts)
        results.append(np.vstack([starts, x]))
    assert error(results[0], results[1]) < 1e-13
    assert error(results[2], results[1]) < 1e-13


def test_discrete_systems_are_lifted_too():
    delay = sample_delay(7, 0.1)
    w = np.random.default_rng(0).normal(size=(1, 500))
    run = march(cascade_of(delay), 0.1, w, np.zeros(7), "first", 10)
    assert np.array_equal(run.outputs[0, 1:], w[0, 3:-7:10])
