"""H-infinity norms against closed forms and slycot, singular values, and the honesty of bounds."""

from __future__ import annotations

import numpy as np
import pytest

from flexplant.errors import InputError
from flexplant.loop.random import random_response
from flexplant.plant.discretize import discretize
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, state_space
from flexplant.response.frequency import frequency_response
from flexplant.response.margins import bandwidth_hz
from flexplant.response.norms import hinf_norm, singular_values


def modal(n=8, *, zeta=0.01, rigid=0, seed=0, kinds=("shape_out",)) -> ModalPlant:
    rng = np.random.default_rng(seed)
    omega = np.r_[np.zeros(rigid), np.sort(rng.uniform(5, 500, n - rigid))]
    shapes = {kind: rng.normal(size=(2, n)) for kind in kinds}
    return ModalPlant(omega=omega, zeta=zeta, shape_in=rng.normal(size=(n, 3)), **shapes, inputs=list("abc"), outputs=list("xy"))


@pytest.mark.parametrize("zeta", [1e-5, 0.01, 0.5, 0.9])
def test_peak_of_one_mode_is_the_closed_form(zeta):
    plant = ModalPlant(omega=[30.0], zeta=[zeta], shape_in=[[2.0]], shape_out=[[1.0]], inputs=["f"], outputs=["x"])
    found = hinf_norm(plant)
    overdamped = zeta > np.sqrt(0.5)
    peak = 2 / 900 if overdamped else 1 / (900 * zeta * np.sqrt(1 - zeta**2))
    at = 0.0 if overdamped else 30 * np.sqrt(1 - 2 * zeta**2) / (2 * np.pi)
    assert found.value == pytest.approx(peak, rel=1e-9)
    assert found.frequency_hz == pytest.approx(at, rel=1e-6)
    assert found.lower <= peak * (1 + 1e-12)
    assert found.upper >= peak
    assert found.upper <= peak * (1 + 1e-6)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("dt", [None, 1e-3])
def test_slycot_finds_the_same_norm(seed, dt):
    slycot = pytest.importorskip("slycot", reason="has no wheels for this system")
    s = state_space(modal(seed=seed, zeta=[0.3, 1e-3][seed % 2], kinds=("shape_out", "shape_out_velocity")))
    s = s if dt is None else discretize(s, dt)
    found = hinf_norm(s)
    n = s.n_states
    theirs, _ = slycot.ab13dd("C" if dt is None else "D", "I", "N", "D", n, 3, 2, s.A, np.eye(n), s.B, s.C, s.D, 1e-9)
    assert found.value == pytest.approx(theirs, rel=1e-6)
    at = singular_values(s, [found.frequency_hz])
    assert at.values.max() == pytest.approx(found.value, rel=1e-9)


def test_two_close_peaks_are_not_confused():
    plant = ModalPlant(
        omega=[10.0, 10.001], zeta=1e-5, shape_in=[[1.0], [1.0]], shape_out=[[1.0, 1.02]], inputs=["f"], outputs=["x"]
    )
    hz = 10 / (2 * np.pi) * np.linspace(0.999, 1.0012, 400001)
    grid = abs(frequency_response(plant, hz).values).max()
    found = hinf_norm(plant)
    assert grid * (1 - 1e-7) <= found.value <= grid * (1 + 1e-4)
    assert found.upper <= found.value * (1 + 1e-6)


def test_gain_at_infinite_frequency_and_static_gains():
    high_pass = StateSpace(-np.eye(1), np.eye(1), -np.eye(1), np.eye(1), ["u"], ["y"])
    assert hinf_norm(high_pass).upper == pytest.approx(1.0, rel=1e-6)
    static = StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((2, 0)), [[3.0], [4.0]], ["u"], ["y", "z"])
    assert hinf_norm(static).value == pytest.approx(5.0)
    zero = StateSpace(-np.eye(1), np.zeros((1, 1)), np.eye(1), np.zeros((1, 1)), ["u"], ["y"])
    assert hinf_norm(zero).value == 0.0


def test_unbounded_norms_are_explained():
    rigid = hinf_norm(modal(rigid=2))
    assert (rigid.value, rigid.frequency_hz) == (np.inf, 0.0)
    assert "rigid-body" in rigid.explanation
    undamped = hinf_norm(modal(zeta=np.r_[[0.01] * 7, 0.0]))
    assert undamped.frequency_hz == pytest.approx(modal().frequency_hz[7])
    unstable = StateSpace(np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)), ["u"], ["y"])
    assert "unstable" in hinf_norm(unstable).explanation
    assert "0 Hz" in hinf_norm(state_space(modal(rigid=1))).explanation
    with pytest.raises(InputError, match="is infinite: rigid-body"):
        hinf_norm(modal(rigid=2), unbounded="error")
    for bad in ("fine", np.nan, 0.0, -1e-6):
        with pytest.raises(InputError, match="tolerance is relative, between 0 and 1"):
            hinf_norm(modal(), tolerance=bad)
    with pytest.raises(InputError, match="'error'"):
        hinf_norm(modal(), unbounded="eror")


def test_rigid_body_accelerations_are_bounded():
    plant = modal(rigid=2, kinds=("shape_out_acceleration",))
    found = hinf_norm(plant)
    hz = np.sort(np.r_[0.0, np.geomspace(0.1, 1e4, 3000), plant.frequency_hz[2:]])
    assert float(singular_values(plant, hz).max()) <= found.upper
    assert found.upper < found.value * (1 + 1e-6)


def test_large_modal_plants_get_true_bounds():
    plant = modal(230, zeta=0.005)
    found = hinf_norm(plant)
    hz = np.unique(np.r_[plant.frequency_hz, np.geomspace(0.1, 200, 4000)])
    assert float(singular_values(plant, hz).max()) <= found.value * (1 + 1e-9)
    assert found.value <= found.upper < 1.5 * found.value


def test_singular_values_of_a_diagonal_plant_are_its_gains():
    plant = ModalPlant(
        omega=[10.0, 20.0], zeta=0.1, shape_in=np.eye(2), shape_out=np.eye(2), inputs=["a", "b"], outputs=["x", "y"]
    )
    response = frequency_response(plant, [1.0, 2.0, 5.0])
    values = singular_values(response)
    assert values.dims == ("frequency", "index")
    gains = np.sort(abs(np.diagonal(response.values, axis1=0, axis2=1)), axis=1)[:, ::-1]
    assert np.allclose(values, gains, rtol=1e-12)
    with pytest.raises(InputError, match="frequency_hz"):
        singular_values(plant)
    with pytest.raises(InputError, match="dims are"):
        singular_values(response.isel(frequency=0))


def test_the_largest_gain_of_a_discrete_system_may_stand_at_the_nyquist_frequency():
    """y[k+1] = -0.5 y[k] + u[k]: |1 / (z + 0.5)| is largest at z = -1, where it is 2."""
    alternating = StateSpace([[-0.5]], [[1.0]], [[1.0]], [[0.0]], ["u"], ["y"], dt=0.01)
    found = hinf_norm(alternating)
    assert found.value == pytest.approx(2.0, rel=1e-9)
    assert found.frequency_hz == pytest.approx(50.0)
    assert found.upper == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize("order", [1, 2])
def test_integrators_have_no_norm(order):
    """1 / s and 1 / s^2, continuous and sampled: all poles at the origin, so that nothing else sets a scale."""
    chain = StateSpace(np.eye(order, k=1), np.eye(order)[:, [-1]], np.eye(order)[:1], [[0.0]], ["u"], ["y"])
    for system in (chain, discretize(chain, 1e-3)):
        found = hinf_norm(system)
        assert (found.value, found.frequency_hz) == (np.inf, 0.0)
        assert "0 Hz" in found.explanation
    unseen = StateSpace([[0.0]], [[1.0]], [[0.0]], [[2.0]], ["u"], ["y"])
    assert hinf_norm(unseen).value == 2.0


@pytest.mark.parametrize("damping", [None, [[0.2, 0.1], [0.1, 0.4]]])
@pytest.mark.parametrize(("nu", "ny"), [(0, 1), (2, 0)])
def test_plants_without_channels_have_empty_responses_and_no_gain(damping, nu, ny):
    names = {"inputs": ["f", "g"][:nu], "outputs": ["y"][:ny]}
    plant = ModalPlant(omega=[9, 20], zeta=0.01, damping=damping, shape_in=np.ones((2, nu)), shape_out=np.ones((ny, 2)), **names)
    hz = np.geomspace(0.1, 10, 20)
    for form in (plant, state_space(plant)):
        assert frequency_response(form, hz).shape == (ny, nu, 20)
        assert hinf_norm(form).value == 0.0
        assert random_response(form, np.zeros((nu, nu, 20)), hz).rms.values.tolist() == [0.0] * ny
        with pytest.raises(InputError, match="gain at 0 Hz is zero"):
            bandwidth_hz(form)
