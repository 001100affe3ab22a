"""Margins, crossings and bandwidths against closed forms, python-control and the published steering-mirror loop."""

from __future__ import annotations

import control
import numpy as np
import pytest

from flexplant.errors import InputError
from flexplant.plant.conversion import from_control
from flexplant.plant.discretize import discretize
from flexplant.plant.state_space import StateSpace
from flexplant.response.crossings import crossings, refined_grid
from flexplant.response.frequency import frequency_response
from flexplant.response.margins import (
    HALF_POWER_DB,
    _broken,
    bandwidth_hz,
    complementary_sensitivity,
    crossing_hz,
    margins,
    sensitivity,
)


def loop(numerator, denominator) -> StateSpace:
    return from_control(control.ss(control.tf(numerator, denominator)), inputs=["e"], outputs=["y"])


def mirror(gain=1800.0, wF=100.0, xi=0.3) -> StateSpace:
    return loop([gain * wF**2], [1, 2 * xi * wF, wF**2])


def test_published_steering_mirror_loop():
    found = margins(mirror())
    assert found.stable
    assert found.phase_margin_deg == pytest.approx(0.8105, abs=5e-4)
    assert found.complementary_peak.frequency_hz == pytest.approx(675.4, rel=1e-4)
    assert bandwidth_hz(complementary_sensitivity(mirror())) == pytest.approx(1049.4, rel=1e-4)
    assert crossing_hz(sensitivity(mirror()), HALF_POWER_DB) == pytest.approx([434.8], rel=2e-4)
    assert found.gain_margin_db == np.inf


def test_mirror_loop_margins_are_the_closed_form():
    """|L| = 1: (w^2 - wF^2)^2 + (2 xi wF w)^2 = (Kp wF^2)^2, a quadratic in w^2; phase = -atan2(2 xi wF w, wF^2 - w^2)."""
    wF, xi, gain = 100.0, 0.3, 1800.0
    b = 4 * xi**2 * wF**2 - 2 * wF**2
    w = np.sqrt((-b + np.sqrt(b**2 - 4 * wF**4 * (1 - gain**2))) / 2)
    phase = 180 - np.degrees(np.arctan2(2 * xi * wF * w, wF**2 - w**2))
    found = margins(mirror()).loops[0]
    assert found.gain_crossings_hz == pytest.approx([w / (2 * np.pi)], rel=1e-11)
    assert found.phase_margins_deg == pytest.approx([phase], rel=1e-8)
    assert found.delay_margin_s == pytest.approx(np.radians(phase) / w, rel=1e-8)


def test_all_crossings_of_a_conditionally_stable_loop():
    """Three phase crossings of an exactly factored loop, and python-control's stability_margins as a peer."""
    system = loop(400 * np.poly([-2, -2, -3]), np.poly([0, 0, 0, -20, -30, -80]))
    found = margins(system).loops[0]
    tf = control.tf(400 * np.poly([-2, -2, -3]), np.poly([0, 0, 0, -20, -30, -80]))
    gm, pm, _, wpc, wgc, _ = control.stability_margins(tf, returnall=True)
    assert np.allclose(found.phase_crossings_hz, np.sort(wpc) / (2 * np.pi), rtol=1e-6)
    assert np.allclose(found.gain_crossings_hz, np.sort(wgc) / (2 * np.pi), rtol=1e-6)
    assert np.allclose(10 ** (found.gain_margins_db / 20), gm[np.argsort(wpc)], rtol=1e-5)
    assert np.allclose(found.phase_margins_deg, pm[np.argsort(wgc)], atol=1e-4)


def test_gain_margin_moves_poles_to_the_axis():
    system = loop([1.0], np.poly([-1, -2, -3]))
    found = margins(system)
    assert 10 ** (found.gain_margin_db / 20) == pytest.approx(60.0, rel=1e-9)
    factor = 10 ** (found.gain_margin_db / 20)
    edge = StateSpace(system.A, system.B * factor, system.C, system.D, ["e"], ["y"])
    assert abs(np.linalg.eigvals(sensitivity(edge).A).real).min() < 1e-9


def test_disk_margin_of_an_integrator_and_its_guarantee():
    """L = 1/s: (S - T)/2 = (s - 1) / (2 (s + 1)), so alpha = 2: any positive gain, 90 degrees."""
    found = margins(loop([1.0], [1.0, 0.0]))
    assert found.disk.alpha == pytest.approx(2.0, rel=1e-6)
    assert found.disk.phase_deg == pytest.approx(90.0, rel=1e-6)
    loose = margins(loop([10.0], np.poly([-1, -2, -3])))
    assert loose.disk.phase_deg <= abs(loose.phase_margin_deg) + 1e-9
    assert 20 * np.log10(loose.disk.gain_high) <= loose.gain_margin_db + 1e-9
    values = abs(frequency_response(sensitivity(loop([10.0], np.poly([-1, -2, -3]))), np.geomspace(0.01, 3, 4000)).values)
    assert loose.sensitivity_peak.value >= values.max()
    assert loose.sensitivity_peak.value == pytest.approx(values.max(), rel=1e-4)


def test_unstable_loops_have_no_disk_margin():
    found = margins(loop([100.0], np.poly([-1, -2, -3])))
    assert not found.stable
    assert found.disk.alpha == 0.0
    assert found.gain_margin_db == np.inf
    assert 10 ** (-found.loops[0].gain_reduction_db / 20) == pytest.approx(0.6, rel=1e-9)


def test_decoupled_loops_are_broken_one_at_a_time():
    a, b = mirror(), loop([1.0], np.poly([-1, -2, -3]))
    both = StateSpace(
        np.block([[a.A, np.zeros((2, 3))], [np.zeros((3, 2)), b.A]]),
        np.block([[a.B, np.zeros((2, 1))], [np.zeros((3, 1)), b.B]]),
        np.block([[a.C, np.zeros((1, 3))], [np.zeros((1, 2)), b.C]]),
        np.zeros((2, 2)),
        ["e1", "e2"],
        ["y1", "y2"],
    )
    found = margins(both)
    assert found.loops[0].phase_margin_deg == pytest.approx(margins(a).phase_margin_deg, rel=1e-6)
    assert found.loops[1].gain_margin_db == pytest.approx(margins(b).gain_margin_db, rel=1e-6)
    assert found.disk.alpha == pytest.approx(min(margins(a).disk.alpha, margins(b).disk.alpha), rel=1e-5)


def test_coupled_loops_close_the_others():
    rng = np.random.default_rng(0)
    system = StateSpace(
        -np.diag([1.0, 2.0, 5.0]), rng.normal(size=(3, 2)), rng.normal(size=(2, 3)), 0.1 * np.eye(2), ["a", "b"], ["x", "y"]
    )
    L = lambda s: system.C @ np.linalg.solve(s * np.eye(3) - system.A, system.B) + system.D  # noqa: E731
    value = L(2j)
    expected = value[0, 0] - value[0, 1] * value[1, 0] / (1 + value[1, 1])
    got = frequency_response(_broken(system, 0), [1 / np.pi]).values.item()
    assert got == pytest.approx(expected, rel=1e-12)


def test_discrete_loops_reach_the_unit_circle_at_their_margins():
    continuous = loop([10.0], np.poly([-1, -2, -3]))
    discrete = discretize(continuous, 0.05)
    found = margins(discrete)
    factor = 10 ** (found.gain_margin_db / 20)
    edge = StateSpace(discrete.A, discrete.B * factor, discrete.C, discrete.D, ["e"], ["y"], dt=0.05)
    assert abs(np.linalg.eigvals(sensitivity(edge).A)).max() == pytest.approx(1.0, abs=1e-9)
    unit = frequency_response(discrete, found.loops[0].gain_crossings_hz).values[0, 0]
    assert abs(unit) == pytest.approx(1.0, rel=1e-9)
    assert 180 + np.degrees(np.angle(unit)) == pytest.approx(found.loops[0].phase_margins_deg, rel=1e-7)
    assert found.gain_margin_db < margins(continuous).gain_margin_db


def test_first_order_bandwidth_and_level_crossings():
    low_pass = loop([5.0], [1.0, 5.0])
    level = np.sqrt(0.5)
    assert bandwidth_hz(low_pass) == pytest.approx(5 * np.sqrt(1 / level**2 - 1) / (2 * np.pi), rel=1e-11)
    resonant = loop([100.0], [1.0, 0.2, 100.0])
    two = crossing_hz(resonant, 6.0)
    gains = 20 * np.log10(abs(frequency_response(resonant, two).values[0, 0]))
    assert two.size == 2
    assert np.allclose(gains, 6.0, atol=1e-9)
    assert crossing_hz(resonant, 60.0).size == 0
    assert bandwidth_hz(loop([1.0, 0.0, 1.0], [1.0, 2.0, 1.0]), -60.0) < 1 / (2 * np.pi)


def test_bad_requests():
    wide = StateSpace(-np.eye(1), np.ones((1, 2)), np.ones((1, 1)), np.zeros((1, 2)), ["a", "b"], ["y"])
    with pytest.raises(InputError, match="square"):
        margins(wide)
    algebraic = StateSpace(-np.eye(1), np.eye(1), np.eye(1), -np.eye(1), ["u"], ["y"])
    with pytest.raises(InputError, match="not well posed"):
        margins(algebraic)
    with pytest.raises(InputError, match="level_db must be negative"):
        bandwidth_hz(mirror(), 3.0)
    with pytest.raises(InputError, match="level_db must be finite"):
        crossing_hz(mirror(), np.nan)
    with pytest.raises(InputError, match="zero"):
        bandwidth_hz(loop([1.0, 0.0], [1.0, 2.0, 1.0]))


@pytest.mark.parametrize("over", [1e-2, 1e-5, 1e-9])
def test_crossings_about_a_turning_point_between_grid_points_are_found(over):
    """|L| = (1 + e) / sqrt(1 + x^2), x = (w0^2 - w^2) / (2 zeta w0 w): crossings in closed form; below one there are none."""
    w0, zeta, seen = 2 * np.pi * 1.91, 0.01, []

    def loops(hz, over=over):
        seen.append(hz.size)
        w, bend = 2 * np.pi * hz, (hz / 3.3 - 1) ** 2
        resonance = 2j * zeta * w0 * w / (w0**2 - w**2 + 2j * zeta * w0 * w)
        return np.stack([(1 + over) * resonance, -3.0 - 1j * (bend - over), -3.0 + 1j * (bend - over), 3.0 + 1j * (bend - over)])

    hz = np.geomspace(0.1, 20, 300)
    gain, up, down, ahead = crossings(loops, *refined_grid(loops, hz))
    x = zeta * np.sqrt((1 + over) ** 2 - 1) * np.array([-1, 1])
    assert np.allclose(2 * np.pi * gain.unit_hz, w0 * (x + np.sqrt(1 + x**2)), rtol=1e-16 / x[1] + 1e-13, atol=0)
    for real in (up, down):
        assert np.allclose(real.phase_hz, 3.3 * (1 + np.sqrt(over) * np.array([-1, 1])), rtol=1e-15 / np.sqrt(over), atol=0)
    assert not ahead.phase_hz.size

    def below(hz):
        return loops(hz, over=-over)

    grid = refined_grid(below, hz)
    seen.clear()
    assert not any(c.unit_hz.size or c.phase_hz.size for c in crossings(below, *grid))
    assert sum(seen) < 4 * 45  # golden section ends where a parabola cannot reach the level
