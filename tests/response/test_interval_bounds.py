"""Interval bounds: they bound what they say, and the norm they certify is the Hamiltonian one, also in the hard cases."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexplant.plant.discretize import discretize
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, state_space
from flexplant.response import modal_bound, norms
from flexplant.response.first_order import TransferFunction
from flexplant.response.frequency import frequency_response
from flexplant.response.interval_bound import bracket
from flexplant.response.modal_bound import ModalAxis
from flexplant.response.norms import _norm, hinf_norm, singular_values
from flexplant.response.pole_bound import PoleAxis
from flexplant.response.singular import stacked_singular_values

KINDS = ("shape_out", "shape_out_velocity", "shape_out_acceleration")


def modal(n=8, *, zeta=0.01, seed=0, kinds=("shape_out",), size=(2, 3)) -> ModalPlant:
    rng = np.random.default_rng(seed)
    shapes = {kind: rng.normal(size=(size[0], n)) for kind in kinds}
    return ModalPlant(
        omega=np.sort(rng.uniform(5, 500, n)),
        zeta=zeta,
        shape_in=rng.normal(size=(n, size[1])),
        **shapes,
        inputs=[f"u{k}" for k in range(size[1])],
        outputs=[f"y{k}" for k in range(size[0])],
    )


def one(omega, zeta, out, **more) -> ModalPlant:
    n = len(omega)
    return ModalPlant(
        omega=omega, zeta=zeta, shape_in=np.ones((n, 1)), shape_out=np.atleast_2d(out), inputs=["f"], outputs=["x"], **more
    )


@pytest.mark.parametrize("zeta", [1e-3, 0.1, 0.9, 1.0, 2.5])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("high", [False, True])
def test_the_curvature_bound_holds_and_is_not_wasteful(zeta, kind, high):
    """Second differences of the response inside random intervals, one mode: below the bound, and within ten times of it."""
    plant = modal(1, zeta=zeta, kinds=(kind,))
    axis = ModalAxis(plant, 2 * plant.omega[0], high)
    rng = np.random.default_rng(1)
    scale = axis.points[-1]
    a = np.sort(np.r_[rng.uniform(0, scale, 40), axis.points[1] * (1 + zeta * rng.normal(size=40))])
    a = a[(a > 0) & (a < scale)]
    length = 10 ** rng.uniform(-3, -1, a.size) * axis._tables["first"][0]
    bound, _ = axis.curvatures(a, a + length)
    step = 1e-3 * axis._tables["first"][0]
    for fraction in np.linspace(0, 1, 7):
        t = a + fraction * length
        second = sum(axis.responses(t + k * step) * c for k, c in ((-1, 1), (0, -2), (1, 1))) / step**2
        size = np.linalg.norm(second, axis=(0, 1))
        assert (size <= bound * (1 + 1e-3) + 1e-6 * bound.max()).all()
    # a displacement near its resonance: nothing else is far away to be overestimated
    if kind == "shape_out" and not high and zeta < 0.01:
        at = np.array([plant.omega[0]])
        found = sum(axis.responses(at + k * step) * c for k, c in ((-1, 1), (0, -2), (1, 1))) / step**2
        assert axis.curvatures(at, at)[0] < 10 * np.linalg.norm(found)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("zeta", [1e-6, 1e-3, 0.05, 0.6, 1.0, 3.0])
@pytest.mark.parametrize("kinds", [("shape_out",), ("shape_out_velocity",), ("shape_out_acceleration",), KINDS])
def test_certified_norm_is_the_hamiltonian_one(seed, zeta, kinds):
    plant = modal(10, zeta=zeta, seed=seed, kinds=kinds)
    found, hamiltonian = hinf_norm(plant), _norm(state_space(plant), 1e-9)
    assert found.value == pytest.approx(hamiltonian.value, rel=1e-8)
    assert found.lower <= found.upper <= found.lower * (1 + 1.1e-7)
    assert hamiltonian.value <= found.upper * (1 + 1e-12)
    assert found.certificate.startswith("interval bounds")


def test_two_nearly_equal_peaks():
    """Peaks 1e-7 apart in height and a decade apart in frequency: the higher one wins, whichever it is."""
    for sign in (1, -1):
        ratio = 100 * (1 + sign * 1e-7)  # peak of a light mode is 1 / (2 zeta omega^2)
        plant = one([10.0, 100.0], 1e-4, [1.0, ratio])
        found = hinf_norm(plant, tolerance=1e-10)
        fine = plant.omega[:, None] / (2 * np.pi) * (1 + np.linspace(-1e-5, 1e-5, 2001))
        peaks = [float(abs(frequency_response(plant, hz).values).max()) for hz in fine]
        assert found.value == pytest.approx(max(peaks), rel=1e-9)
        assert found.frequency_hz == pytest.approx(plant.frequency_hz[int(np.argmax(peaks))], rel=1e-6)
        assert found.upper <= found.lower * (1 + 1e-9)


def test_static_maximum_repeated_modes_and_a_sharp_peak_beside_a_flat_one():
    static = hinf_norm(one([10.0], 0.9, [1.0]))
    assert (static.value, static.frequency_hz) == (pytest.approx(0.01, rel=1e-12), 0.0)
    single, twice = hinf_norm(one([10.0], 0.01, [2.0])), hinf_norm(one([10.0, 10.0], 0.01, [1.0, 1.0]))
    assert twice.value == pytest.approx(single.value, rel=1e-12)
    cancelled = hinf_norm(one([10.0, 10.0, 20.0], 0.01, [1.0, -1.0, 1e-3]))
    assert cancelled.value == pytest.approx(hinf_norm(one([20.0], 0.01, [1e-3])).value, rel=1e-8)
    needle = hinf_norm(one([10.0, 77.7], [0.5, 1e-7], [1.0, 1e-4]))
    assert needle.frequency_hz == pytest.approx(77.7 / (2 * np.pi), rel=1e-6)
    assert needle.value == pytest.approx(1e-4 / (2e-7 * 77.7**2), rel=1e-3)


def test_the_top_at_infinite_frequency():
    plant = one([10.0], 2.0, np.zeros((1, 1)), shape_out_acceleration=[[1.0]])
    found = hinf_norm(plant)
    assert found.value == pytest.approx(1.0, rel=1e-12)
    assert found.frequency_hz == np.inf


def test_thousands_of_states():
    plant = modal(1500, zeta=0.002, kinds=("shape_out_acceleration",), size=(6, 6))
    found = hinf_norm(plant)
    hz = np.unique(np.r_[plant.frequency_hz, np.linspace(0.1, 120, 20_001)])
    assert float(singular_values(plant, hz).max()) <= found.upper
    assert found.upper <= found.lower * (1 + 1.1e-7)
    assert float(singular_values(plant, [found.frequency_hz]).max()) == pytest.approx(found.value, rel=1e-9)


def test_a_spent_budget_still_gives_a_bracket():
    plant = modal(40, zeta=1e-3)
    axes = [ModalAxis(plant, 2 * plant.omega[-1], high) for high in (False, True)]
    found = bracket(axes, 1e-9, budget=10)[0]
    exact = hinf_norm(plant)
    assert found.lower <= exact.value <= found.upper
    assert found.upper > found.lower * (1 + 1e-9)


@pytest.mark.parametrize("shape", [(1, 4), (4, 1), (2, 2), (2, 5), (5, 2), (3, 3), (6, 6)])
def test_singular_values_in_closed_form_are_lapacks(shape):
    rng = np.random.default_rng(0)
    G = rng.normal(size=(*shape, 200)) + 1j * rng.normal(size=(*shape, 200))
    G[:, :, 0] = 0
    G[:, :, 1] = 1.0  # rank one
    G[:, 0, 2] = 0
    G[:, :, 3:50] *= 10.0 ** rng.integers(-100, 100, 47)
    G[0, :, 50:60] *= 1e-9
    expected = np.linalg.svd(G.transpose(2, 0, 1), compute_uv=False)
    found = stacked_singular_values(G)
    assert found.shape == expected.shape
    assert (abs(found - expected) <= 1e-14 * expected[:, :1]).all()


@pytest.fixture
def no_hamiltonian(monkeypatch):
    """Small state spaces go the way of large ones."""
    monkeypatch.setattr(norms, "CERTIFIED_STATES", 0)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("zeta", [1e-5, 0.05, 3.0])
@pytest.mark.parametrize("dt", [None, 2e-3])
def test_poles_and_residues_certify_the_same_norm(monkeypatch, seed, zeta, dt):
    system = state_space(modal(8, zeta=zeta, seed=seed, kinds=KINDS))
    system = system if dt is None else discretize(system, dt)
    exact = hinf_norm(system)
    monkeypatch.setattr(norms, "CERTIFIED_STATES", 0)
    found = hinf_norm(system)
    assert found.certificate.startswith("interval bounds (poles and residues")
    assert found.value == pytest.approx(exact.value, rel=1e-7)
    assert exact.value <= found.upper * (1 + 1e-9)
    assert found.upper <= found.lower * (1 + 1.1e-7)


def test_full_damping_and_badly_conditioned_poles(no_hamiltonian):
    rng = np.random.default_rng(0)
    plant = modal(12, zeta=0.02)
    mixing = rng.normal(size=(12, 12))
    full = replace(plant, damping=np.diag(2 * plant.zeta * plant.omega) + 0.05 * mixing @ mixing.T)
    found = hinf_norm(full)
    hz = np.linspace(0.1, 120, 40_001)
    assert float(singular_values(full, hz).max()) <= found.upper
    assert found.certificate.startswith("interval bounds (poles and residues")
    jordan = StateSpace(-np.eye(3) + np.eye(3, k=1) * 100, np.eye(3)[:, 2:], np.eye(3)[:1], np.zeros((1, 1)), ["u"], ["y"])
    alone = hinf_norm(jordan)
    assert (alone.certificate, alone.upper) == ("", np.inf)
    assert alone.value == pytest.approx(1e4, rel=1e-6)


class Parabola:
    """1 - (t - 1/2)^2 on [0, 1], with its exact curvature."""

    points = np.array([0.0, 1.0])

    def gains(self, t):
        return 1 - (t - 0.5) ** 2

    def curvatures(self, a, _b):
        return np.full(a.size, 2.0), np.zeros(a.size, dtype=np.int64)

    def between(self, a, b, fraction, _pole):
        return a + fraction * (b - a)


def test_the_bound_is_exact_for_a_parabola():
    """(b - a)^2 / 8 times the curvature, no less and no more: undivided, the interval gives the top itself."""
    found = bracket([Parabola()], 1e-9, budget=0)[0]
    assert (found.lower, found.upper) == (0.75, pytest.approx(1.0, rel=1e-15))
    assert bracket([Parabola()], 1e-9)[0].upper == pytest.approx(1.0, rel=1e-8)


@pytest.mark.parametrize("high", [False, True])
def test_the_bound_of_one_pole_is_exact_beside_it(high):
    """A first-order lag: |G''| at the end next to the pole is the bound itself, and no chord is farther off than it allows."""
    lag = TransferFunction(StateSpace([[-3.0]], [[2.0]], [[1.5]], [[0.2]], ["u"], ["y"]))
    axis = PoleAxis(lag, lag.residues, 6.0, high)
    t = np.linspace(0.0, axis.points[-1], 9)
    a, b = t[:-1], t[1:]
    s = (lambda x: 1j / x) if high else (lambda x: 1j * x)
    inside = a + 0.5 * (b - a)
    ends = [lag(s(np.maximum(x, 1e-12)))[0, 0] for x in (a, b)]
    off = abs(lag(s(inside))[0, 0] - 0.5 * (ends[0] + ends[1]))
    bound = axis.curvatures(a, b)[0] * (b - a) ** 2 / 8
    assert (off <= bound * (1 + 1e-9)).all()
    exact = 2 * 3.0 / abs(1j * a + 3) ** 3
    if high:
        exact = abs((lambda x, h: (lag(s(x + h)) - 2 * lag(s(x)) + lag(s(x - h)))[0, 0] / h**2)(b, 1e-4))
        assert (exact <= axis.curvatures(a, b)[0] * (1 + 1e-5)).all()
    else:
        assert axis.curvatures(a, b)[0] == pytest.approx(exact, rel=1e-12)


def test_the_bound_of_a_light_pole_holds_up_to_the_edge_of_the_upper_axis():
    """There t / d^3 and 1 / d^2 are equal shares of it."""
    light = TransferFunction(StateSpace([[0.0, 1.0], [-9.0, -0.02]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]], ["u"], ["y"]))
    axis = PoleAxis(light, light.residues, 6.0, high=True)
    end, h = np.array([1 / 6.0]), 1e-4
    values = [light(1j / (end + k * h))[0, 0] for k in (-1, 0, 1)]
    exact = abs(values[0] - 2 * values[1] + values[2]) / h**2
    bound = axis.curvatures(end, end)[0]
    assert exact <= bound * (1 + 1e-4)
    assert axis.curvatures(end, end)[0] < 2 * exact


@pytest.mark.parametrize("high", [False, True])
@pytest.mark.parametrize("kinds", [("shape_out",), KINDS])
def test_bounds_shared_by_neighbouring_intervals_cover_those_of_each_alone(kinds, high):
    """The compiled sums take modes far from sixteen intervals together: not below each interval's own bound, and not twice it."""
    axis = ModalAxis(modal(60, kinds=kinds), 1000.0, high)
    rng = np.random.default_rng(0)
    ends = np.unique(np.r_[axis.points, rng.uniform(0, axis.points[-1], 300)])
    for a, b in ((ends[:-1], ends[1:]), (ends[5:6], ends[6:7]), (ends[40:53], ends[41:54])):
        found, entries = [axis.curvatures(a, b)], [axis.entry_curvatures(a, b)]
        for form in ("fallback", "loops"):
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(modal_bound, "curvature", getattr(modal_bound.curvature, form))
                patch.setattr(modal_bound, "entry_curvature", getattr(modal_bound.entry_curvature, form))
                found.append(axis.curvatures(a, b))
                entries.append(axis.entry_curvatures(a, b))
        for shared, alone, plain in ([bound for bound, _ in found], entries):
            assert shared == pytest.approx(plain, rel=1e-12)
            assert (shared >= alone * (1 - 1e-12)).all()
            assert (shared <= 2 * alone).all()
        assert (found[0][1] == found[1][1]).mean() > 0.9


@pytest.mark.parametrize("zeta", [1e-5, 1e-3, 0.05, 0.3])
def test_the_top_of_a_peak_is_met_to_round_off(zeta):
    """One mode: 1 / (2 zeta sqrt(1 - zeta^2) w^2) at w sqrt(1 - 2 zeta^2)."""
    found = hinf_norm(one([7.0], zeta, [1.0]))
    assert found.value == pytest.approx(1 / (2 * zeta * np.sqrt(1 - zeta**2) * 49.0), rel=4e-15 / min(zeta * 1e3, 1.0))
    assert 2 * np.pi * found.frequency_hz == pytest.approx(7.0 * np.sqrt(1 - 2 * zeta**2), rel=1e-7 * zeta)
