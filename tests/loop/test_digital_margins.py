"""Loops with digital blocks, broken at samples: against dense pulse transfer functions, python-control, and their own motion."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest

import flexplant as fp
from flexplant.blocks.basic import gain, summing_junction
from flexplant.blocks.delay import sample_delay
from flexplant.blocks.sampled import saturation
from flexplant.blocks.transfer_function import transfer_function
from flexplant.errors import DiagramError, InputError
from flexplant.loop import modal_split, norms
from flexplant.loop.breaking import cut_open
from flexplant.loop.broken import BrokenLoops
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.discretize import discretize
from flexplant.loop.frequency import frequency_response
from flexplant.loop.hybrid import hybrid_of
from flexplant.loop.loop_response import loop_margins, loop_response
from flexplant.loop.monodromy import multipliers
from flexplant.loop.simulate import simulate
from flexplant.loop.warped import true_hz, warped_hz
from flexplant.plant.modal import ModalPlant

T = 1e-3
ACTUATOR = transfer_function([1.0, 900.0], [1e-3, 3.0, 900.0])
FILTER = transfer_function([1.0], [2e-3, 1.0])


def structure(n=7, *, rigid=1, zeta=0.01, seed=0) -> ModalPlant:
    """Displacements of two collocated channels, modes up to beyond the Nyquist frequency of 1 ms."""
    rng = np.random.default_rng(seed)
    b = rng.normal(size=(n, 2))
    omega = np.r_[np.zeros(rigid), 2 * np.pi * np.sort(rng.uniform(5, 700, n - rigid))]
    ports = {"inputs": ["f", "d"], "outputs": ["y", "z"]}
    return ModalPlant(omega=omega, zeta=zeta, shape_in=b, shape_out=b.T, shape_out_velocity=1e-3 * b.T, **ports)


def servo(plant=None, *, gain=2000.0, dt=T, delay=0, around=(), second=None, law=None) -> Diagram:
    """y [-> filter] -> control [-> delay] [-> actuator] -> f, and z -> second -> d if there is a second loop."""
    law = transfer_function([-gain, 0.97 * gain], [1.0, -0.5], dt=dt) if law is None else law
    blocks = {"plant": plant or structure(), "control": law}
    path = ["plant.y", "control.u", "control.y"]
    if delay:
        blocks["delay"] = sample_delay(delay, dt)
        path += ["delay.u", "delay.y"]
    if around:
        blocks["filter"], blocks["actuator"] = around
        path = [path[0], "filter.u", "filter.y", *path[1:], "actuator.u", "actuator.y"]
    path.append("plant.f")
    wires = list(zip(path[::2], path[1::2], strict=True))
    inputs = {"d": "plant.d"}
    if second is not None:
        blocks |= {"second": second, "sum": summing_junction("++")}
        wires += [("plant.z", "second.u"), ("second.y", "sum.in1"), ("sum.sum", "plant.d")]
        inputs = {"d": "sum.in2"}
    return Diagram(blocks=blocks, connections=wires, inputs=inputs, outputs={"y": "plant.y", "z": "plant.z"})


LOOPS = {
    "plain": (servo(), "plant.y"),
    "delay": (servo(delay=3), "delay.y"),
    "filters": (servo(around=(FILTER, ACTUATOR)), "filter.y"),
    "filters, undamped": (servo(structure(zeta=0.0), around=(FILTER, ACTUATOR)), "control.y"),
    "two loops": (servo(second=transfer_function([-300.0, 290.0], [1.0, -0.3], dt=T)), ["plant.y", "plant.z"]),
    "overdamped": (servo(structure(zeta=[0, 3.0, 0.5, 1.0, 0.01, 0.02, 1.5])), "plant.y"),
    "analog loop inside": (servo(second=transfer_function([-0.5, 0.0], [1e-3, 1.0])), "plant.y"),
    "direct": (servo(replace(structure(), feedthrough=[[1e-4, 0], [0, 0]]), around=(gain(2.0), ACTUATOR)), "filter.y"),
    "all digital": (servo(fp.discretize(structure(), T)), "plant.y"),
    "three rates": (
        servo(gain=800.0, dt=6 * T, second=transfer_function([-90.0, 80.0], [1.0, -0.3], dt=2 * T), delay=1),
        "plant.y",
    ),
}


def dense_gain(diagram, at, hz, dt):
    """L from the map of all states over a sample: stepped, not transformed."""
    system = discretize(cut_open(diagram, [at] if isinstance(at, str) else at), dt)
    points = np.exp(2j * np.pi * hz * dt)[:, None, None] * np.eye(system.n_states) - system.A
    return -np.moveaxis(
        system.C @ np.linalg.solve(points, np.broadcast_to(system.B, (hz.size, *system.B.shape))) + system.D, 0, -1
    )


def rates(name):
    """Sample time of the loop, base step and base steps in a period."""
    return (6 * T, 2 * T, 3) if name == "three rates" else (T, T, 1)


@pytest.mark.parametrize("name", list(LOOPS))
def test_loop_gain_is_the_pulse_transfer_function(name):
    diagram, at = LOOPS[name]
    dt = rates(name)[0]
    hz = np.array([3e-4, 4e-3, 0.04, 0.21, 0.333, 0.48, 0.4999]) / dt
    loops = BrokenLoops(diagram, [at] if isinstance(at, str) else at)
    found, exact = loops.gain(loops.asked(hz)), dense_gain(diagram, at, hz, dt)
    assert abs(found - exact).max() <= 1e-9 * abs(exact).max()
    assert (abs(found - exact) <= 1e-6 * abs(exact) + 1e-13 * abs(exact).max()).all()
    assert loops.seen(loops.asked(hz)) == pytest.approx(hz, rel=1e-13)
    assert loops.dt == pytest.approx(dt)


@pytest.mark.parametrize("name", ["filters", "two loops", "three rates"])
def test_margins_and_peaks_in_the_dense_form(name, monkeypatch):
    """Crossings lie where the dense L is on the unit circle or real, none is missing; peaks are those of the dense S."""
    if name != "three rates":
        monkeypatch.setattr(norms, "SMALL", 0)
    diagram, at = LOOPS[name]
    dt = rates(name)[0]
    found = loop_margins(diagram, at)
    assert found.stable
    at_peak = dense_gain(diagram, at, np.array([found.sensitivity_peak.frequency_hz]), dt)[:, :, 0]
    assert np.linalg.norm(inverse_of_one_and(at_peak), 2) == pytest.approx(found.sensitivity_peak.value, rel=1e-5)
    at_disk = dense_gain(diagram, at, np.array([found.disk.frequency_hz]), dt)[:, :, 0]
    assert 1 / np.linalg.norm(inverse_of_one_and(at_disk) - 0.5 * np.eye(len(at_disk)), 2) == pytest.approx(
        found.disk.alpha, rel=1e-5
    )
    if isinstance(at, str):
        loop = found.loops[0]
        assert abs(dense_gain(diagram, at, loop.gain_crossings_hz, dt)) == pytest.approx(1.0, rel=1e-6)
        real = dense_gain(diagram, at, loop.phase_crossings_hz, dt)[0, 0]
        assert -20 * np.log10(abs(real)) == pytest.approx(loop.gain_margins_db, abs=1e-5)
        assert (real.real < 0).all()
        fine = dense_gain(diagram, at, np.linspace(1e-5, 0.5, 1500) / dt, dt)[0, 0]
        turns = (fine.imag[1:] * fine.imag[:-1] < 0) & (fine.real[1:] < 0) & (fine.real[:-1] < 0)
        assert np.count_nonzero(np.diff(np.sign(abs(fine) - 1))) <= loop.gain_crossings_hz.size
        assert np.count_nonzero(turns) <= loop.phase_crossings_hz.size


@pytest.mark.parametrize("name", ["three rates", "analog loop inside", "all digital", "two loops"])
def test_large_state_spaces_are_split_into_their_modes(name, monkeypatch):
    """The same loop gain and the same peak, with each state space as modes and a rest."""
    diagram, at = LOOPS[name]
    dt, signals = rates(name)[0], [at] if isinstance(at, str) else at
    whole = BrokenLoops(diagram, signals)
    monkeypatch.setattr(modal_split, "LARGE", 0)
    split = BrokenLoops(diagram, signals)
    if name != "two loops":
        assert any(block.startswith(("loop modes", "behind modes", "plant modes")) for block in split.opened.blocks)
    hz = whole.asked(np.array([4e-3, 0.04, 0.21, 0.48]) / dt)
    assert abs(split.gain(hz) - whole.gain(hz)).max() <= 1e-9 * abs(whole.gain(hz)).max()
    for kind in ("S", "half"):
        values = [frequency_response(loops.closed(kind), hz).values for loops in (split, whole)]
        assert abs(values[0] - values[1]).max() <= 1e-8 * abs(values[1]).max()
    poles = np.linalg.eigvals(close(split.closed("S")).A)
    assert (poles.real < 0).all() == (abs(multipliers(hybrid_of(diagram), *rates(name)[1:])) < 1).all()


@pytest.mark.parametrize("name", ["filters", "filters, undamped", "two loops", "overdamped"])
def test_the_closed_loop_has_the_poles_of_the_period(name):
    """Every multiplier is there, as many lie outside the unit circle, and none is added on it (stable ones may be)."""
    diagram, at = LOOPS[name]
    w = np.linalg.eigvals(close(BrokenLoops(diagram, [at] if isinstance(at, str) else at).closed("S")).A)
    found, exact = (1 + w * T / 2) / (1 - w * T / 2), multipliers(hybrid_of(diagram), T, 1)
    assert abs(found - exact[:, None]).min(axis=1).max() < 1e-6
    assert np.count_nonzero(abs(found) > 1 - 1e-9) == np.count_nonzero(abs(exact) > 1 - 1e-9)


def inverse_of_one_and(L):
    return np.linalg.inv(np.eye(len(L)) + L)


def small() -> Diagram:
    plant = ModalPlant(omega=[30.0], zeta=[0.1], shape_in=[[1.0]], shape_out=[[1.0]], inputs=["f"], outputs=["y"])
    blocks = {"plant": plant, "control": transfer_function([-4e4, 3.6e4], [1.0, -0.2], dt=2 * T)}
    wires = [("plant.y", "control.u"), ("control.y", "plant.f")]
    return Diagram(blocks=blocks, connections=wires, outputs={"y": "plant.y"})


def test_margins_of_python_control():
    diagram = small()
    plant, law = discretize(diagram.blocks["plant"], 2 * T), diagram.blocks["control"]
    peer = -control.ss(plant.A, plant.B, plant.C, plant.D, 2 * T) * control.ss(law.A, law.B, law.C, law.D, 2 * T)
    gm, pm, sm, wpc, wgc, _ = control.stability_margins(control.tf(peer))
    found = loop_margins(diagram, "control.y")
    assert found.gain_margin_db == pytest.approx(20 * np.log10(gm), abs=1e-6)
    assert found.phase_margin_deg == pytest.approx(pm, abs=1e-6)
    assert 1 / found.sensitivity_peak.value == pytest.approx(sm, rel=1e-3)
    loop = found.loops[0]
    assert 2 * np.pi * loop.phase_crossings_hz[np.argmin(loop.gain_margins_db)] == pytest.approx(wpc, rel=1e-7)
    assert 2 * np.pi * loop.gain_crossings_hz[np.argmin(abs(loop.phase_margins_deg))] == pytest.approx(wgc, rel=1e-7)


def scaled(diagram, block, factor) -> Diagram:
    old = diagram.blocks[block]
    return replace(diagram, blocks={**diagram.blocks, block: replace(old, C=factor * old.C, D=factor * old.D)})


@pytest.mark.parametrize("name", ["delay", "filters", "three rates"])
def test_the_gain_margin_is_where_the_loop_becomes_unstable(name):
    """2 % either side, by the multipliers of the period."""
    diagram, at = LOOPS[name]
    margins = loop_margins(diagram, at)
    assert margins.stable
    edge = 10 ** (margins.gain_margin_db / 20)
    for factor, stable in ((0.98, True), (1.02, False)):
        loop = scaled(diagram, "control", factor * edge)
        assert (abs(multipliers(hybrid_of(loop), *rates(name)[1:])).max() < 1) == stable


def test_beyond_the_gain_margin_the_motion_grows():
    edge = 10 ** (loop_margins(small(), "plant.y").gain_margin_db / 20)
    for factor, stable in ((0.98, True), (1.02, False)):
        loop = scaled(small(), "control", factor * edge)
        y = abs(simulate(loop, np.arange(1500) * 2 * T, initial=[1.0, 0.0, 0.0], unstable="allow").outputs[0].values)
        assert (y[-300:].max() < y[300:600].max()) == stable
        assert loop_margins(loop, "plant.y").stable == stable


def test_whole_samples_of_delay_up_to_the_delay_margin():
    """Delays of whole samples are exact: stable below the margin, unstable above."""
    diagram = servo(structure(3, zeta=0.05), gain=300.0)
    margin = loop_margins(diagram, "plant.y").delay_margin_s / T
    assert 3 < margin < 60
    for samples, stable in ((int(margin), True), (int(margin) + 1, False)):
        later = servo(structure(3, zeta=0.05), gain=300.0, delay=samples)
        assert (abs(multipliers(hybrid_of(later), T, 1)).max() < 1) == stable
    rest = loop_margins(servo(structure(3, zeta=0.05), gain=300.0, delay=3), "control.y")
    assert rest.delay_margin_s / T == pytest.approx(margin - 3, rel=1e-9)


def test_fast_sampling_is_the_continuous_loop():
    """The hold delays by half a sample, which costs phase in proportion to T; a delay margin less T / 2 is right to T^2."""
    plant, law = structure(3, zeta=0.05), transfer_function([-0.4, -20.0], [1e-2, 1.0])
    exact = loop_margins(servo(plant, law=law), "plant.y")
    phase, delay = [], []
    for dt in (2e-4, 1e-4):
        found = loop_margins(servo(plant, law=fp.discretize(law, dt, hold="first")), "plant.y")
        phase.append(exact.phase_margin_deg - found.phase_margin_deg)
        delay.append(abs(exact.delay_margin_s - 0.5 * dt - found.delay_margin_s))
    orders = [np.log2(np.array(errors[:-1]) / errors[1:]) for errors in (phase, delay)]
    assert orders[0] == pytest.approx([1], abs=0.05)
    assert orders[1] == pytest.approx([2], abs=0.1)


def test_margins_at_the_ends_of_the_axis():
    """k 0.5 / (z - 0.5) becomes unstable through z = -1 at k = 3; -0.5 / (s + 1) through s = 0 at k = 2."""
    blocks = {"law": transfer_function([0.5], [1.0, -0.5], dt=T), "minus": gain(-1.0)}
    wires = [("law.y", "minus.u"), ("minus.y", "law.u")]
    digital = loop_margins(Diagram(blocks=blocks, connections=wires), "law.y")
    lag = {**blocks, "law": transfer_function([-0.5], [1.0, 1.0])}
    continuous = loop_margins(Diagram(blocks=lag, connections=wires), "law.y")
    for found, factor, hz in ((digital, 3.0, 0.5 / T), (continuous, 2.0, 0.0)):
        assert found.gain_margin_db == pytest.approx(20 * np.log10(factor), rel=1e-9)
        assert found.loops[0].phase_crossings_hz == pytest.approx([hz])
    for block, factor in ((blocks["law"], 3.0), (lag["law"], 2.0)):
        assert fp.margins(block).gain_margin_db == pytest.approx(20 * np.log10(factor), rel=1e-9)
    held = fp.margins(fp.transfer_function([-1.5], [1.0, 1.0])).loops[0]
    assert held.gain_reduction_db == pytest.approx(20 * np.log10(1.5))


def test_an_unstable_digital_loop_names_its_pole():
    found = loop_response(scaled(*LOOPS["plain"][:1], "control", 100.0), "plant.y", [1.0])
    assert not found.stable
    assert "outside the unit circle, one of them at z = " in found.attrs["explanation"]


def test_frequencies_go_there_and_back():
    hz = np.array([0.0, 1e-9, 3.0, 499.0])
    assert true_hz(warped_hz(hz, T), T) == pytest.approx(hz, rel=1e-13)
    assert true_hz(np.array([np.inf]), T) == pytest.approx([500.0])


@pytest.mark.parametrize("kind", ["continuous", "digital"])
def test_searches_pass_modes_without_damping(kind):
    """Im L changes its sign there without a crossing."""
    law = transfer_function([-0.4, -20.0], [1e-2, 1.0]) if kind == "continuous" else None
    found = loop_margins(servo(structure(5, zeta=0.0), law=law), "plant.y").loops[0]
    assert np.isfinite(found.gain_margins_db).all()
    own = structure(5).frequency_hz
    assert (abs(found.phase_crossings_hz[:, None] / own[1:] - 1) > 1e-9).all()


AT_NYQUIST = ModalPlant(
    omega=[np.pi / T], zeta=0.0, shape_in=np.ones((1, 2)), shape_out=np.ones((2, 1)), inputs=["f", "d"], outputs=["y", "z"]
)
FAST_AND_SLOW = servo(dt=4 * T, second=transfer_function([-9.0], [1.0, -0.3], dt=T))


@pytest.mark.parametrize(
    ("diagram", "at", "error", "message"),
    [
        (
            LOOPS["filters"][0],
            "actuator.y",
            InputError,
            r"'actuator.y' is not sampled every 0.001 s.*varies in time.*break it at filter.y",
        ),
        (LOOPS["filters"][0], "plant.y", InputError, "break it at filter.y, control.y"),
        (FAST_AND_SLOW, "plant.z", InputError, r"not sampled every 0.004 s.*second: 0.001 s.*break it at plant.y, control.y"),
        (servo(dt=3 * T, second=transfer_function([-9.0], [1.0, -0.3], dt=2 * T)), "plant.y", InputError, "no signal is: give"),
        (servo(dt=T, second=transfer_function([-9.0], [1.0, -0.3], dt=np.pi * T)), "plant.y", InputError, "no common period"),
        (servo(law=saturation(-1, 1)), "plant.y", DiagramError, "nonlinear blocks .control."),
        (servo(), "plant.x", DiagramError, "Did you mean"),
        (
            servo(AT_NYQUIST),
            "plant.y",
            InputError,
            "mode 0 .counted from 0. at 500 Hz has no damping",
        ),
        (servo(law=transfer_function([-1.0], [1.0, 1.0], dt=T)), "plant.y", InputError, "pole at z = -1"),
        (
            Diagram(
                blocks={"law": transfer_function([-1.5], [1.0, -0.5], dt=T), "one": gain(1.0)},
                connections=[("law.y", "one.u"), ("one.y", "law.u")],
            ),
            "law.y",
            InputError,
            "closed at law.y has a pole at z = -1 .the Nyquist frequency, 500 Hz.",
        ),
    ],
)
def test_loops_that_cannot_be_broken(diagram, at, error, message):
    with pytest.raises(error, match=message) as caught:
        loop_margins(diagram, at)
    assert "\n" not in str(caught.value)


def test_frequencies_above_the_nyquist_frequency():
    with pytest.raises(InputError, match=r"600 Hz lies above the Nyquist frequency 500 Hz of a loop sampled every 0\.001 s"):
        loop_response(servo(), "plant.y", [1.0, 600.0])
