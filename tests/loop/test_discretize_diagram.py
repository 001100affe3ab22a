"""Diagrams as one discrete state space: against their simulation, and against blocks discretised by hand."""

from __future__ import annotations

import numpy as np
import pytest

import flexplant as fp
from flexplant.blocks.basic import gain
from flexplant.blocks.sampled import saturation
from flexplant.blocks.transfer_function import transfer_function
from flexplant.errors import DiagramError, InputError
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.discretize import discretize
from flexplant.loop.hybrid import hybrid_of
from flexplant.loop.monodromy import multipliers
from flexplant.loop.simulate import simulate
from flexplant.plant.modal import ModalPlant

T = 1e-3
PLANT = ModalPlant(
    omega=[0.0, 150.0, 700.0, 3000.0],
    zeta=0.02,
    shape_in=[[1.0, 0.3], [0.8, -1.0], [-0.5, 0.4], [1.0, 1.0]],
    shape_out=[[1.0, 0.8, -0.5, 1.0], [0.3, -1.0, 0.4, 1.0]],
    shape_out_acceleration=np.diag([1.0, 0.0])[:, [0, 1, 1, 1]] * 1e-6,
    inputs=["f", "d"],
    outputs=["y", "z"],
    input_units=["N", "N"],
)
LAG = transfer_function([1.0], [2e-3, 1.0])


def loop(fast, slow=None) -> Diagram:
    """d -> plant -> y -> lag -> fast -> f, with z -> slow -> the lag's input beside y."""
    blocks = {"plant": PLANT, "sum": fp.summing_junction("++"), "lag": LAG, "fast": fast, "slow": slow or gain(0.0)}
    wires = [("plant.y", "sum.in1"), ("sum.sum", "lag.u"), ("lag.y", "fast.u"), ("fast.y", "plant.f")]
    wires += [("plant.z", "slow.u"), ("slow.y", "sum.in2")]
    outputs = {"y": "plant.y", "held": "fast.y", "sum": "sum.sum"}
    return Diagram(blocks=blocks, connections=wires, inputs={"d": "plant.d"}, outputs=outputs, name="loop")


def law(dt, size=500.0):
    return transfer_function([-size, 0.9 * size], [1.0, -0.4], dt=dt)


CASES = {
    "one rate": (loop(law(T)), T, T),
    "every third sample": (loop(law(T)), T, 3 * T),
    "two rates": (loop(law(2 * T, 200.0), law(3 * T, 0.1)), T, 6 * T),
    "continuous": (loop(transfer_function([-50.0, -1.0], [1e-3, 1.0])), T, T),
    "all digital": (Diagram(blocks={"law": law(T)}, inputs={"d": "law.u"}, outputs={"y": "law.y"}), T, 2 * T),
}


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("name", list(CASES))
def test_the_discrete_system_moves_as_the_simulation(name, hold):
    """Inputs that are steps, or straight, over each dt, seen at its first sample; from rest, where x - G1 u is zero, too."""
    diagram, base, dt = CASES[name]
    every, periods = round(dt / base), 40
    d = np.r_[0.0, np.random.default_rng(1).normal(size=periods)]
    fine = np.repeat(d, every) if hold == "zero" else np.interp(np.arange(periods * every + 1) / every, np.arange(periods + 1), d)
    kind = "zero" if name == "all digital" else hold
    run = simulate(diagram, np.arange(periods * every) * base, fine[: periods * every], hold=kind, every=every, unstable="allow")
    system = discretize(diagram, dt, hold=hold)
    x, y = np.zeros(system.n_states), []
    for k in range(periods):
        y.append(system.C @ x + system.D @ d[[k]])
        x = system.A @ x + system.B @ d[[k]]
    assert abs(run.outputs.values.T - np.array(y)).max() < 1e-10 * abs(np.array(y)).max()
    assert system.dt == pytest.approx(dt)
    assert system.input_units == tuple(diagram.input_units)
    assert list(system.outputs) == list(diagram.outputs)


def test_poles_are_the_multipliers_and_states_those_of_close():
    diagram, base, dt = CASES["two rates"]
    system = discretize(diagram, dt)
    found, expected = np.linalg.eigvals(system.A), multipliers(hybrid_of(diagram), base, 6)
    assert abs(found[:, None] - expected).min(axis=1).max() < 1e-9
    continuous = CASES["continuous"][0]
    exact = fp.discretize(close(continuous), T)
    assert abs(discretize(continuous, T).A - exact.A).max() <= 1e-11 * abs(exact.A).max()


def test_discrete_diagrams_close_as_they_are():
    digital = CASES["all digital"][0]
    assert np.array_equal(discretize(digital, T).A, close(digital).A)


@pytest.mark.parametrize(
    ("diagram", "dt", "error", "message"),
    [
        (
            loop(law(T)),
            0.4 * T,
            InputError,
            r"dt = 0.0004 s, but the samples.*fast: 0.001 s.*repeat every 0.001 s.*whole multiple",
        ),
        (loop(law(T)), 1.5 * T, InputError, "whole multiple of that time"),
        (CASES["two rates"][0], 2 * T, InputError, r"fast: 0.002 s, slow: 0.003 s.*repeat every 0.006 s.*their common period"),
        (loop(law(T), law(np.e * T)), T, InputError, "no common period of at most 1000 steps"),
        (loop(law(T)), -T, InputError, "positive, finite number of seconds"),
        (loop(law(T)), None, InputError, "positive, finite number of seconds"),
        (loop(saturation(-1, 1)), T, DiagramError, "nonlinear blocks .fast."),
    ],
)
def test_sample_times_that_have_no_discrete_form(diagram, dt, error, message):
    with pytest.raises(error, match=message) as caught:
        discretize(diagram, dt)
    assert "\n" not in str(caught.value)


def test_unknown_hold():
    with pytest.raises(InputError, match="hold"):
        discretize(loop(law(T)), T, hold="cubic")
