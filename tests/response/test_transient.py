"""Time simulation: exact answers at any step, agreement of modal and dense routes, superposition, bad input."""

from __future__ import annotations

import control
import numpy as np
import pytest
import xarray as xr
from stepwise_simulation import BLOCK, simulate

from flexplant.errors import InputError
from flexplant.plant.discretize import discretize
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import state_space


def modal(n=6, rigid=1) -> ModalPlant:
    rng = np.random.default_rng(4)
    return ModalPlant(
        omega=np.r_[np.zeros(rigid), np.sort(rng.uniform(5, 300, n - rigid))],
        zeta=0.02,
        shape_in=rng.normal(size=(n, 2)),
        shape_out=rng.normal(size=(2, n)),
        shape_out_acceleration=rng.normal(size=(2, n)),
        inputs=["f", "g"],
        outputs=["x", "y"],
        output_units=["m", "m"],
    )


def sdof(omega=7.0, zeta=0.05) -> ModalPlant:
    return ModalPlant(omega=[omega], zeta=[zeta], shape_in=[[1.0]], shape_out=[[1.0]], inputs=["f"], outputs=["x"])


def test_step_response_is_exact_at_coarse_steps():
    t = np.arange(200) * 0.4
    wd = 7 * np.sqrt(1 - 0.05**2)
    expected = (1 - np.exp(-0.35 * t) * (np.cos(wd * t) + 0.35 / wd * np.sin(wd * t))) / 49
    found = simulate(sdof(), t, {"f": 1.0})["outputs"].values[0]
    assert np.allclose(found, expected, rtol=0, atol=1e-15)


def test_ramp_response_with_first_order_hold_is_exact():
    t = np.arange(100) * 0.3
    found = simulate(sdof(zeta=0.0), t, {"f": t}, hold="first")["outputs"].values[0]
    assert np.allclose(found, (t - np.sin(7 * t) / 7) / 49, rtol=0, atol=1e-14)


def test_rigid_body_under_constant_force_is_a_parabola():
    t = np.arange(1000) * 0.1
    found = simulate(sdof(omega=0.0), t, {"f": 2.0})
    assert np.allclose(found["outputs"].values[0], t**2, rtol=1e-12)
    assert found["final_state"].values == pytest.approx([t[-1] ** 2, 2 * t[-1]], rel=1e-12)


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("nt", [2, 300, BLOCK, BLOCK + 1, 2 * BLOCK + 5])
def test_modal_and_dense_routes_agree_across_blocks(hold, nt):
    t = np.arange(nt) * 1e-3
    u = np.random.default_rng(0).normal(size=(2, nt))
    start = np.random.default_rng(1).normal(size=12)
    a = simulate(modal(), t, u, hold=hold, initial_state=start)
    b = simulate(state_space(modal()), t, u, hold=hold, initial_state=start)
    assert np.allclose(a["outputs"], b["outputs"], rtol=0, atol=1e-9 * float(abs(b["outputs"]).max()))
    assert np.allclose(a["final_state"], b["final_state"], rtol=1e-8, atol=1e-9)


def test_python_control_simulates_the_same():
    t = np.arange(400) * 1e-3
    u = np.sin(40 * t)[None, :] * np.array([[1.0], [0.5]])
    s = state_space(modal())
    theirs = control.forced_response(control.ss(s.A, s.B, s.C, s.D), t, u).outputs  # first-order hold
    ours = simulate(modal(), t, u, hold="first")["outputs"].values
    assert np.allclose(ours, theirs, rtol=0, atol=1e-9 * abs(theirs).max())


def test_restarting_from_the_final_state_continues():
    t = np.arange(500) * 1e-3
    u = np.random.default_rng(2).normal(size=(2, 500))
    whole = simulate(modal(), t, u)
    first = simulate(modal(), t[:201], u[:, :201])
    rest = simulate(modal(), t[200:], u[:, 200:], initial_state=first["final_state"])
    assert np.allclose(rest["outputs"], whole["outputs"][:, 200:], rtol=1e-12, atol=1e-12)


def test_discrete_plants_advance_by_their_own_step():
    t = np.arange(300) * 1e-3
    u = np.random.default_rng(2).normal(size=(2, 300))
    discrete = discretize(modal(), 1e-3)
    a, b = simulate(discrete, t, u), simulate(modal(), t, u)
    assert np.allclose(a["outputs"], b["outputs"], rtol=0, atol=1e-11 * float(abs(b["outputs"]).max()))
    with pytest.raises(InputError, match=r"dt = 0.001 s, but time advances by 0.002"):
        simulate(discrete, 2 * t, u)


def test_full_damping_and_labels():
    plant = ModalPlant(
        omega=[3.0, 8.0],
        zeta=0.0,
        damping=[[0.4, 0.1], [0.1, 0.9]],
        shape_in=np.eye(2),
        shape_out=np.eye(2),
        inputs=["f", "g"],
        outputs=["x", "y"],
        output_units=["m", "m"],
    )
    t = np.arange(50) * 0.01
    signal = xr.DataArray(np.ones((50, 1)), dims=("time", "input"), coords={"input": ["g"]})
    found = simulate(plant, t, signal)
    assert found["outputs"].sel(output="y").shape == (50,)
    assert list(found["output_units"].values) == ["m", "m"]
    assert (found["inputs"].sel(input="f") == 0).all()
    assert np.allclose(found["outputs"], simulate(plant, t, {"g": 1.0})["outputs"])


def test_free_decay_needs_no_inputs():
    found = simulate(sdof(), np.arange(20) * 0.1, initial_state=[1.0, 0.0])
    assert found["outputs"].values[0, 0] == 1.0


@pytest.mark.parametrize(
    ("time", "inputs", "message"),
    [
        ([0.0, 0.1, 0.3], None, "not uniform"),
        ([0.0, -0.1], None, "not uniform and increasing"),
        ([0.0], None, "at least two"),
        ([0.0, np.nan], None, "finite"),
        ([0.0, 0.1], {"ff": 1.0}, r"no input 'ff'.*'f'"),
        ([0.0, 0.1], {"f": [1.0, 2.0, 3.0]}, r"shape \(3,\), but one number or \(2,\)"),
        ([0.0, 0.1], np.ones((3, 2)), r"shape \(3, 2\), but \(2 inputs, 2 instants\)"),
        ([0.0, 0.1], {"g": [1.0, np.nan]}, r"'g' has values that are not finite"),
        ([0.0, 0.1], xr.DataArray([1.0, 2.0], dims="time"), "dims input and time"),
    ],
)
def test_bad_time_and_inputs(time, inputs, message):
    with pytest.raises(InputError, match=message):
        simulate(modal(), time, inputs)


def test_bad_state_and_hold():
    with pytest.raises(InputError, match="12 finite numbers"):
        simulate(modal(), [0.0, 0.1], initial_state=[1.0])
    with pytest.raises(InputError, match="is not a choice"):
        simulate(modal(), [0.0, 0.1], hold="second")
