"""Reduction for chosen inputs and outputs: rankings, and bounds that truly bound."""

from __future__ import annotations

import control
import numpy as np
import pytest
from beam_systems import two_beams

from flexplant.errors import InputError, SolverError
from flexplant.plant.balanced import balanced_truncation, gramians, split_stable
from flexplant.plant.discretize import discretize
from flexplant.plant.modal import ModalPlant, modal_plant
from flexplant.plant.rigid_body import without_rigid_body
from flexplant.plant.state_space import StateSpace, state_space
from flexplant.plant.truncation import hankel_singular_values, peak_gains, reduce_modes
from flexplant.response.frequency import frequency_response
from flexplant.response.norms import hinf_norm, singular_values


def modal(n=12, *, zeta=0.01, kinds="dva", rigid=0, full=0.0, seed=0) -> ModalPlant:
    rng = np.random.default_rng(seed)
    omega = np.r_[np.zeros(rigid), np.sort(rng.uniform(5, 500, n - rigid))]
    damping = None
    if full:
        off = np.random.default_rng(9).normal(size=(n, n)) * full
        size = np.sqrt(2 * zeta * omega)
        damping = np.diag(2 * zeta * omega) + np.outer(size, size) * (off + off.T) / n
    shapes = {
        name: rng.normal(size=(2, n)) * scale if kind in kinds else None
        for kind, name, scale in zip(
            "dva", ("shape_out", "shape_out_velocity", "shape_out_acceleration"), (1, 1e-2, 1e-4), strict=True
        )
    }
    return ModalPlant(
        omega=omega,
        zeta=zeta,
        damping=damping,
        shape_in=rng.normal(size=(n, 3)),
        **shapes,
        inputs=list("abc"),
        outputs=list("xy"),
    )


@pytest.mark.parametrize("kinds", ["d", "v", "a", "dva"])
@pytest.mark.parametrize("zeta", [1e-4, 0.02, 0.9, 3.0])
def test_peak_gain_of_a_mode_is_its_norm(kinds, zeta):
    plant = modal(5, zeta=zeta, kinds=kinds)
    for i, peak in enumerate(peak_gains(plant)):
        one = reduce_modes_to(plant, i)
        assert hinf_norm(one).value == pytest.approx(peak, rel=1e-6)


def reduce_modes_to(plant: ModalPlant, i: int) -> ModalPlant:
    kinds = {k: getattr(plant, k) for k in ("shape_out", "shape_out_velocity", "shape_out_acceleration")}
    rows = {k: None if m is None else m[:, [i]] for k, m in kinds.items()}
    return ModalPlant(
        omega=plant.omega[[i]],
        zeta=plant.zeta[[i]],
        shape_in=plant.shape_in[[i]],
        **rows,
        inputs=plant.inputs,
        outputs=plant.outputs,
    )


@pytest.mark.parametrize("kinds", ["d", "v"])
def test_closed_form_hankel_values_are_exact_in_the_limit_of_light_damping(kinds):
    plant = modal(6, zeta=1e-5, kinds=kinds)
    s = state_space(plant)
    controllable, observable = gramians(s)
    exact = np.sort(np.sqrt(np.linalg.eigvals(controllable @ observable).real))[::-1]
    ours = np.sort(np.repeat(hankel_singular_values(plant), 2))[::-1]
    assert np.allclose(ours, exact, rtol=1e-3)


def test_hankel_values_with_full_damping_follow_the_gramians():
    light = modal(6, zeta=1e-4, kinds="d")
    full = modal(6, zeta=1e-4, kinds="d", full=1e-9)
    assert np.allclose(hankel_singular_values(light), hankel_singular_values(full), rtol=1e-2)


@pytest.mark.parametrize("static", [True, False])
@pytest.mark.parametrize("measure", ["peak", "hankel"])
@pytest.mark.parametrize("full", [0.0, 0.4])
@pytest.mark.parametrize("kinds", ["d", "dva"])
def test_error_bound_bounds_the_actual_error(static, measure, full, kinds):
    plant = modal(14, kinds=kinds, rigid=2 if not full else 0, full=full)
    reduced = reduce_modes(plant, keep=6, measure=measure, static_correction=static)
    hz = np.unique(np.r_[np.geomspace(1e-2, 1e4, 400), plant.frequency_hz[plant.n_rigid :]])
    error = frequency_response(plant, hz) - frequency_response(reduced, hz)
    worst = float(singular_values(error).max())
    assert 0 < worst <= reduced.report["error_bound"] * (1 + 1e-9)
    assert reduced.n_modes == 6 + plant.n_rigid
    if not full:
        assert reduced.report["error_bound"] < 14 * worst
        assert reduced.n_rigid == 2


def test_tolerance_limits_the_sum_of_what_is_dropped_and_static_gain_is_kept():
    plant = modal(20, kinds="d")
    reduced = reduce_modes(plant, tolerance=0.05)
    dropped = reduced.report["dropped"]
    gains = peak_gains(plant)
    assert dropped
    assert gains[dropped].sum() <= 0.05 * gains.max()
    kept = np.setdiff1d(np.arange(20), dropped)
    assert gains[dropped].max() <= gains[kept].min()
    assert np.allclose(frequency_response(plant, [0.0]), frequency_response(reduced, [0.0]), rtol=1e-12)
    assert reduce_modes(plant, tolerance=0.0).n_modes == 20


def test_reduction_requests_are_checked():
    plant = modal(4)
    for arguments, message in (
        ({}, "either tolerance or keep"),
        ({"tolerance": 0.1, "keep": 2}, "either tolerance or keep"),
        ({"tolerance": -1.0}, "not negative"),
        ({"keep": 5}, "has 4 flexible modes"),
        ({"keep": 2, "measure": "peek"}, "'peak'"),
    ):
        with pytest.raises(InputError, match=message):
            reduce_modes(plant, **arguments)


@pytest.mark.parametrize("dt", [None, 1e-3])
def test_balanced_truncation_bound_and_values(dt):
    continuous = state_space(modal(10, zeta=0.05))
    system = continuous if dt is None else discretize(continuous, dt)
    found = balanced_truncation(system, order=8)
    difference = StateSpace(
        np.block([[system.A, np.zeros((20, 8))], [np.zeros((8, 20)), found.plant.A]]),
        np.vstack([system.B, found.plant.B]),
        np.hstack([system.C, -found.plant.C]),
        system.D - found.plant.D,
        system.inputs,
        system.outputs,
        dt=dt,
    )
    assert 0 < hinf_norm(difference).upper <= found.error_bound
    assert hinf_norm(difference).value >= found.hankel_singular_values[8] * (1 - 1e-6)
    assert balanced_truncation(system, tolerance=1e-3).error_bound <= 1e-3 * found.hankel_singular_values[0]
    if dt is None:
        pytest.importorskip("slycot", reason="python-control needs it here; it has no wheels for this system")
        theirs = control.hankel_singular_values(control.ss(system.A, system.B, system.C, system.D))
        assert np.allclose(found.hankel_singular_values, np.sort(theirs)[::-1], rtol=1e-6)


def test_unstable_and_rigid_parts_survive_exactly():
    rng = np.random.default_rng(5)
    rigid = state_space(modal(9, rigid=1, zeta=0.02, kinds="d"))
    A = np.block([[rigid.A, rng.normal(size=(18, 1))], [np.zeros((1, 18)), 0.7]])
    system = StateSpace(
        A, np.vstack([rigid.B, np.ones((1, 3))]), np.hstack([rigid.C, np.ones((2, 1))]), rigid.D, list("abc"), list("xy")
    )
    stable, rest = split_stable(system)
    hz = np.geomspace(0.1, 100, 30)
    whole = frequency_response(system, hz).values
    parts = frequency_response(stable, hz).values + frequency_response(rest, hz).values
    assert abs(whole - parts).max() < 1e-9 * abs(whole).max()
    assert rest.n_states == 3
    found = balanced_truncation(system, order=3 + 8)
    assert found.n_unstable == 3
    error = abs(whole - frequency_response(found.plant, hz).values).max()
    assert error <= found.error_bound
    assert np.allclose(np.sort(np.linalg.eigvals(found.plant.A).real)[-1], 0.7, rtol=1e-9)


def test_balanced_truncation_requests_are_checked():
    system = state_space(modal(4))
    with pytest.raises(InputError, match="either order or tolerance"):
        balanced_truncation(system)
    with pytest.raises(InputError, match="order = 9"):
        balanced_truncation(system, order=9)
    with pytest.raises(InputError, match="tolerance must be"):
        balanced_truncation(system, tolerance=np.nan)
    with pytest.raises(SolverError, match="not stable"):
        gramians(StateSpace(np.eye(1), np.eye(1), np.eye(1), np.eye(1), ["u"], ["y"]))


@pytest.mark.parametrize("correction", [True, "modes"])
def test_the_report_counts_the_modes_that_are_left(correction):
    system = two_beams(damping=0.0)
    plant = modal_plant(
        system, inputs=["b.14.3"], outputs=["b.14.3"], n_modes=14, damping_ratio=0.01, static_correction=correction
    )
    for smaller in (reduce_modes(plant, keep=3), without_rigid_body(plant), without_rigid_body(reduce_modes(plant, keep=3))):
        report = smaller.report
        assert report["modes_kept"] + report["residual_modes"] == smaller.n_modes
        own = smaller.frequency_hz[: report["modes_kept"]]
        assert report["highest_frequency_hz"] == own.max()
        assert own.max() <= plant.report["highest_frequency_hz"]
