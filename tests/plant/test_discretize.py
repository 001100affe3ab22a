"""Exact discretisation: against the exponential, closed-form answers, and its own group property."""

from __future__ import annotations

import itertools

import control
import numpy as np
import pytest
import scipy.linalg

from flexplant.errors import InputError
from flexplant.plant.discretize import discretize, mode_transitions, stacked_expm, step_of
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, state_space

DT = 3e-3


def modal(omega=(0.0, 1e-4, 0.3, 40.0, 900.0), zeta=(0.0, 0.5, 1.0, 0.01, 2.0)) -> ModalPlant:
    rng = np.random.default_rng(3)
    n = len(omega)
    return ModalPlant(
        omega=omega,
        zeta=zeta,
        shape_in=rng.normal(size=(n, 2)),
        shape_out=rng.normal(size=(2, n)),
        shape_out_acceleration=rng.normal(size=(2, n)),
        inputs=["a", "b"],
        outputs=["x", "y"],
    )


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_modal_and_dense_routes_agree(hold):
    a, b = discretize(modal(), DT, hold=hold), discretize(state_space(modal()), DT, hold=hold)
    for k in "ABCD":
        assert np.allclose(getattr(a, k), getattr(b, k), rtol=1e-11, atol=1e-13), k


def test_zero_hold_equals_the_exponential_of_the_augmented_matrix_and_scipy():
    s = state_space(modal())
    d = discretize(s, DT)
    n = s.n_states
    augmented = np.zeros((n + 2, n + 2))
    augmented[:n, :n], augmented[:n, n:] = s.A, s.B
    exponential = scipy.linalg.expm(augmented * DT)
    assert np.allclose(d.A, exponential[:n, :n], rtol=1e-10, atol=1e-12)
    assert np.allclose(d.B, exponential[:n, n:], rtol=1e-10, atol=1e-14)
    theirs = control.sample_system(control.ss(s.A, s.B, s.C, s.D), DT, method="zoh")
    assert np.allclose(d.A, theirs.A, rtol=1e-9, atol=1e-11)


def test_two_half_steps_are_one_step():
    half, whole = discretize(modal(), DT / 2), discretize(modal(), DT)
    assert np.allclose(half.A @ half.A, whole.A, rtol=1e-12, atol=1e-14)
    assert np.allclose(half.A @ half.B + half.B, whole.B, rtol=1e-12, atol=1e-16)


def test_double_integrator_is_exact_for_steps_and_ramps():
    plant = ModalPlant(omega=[0.0], zeta=[0.0], shape_in=[[1.0]], shape_out=[[1.0]], inputs=["f"], outputs=["x"])
    zero, first = discretize(plant, 0.1), discretize(plant, 0.1, hold="first")
    assert np.array_equal(zero.A, [[1.0, 0.1], [0.0, 1.0]])
    assert np.allclose(zero.B[:, 0], [0.005, 0.1], rtol=1e-15)
    x, t = np.zeros(2), 0.1 * np.arange(50)
    outputs = []
    for u in t:  # a ramp force u = t gives x = t^3 / 6 exactly
        outputs.append((first.C @ x + first.D @ [u]).item())
        x = first.A @ x + first.B @ [u]
    assert np.allclose(outputs, t**3 / 6, rtol=1e-12, atol=1e-16)


@pytest.mark.parametrize("zeta", [0.0, 0.005, 1.0, 1.7])
@pytest.mark.parametrize("omega", [0.5, 300.0, 5e4])
def test_free_motion_of_one_mode_is_the_closed_form(omega, zeta):
    plant = ModalPlant(omega=[omega], zeta=[zeta], shape_in=[[1.0]], shape_out=[[1.0]], inputs=["f"], outputs=["x"])
    d = discretize(plant, DT)
    root = np.sqrt(complex(zeta**2 - 1)) * omega
    poles = -zeta * omega + np.array([root, -root])
    if zeta == 1.0:
        e = np.exp(-omega * DT)
        expected = [[e * (1 + omega * DT), e * DT], [-(omega**2) * DT * e, e * (1 - omega * DT)]]
    else:
        p, q = poles
        ep, eq = np.exp(p * DT), np.exp(q * DT)
        expected = np.array([[p * eq - q * ep, ep - eq], [p * q * (eq - ep), p * ep - q * eq]]) / (p - q)
    scale = np.array([[1, 1 / max(omega, 1 / DT)], [max(omega, 1 / DT), 1]])
    assert abs((d.A - np.real(expected)) / scale).max() < 3e-11


def test_full_damping_goes_the_dense_way():
    Z = np.array([[0.4, 0.1], [0.1, 0.9]])
    plant = ModalPlant(
        omega=[3.0, 8.0], zeta=0.0, damping=Z, shape_in=[[1.0], [2.0]], shape_out=[[1.0, 1.0]], inputs=["f"], outputs=["x"]
    )
    assert np.allclose(discretize(plant, 0.1).A, scipy.linalg.expm(state_space(plant).A * 0.1), rtol=1e-12, atol=1e-14)


def test_names_and_sample_time_are_kept():
    d = discretize(modal(), DT, hold="first")
    assert (d.dt, d.inputs, d.outputs) == (DT, ("a", "b"), ("x", "y"))


@pytest.mark.parametrize("dt", [0.0, -1.0, np.nan, np.inf, "1", None, True])
def test_bad_sample_times(dt):
    with pytest.raises(InputError, match="sample time"):
        discretize(modal(), dt)


def test_bad_holds_and_discrete_plants():
    with pytest.raises(InputError, match=r"hold='firs' is not a choice.*'first'"):
        discretize(modal(), DT, hold="firs")
    with pytest.raises(InputError, match="discrete already"):
        discretize(discretize(modal(), DT), DT)
    static = StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)), ["u"], ["y"])
    assert discretize(static, DT).n_states == 0
    assert step_of(static, DT, "zero").hold.shape == (0, 1)


@pytest.mark.parametrize("zeta", [0.0, 1e-4, 0.3, 0.999999, 1.0, 1.000001, 1.5, 30.0])
def test_mode_transitions_in_extended_precision(zeta):
    """Against the exponential series in long double, scaled states, from rigid to fast and around critical damping."""
    for dt, omega in itertools.product((1e-3, 0.5), (0.0, 1e-6, 1e-3, 0.1, 3.0, 30.0, 600.0)):
        s = max(1.0, omega * dt)
        exponent = np.array([[0, s], [-((omega * dt) ** 2) / s, -2 * zeta * omega * dt]], dtype=np.longdouble)
        halvings = 8 + max(0, int(np.ceil(np.log2(float(abs(exponent).max()) + 1e-300))))
        series = term = np.eye(2, dtype=np.longdouble)
        for k in range(1, 25):
            term = term @ (exponent / np.longdouble(2) ** halvings) / k
            series = series + term
        for _ in range(halvings):
            series = series @ series
        found = mode_transitions(np.array([omega]), np.array([zeta]), dt)[0] * np.array([[1, s / dt], [dt / s, 1]])
        assert float(abs(series - found).max()) < 4e-16 * max(4, omega * dt) * (1 + zeta)


def test_many_small_exponentials_at_once():
    """Against scipy one by one, from tiny norms to ones that are halved many times; a nilpotent matrix is exact."""
    rng = np.random.default_rng(0)
    matrices = rng.normal(size=(60, 5, 5)) * np.logspace(-9, 1, 60)[:, None, None]
    expected = np.array([scipy.linalg.expm(matrix) for matrix in matrices])
    assert (abs(stacked_expm(matrices) - expected).max(axis=(1, 2)) <= 1e-12 * abs(expected).max(axis=(1, 2))).all()
    assert np.array_equal(stacked_expm(np.diag([1.0, 1.0], 1)[None])[0], [[1, 1, 0.5], [0, 1, 1], [0, 0, 1]])
    assert stacked_expm(np.zeros((0, 4, 4))).shape == (0, 4, 4)
