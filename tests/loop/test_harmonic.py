"""Harmonic steady state and the sweep over wheel speeds."""

import numpy as np
import pytest
import scipy.sparse as sp
import xarray as xr

from flexplant.blocks.basic import gain
from flexplant.blocks.tones import Tones, rms
from flexplant.blocks.transfer_function import transfer_function
from flexplant.blocks.wheel import Wheel, harmonic_amplitudes, wheel_tones
from flexplant.errors import InputError
from flexplant.loop import harmonic, tone_sweep
from flexplant.loop.cascade import cascade_of
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.frequency import frequency_response as diagram_response
from flexplant.loop.frequency import frequency_response_blocks
from flexplant.loop.harmonic import harmonic_response, wheel_speed_sweep
from flexplant.loop.line_of_sight import closed_loop_transfer, line_of_sight_diagram, output_sensitivity
from flexplant.loop.steady import input_amplitudes, output_amplitudes, steady_states
from flexplant.loop.tone_sweep import ToneSweep
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, state_space
from flexplant.response import receptance
from flexplant.response.frequency import frequency_response


def test_one_mode_in_closed_form():
    omega, zeta, hz = 30.0, 0.02, np.array([1.0, 4.0, 20.0])
    plant = ModalPlant(omega=[omega], zeta=zeta, shape_in=[[2.0]], shape_out=[[0.5]], inputs=["f"], outputs=["x"])
    w = 2 * np.pi * hz
    response = harmonic_response(plant, Tones(frequency_hz=hz, amplitude=[[1.0, 1j, -3.0]], inputs=["f"]))
    assert response.dims == ("output", "frequency")
    assert response.values[0] == pytest.approx(
        np.array([1.0, 1j, -3.0]) / (omega**2 - w**2 + 2j * zeta * omega * w), rel=1e-12, abs=0
    )


@pytest.mark.parametrize("closed", [True, False])
def test_transfer_function_route_equals_state_route(published, plant, wheel, closed):
    diagram, tones = line_of_sight_diagram(published, plant, closed=closed), wheel_tones(wheel, 56.4)
    cascade = cascade_of(diagram)
    amplitude = input_amplitudes(tones, list(diagram.inputs))
    states = steady_states(cascade, tones.frequency_hz, amplitude)
    by_states = output_amplitudes(cascade, states, amplitude)
    assert harmonic_response(diagram, tones).values == pytest.approx(by_states, rel=1e-9, abs=0)
    assert harmonic_response(close(diagram), tones).values == pytest.approx(by_states, rel=1e-9, abs=0)


def test_sweep_is_the_harmonic_response_at_each_speed(published, plant, wheel):
    systems = {"open": line_of_sight_diagram(published, plant, closed=False), "closed": line_of_sight_diagram(published, plant)}
    speeds = np.array([5.0, 20.0, 56.4, 10.0])
    sweep = wheel_speed_sweep(systems, wheel, speeds)
    assert sweep.rms.dims == ("case", "output", "omega_hz")
    assert list(sweep.harmonic.values) == [1.0, 2.0, 3.0]
    for case, system in systems.items():
        for speed in speeds:
            amplitude = harmonic_response(system, wheel_tones(wheel, speed)).values
            point = sweep.sel(case=case, omega_hz=speed)
            assert point.amplitude.values == pytest.approx(amplitude, rel=1e-10, abs=0)
            tones = Tones(frequency_hz=wheel_tones(wheel, speed).frequency_hz, amplitude=amplitude, inputs=["x", "y"])
            assert point.rms.values == pytest.approx(rms(tones), rel=1e-10, abs=0)


def test_closed_over_open_is_the_sensitivity(published, plant, wheel):
    systems = {"open": line_of_sight_diagram(published, plant, closed=False), "closed": line_of_sight_diagram(published, plant)}
    speeds = np.linspace(3, 120, 40)
    sweep = wheel_speed_sweep(systems, wheel, speeds)
    ratio = sweep.amplitude.sel(case="closed", output="spot_x") / sweep.amplitude.sel(case="open", output="spot_x")
    S = [frequency_response(output_sensitivity(published), h * speeds).values[0, 0] for h in (1, 2, 3)]
    assert ratio.values == pytest.approx(np.array(S), rel=1e-8, abs=0)


def test_a_turned_wheel_drives_other_axes():
    """A wheel whose axis 1 is the plant's axis 2 shakes input 2."""
    inputs = [f"f{k}" for k in range(6)]
    plant = ModalPlant(
        omega=np.arange(1, 7) * 50.0, zeta=0.01, shape_in=np.eye(6), shape_out=np.eye(6), inputs=inputs, outputs=inputs
    )
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    sweep = wheel_speed_sweep(plant, Wheel(amplitude=[1, 0, 0, 0, 0, 0], harmonics=[1], rotation=turn, inputs=inputs), [3.0])
    assert np.flatnonzero(sweep.rms.values[:, 0] > 1e-12).tolist() == [1]


def test_errors(published, plant, wheel):
    with pytest.raises(InputError, match="positive speeds"):
        wheel_speed_sweep(plant, wheel, [0.0, 1.0])
    with pytest.raises(InputError, match=r"no input 'bus\.9001\.1'"):
        wheel_speed_sweep(closed_loop_transfer(published), wheel, [1.0])
    with pytest.raises(InputError, match="same outputs"):
        wheel_speed_sweep({"a": plant, "b": line_of_sight_diagram(published, plant)}, wheel, [1.0])


@pytest.mark.parametrize("closed", [True, False])
def test_sweep_against_the_dense_closed_loop(published, make_plant, wheel, closed):
    """2,000 points against C (s I - A)^-1 B + D solved densely, to 1e-12 of the largest."""
    system = line_of_sight_diagram(published, make_plant(n_flexible=30), closed=closed, signals=("spot", "angle"))
    whole, speeds = close(system), np.linspace(2.0, 300.0, 60)
    sweep = wheel_speed_sweep(system, wheel, speeds)
    for k, speed in enumerate(speeds):
        tones = wheel_tones(wheel, speed)
        for h, (hz, a) in enumerate(zip(tones.frequency_hz, tones.amplitude.T, strict=True)):
            s = 2j * np.pi * hz
            y = whole.C @ np.linalg.solve(s * np.eye(whole.n_states) - whole.A, whole.B @ a) + whole.D @ a
            assert abs(sweep.amplitude.values[:, h, k] - y).max() <= 1e-11 * abs(y).max()


def test_sweep_of_feedback_into_the_structure(published, make_plant, wheel, monkeypatch):
    """Both routes of the sweep agree where the plant is inside the loop."""
    plant = make_plant(n_flexible=5, n_rigid=0, zeta=0.02)
    system = close(line_of_sight_diagram(published, plant))
    first = wheel_speed_sweep(system, wheel, [3.0, 20.0, 70.0])
    monkeypatch.setattr(ToneSweep, "pays", False)
    second = wheel_speed_sweep(system, wheel, [3.0, 20.0, 70.0])
    assert first.amplitude.values == pytest.approx(second.amplitude.values, rel=1e-9)


def test_sweep_names_undamped_modes(wheel, make_plant):
    plant = make_plant(zeta=0.0, n_rigid=0)
    with pytest.raises(InputError, match=r"meets the undamped mode 3 \(counted from 0\)"):
        wheel_speed_sweep(plant, wheel, [plant.omega[3] / (2 * np.pi)])


def test_a_diagram_writes_into_given_memory_and_in_blocks(published, plant):
    system, hz = line_of_sight_diagram(published, plant), np.linspace(1.0, 300.0, 50)
    whole, memory = diagram_response(system, hz), np.empty((2, len(system.inputs), 50), dtype=complex)
    assert np.shares_memory(diagram_response(system, hz, out=memory).values, memory)
    assert np.array_equal(memory, whole.values)
    parts = [part.values for part in frequency_response_blocks(system, hz, block=20)]
    assert [part.shape[2] for part in parts] == [20, 20, 10]
    assert np.concatenate(parts, axis=2) == pytest.approx(whole.values, rel=1e-12)
    plain = [part.values for part in frequency_response_blocks(plant, hz, block=50)]
    assert np.array_equal(plain[0], diagram_response(plant, hz).values)
    with pytest.raises(InputError, match="frequencies must ascend"):
        frequency_response_blocks(system, hz[::-1])
    with pytest.raises(InputError, match="C-contiguous"):
        diagram_response(system, hz, out=memory[:, :, :10])


def test_tones_come_in_any_order(published, plant):
    system = line_of_sight_diagram(published, plant)
    up, down = [3.0, 8.0, 9.0, 20.0], [20.0, 8.0, 3.0, 9.0]
    amplitude = np.arange(1.0, 5.0)[None, :]
    first = harmonic_response(system, Tones(frequency_hz=up, amplitude=amplitude, inputs=list(system.inputs)[:1]))
    second = harmonic_response(
        system, Tones(frequency_hz=down, amplitude=amplitude[:, [3, 1, 0, 2]], inputs=list(system.inputs)[:1])
    )
    assert first.values[:, [3, 1, 0, 2]] == pytest.approx(second.values, rel=1e-12)
    assert list(second["frequency"].values) == down


def test_speeds_may_come_twice_and_in_any_order(published, plant, wheel):
    system = line_of_sight_diagram(published, plant)
    sweep = wheel_speed_sweep(system, wheel, [30.0, 5.0, 30.0])
    assert list(sweep.omega_hz.values) == [30.0, 5.0, 30.0]
    assert np.array_equal(sweep.amplitude.values[:, :, 0], sweep.amplitude.values[:, :, 2])
    for k, speed in enumerate((30.0, 5.0)):
        one = wheel_speed_sweep(system, wheel, [speed])
        assert sweep.amplitude.values[:, :, k] == pytest.approx(one.amplitude.values[:, :, 0], rel=1e-11)
        assert sweep.rms.values[:, k] == pytest.approx(one.rms.values[:, 0], rel=1e-11)


@pytest.mark.parametrize("fallback", [False, True])
def test_sweep_of_every_kind_of_output(wheel, fallback, monkeypatch):
    """Displacement, velocity and acceleration rows, rigid-body and overdamped modes, against the plant's response."""
    rng = np.random.default_rng(4)
    omega = np.r_[0.0, 0.0, rng.uniform(50, 4000, 80)]
    plant = ModalPlant(
        omega=omega,
        zeta=np.r_[0.0, 0.0, rng.uniform(1e-3, 2.0, 80)],
        shape_in=rng.normal(size=(82, 6)),
        shape_out=rng.normal(size=(3, 82)) * np.array([[1], [0], [1]]),
        shape_out_velocity=rng.normal(size=(3, 82)) * np.array([[0], [1], [1]]),
        shape_out_acceleration=rng.normal(size=(3, 82)) * np.array([[0], [0], [1]]),
        inputs=wheel.inputs,
        outputs=["x", "v", "all"],
    )
    if fallback:
        monkeypatch.setattr(receptance, "summed", receptance.summed.fallback)
    speeds = np.linspace(2.0, 150.0, 300)
    sweep = wheel_speed_sweep(plant, wheel, speeds)
    harmonics, amplitudes = harmonic_amplitudes(wheel)
    for h, a in zip(harmonics, amplitudes.T, strict=True):
        expected = np.einsum("oif,i->of", frequency_response(plant, h * speeds).values, a) * speeds**2
        found = sweep.amplitude.sel(harmonic=h).values
        assert (abs(found - expected).max(axis=1) / abs(expected).max(axis=1)).max() < 1e-12


def mixed_outputs(seed=4, n=30):
    """Displacements, velocities and accelerations of a plant with rigid-body modes, two of them through a filter."""
    rng = np.random.default_rng(seed)
    omega = np.r_[0.0, 0.0, 2 * np.pi * np.sort(rng.uniform(5, 300, n))]
    none, rows = np.zeros((2, n + 2)), rng.normal(size=(3, 2, n + 2))
    plant = ModalPlant(
        omega=omega, zeta=np.where(omega > 0, 0.01, 0.0), shape_in=rng.normal(size=(n + 2, 6)),
        shape_out=np.vstack([rows[0], none, none]), shape_out_velocity=np.vstack([none, rows[1], none]),
        shape_out_acceleration=np.vstack([none, none, rows[2]]), feedthrough=rng.normal(size=(6, 6)),
        inputs=[f"u{k}" for k in range(6)], outputs=[f"y{k}" for k in range(6)],
    )  # fmt: skip
    lag = transfer_function([3.0, 500.0], [1.0, 80.0, 4e4], input_name="u", output_name="y")
    wires = [("plant.y0", "a.u"), ("plant.y3", "b.u")]
    outputs = {"a": "a.y", "b": "b.y", **{f"y{k}": f"plant.y{k}" for k in range(6)}}
    inputs = {f"u{k}": f"plant.u{k}" for k in range(6)}
    return Diagram(blocks={"plant": plant, "a": lag, "b": lag}, connections=wires, inputs=inputs, outputs=outputs)


@pytest.mark.parametrize("speeds", [np.linspace(1.0, 80.0, 101), np.array([3.0]), np.array([50.0, 2.0, 30.0, 2.0])])
def test_compiled_and_numpy_sweeps_equal_the_dense_solution(speeds, monkeypatch):
    """Every kind of output, rigid-body modes, feedthrough and a filter, with complex amplitudes: three routes."""
    system = mixed_outputs()
    rng = np.random.default_rng(1)
    wheel = Wheel(
        amplitude=rng.normal(size=(6, 3)), harmonics=[0.7, 1.0, 3.1], phase_rad=rng.normal(size=(6, 3)),
        inputs=[f"u{k}" for k in range(6)],
    )  # fmt: skip
    one = wheel_speed_sweep(system, wheel, speeds)
    monkeypatch.setattr(tone_sweep, "numba", lambda: None)
    other = wheel_speed_sweep(system, wheel, speeds)
    whole, (harmonics, amplitudes) = close(system), harmonic_amplitudes(wheel)
    dense = np.empty(one.amplitude.shape, dtype=complex)
    for j, speed in enumerate(speeds):
        for h, a in enumerate(amplitudes.T):
            s = 2j * np.pi * harmonics[h] * speed
            x = np.linalg.solve(s * np.eye(whole.n_states) - whole.A, whole.B @ a)
            dense[:, h, j] = (whole.C @ x + whole.D @ a) * speed**2
    for found in (one, other):
        assert (abs(found.amplitude.values - dense).max(axis=2) <= 1e-12 * abs(dense).max(axis=2)).all()
        assert found.rms.values == pytest.approx(np.sqrt((abs(dense) ** 2).sum(axis=1) / 2), rel=1e-12)


def test_labels_are_those_that_xarray_makes():
    system, speeds = mixed_outputs(), np.array([1.0, 2.0])
    wheel = Wheel(amplitude=1.0, harmonics=[1.0], inputs=[f"u{k}" for k in range(6)])
    found = wheel_speed_sweep(system, wheel, speeds)
    data = {name: (found[name].dims, found[name].values) for name in ("rms", "amplitude")}
    units = ("output", list(system.output_units))
    made = xr.Dataset(data, {"output": list(system.outputs), "omega_hz": speeds, "harmonic": [1.0], "output_units": units})
    assert found.identical(made)
    assert found.sel(output="y3", omega_hz=2.0).rms == made.rms[5, 1]


def test_rows_that_outputs_share_are_summed_once():
    """The spot and the mirror's loop read the same two displacements."""
    system = mixed_outputs()
    sweep = tone_sweep.tone_sweep_of(system)
    assert sweep._read.shape == (8, 6)
    assert tone_sweep.tone_sweep_of(system) is sweep
    doubled = Diagram(
        blocks={**system.blocks, "twice": gain(2.0)},
        connections=[*system.connections, ("plant.y1", "twice.u")],
        inputs=system.inputs,
        outputs={**system.outputs, "twice": "twice.y"},
    )
    assert tone_sweep.tone_sweep_of(doubled)._read.shape == (9, 6)


def test_an_unstable_system_has_no_steady_state(make_plant, wheel, monkeypatch):
    """A plant whose velocity is fed back with the wrong sign: refused with its pole, in one line, by both routes."""
    plant = make_plant(n_flexible=5, n_rigid=0)
    rate = transfer_function([5e4, 0.0], [1e-7, 6e-4, 1.0], input_name="u", output_name="y")
    system = Diagram(
        blocks={"plant": plant, "rate": rate},
        connections=[("plant.optic.1.1", "rate.u"), ("rate.y", "plant.bus.9001.1")],
        inputs={name: f"plant.{name}" for name in plant.inputs[1:]},
        outputs={"x": "plant.optic.1.1"},
    )
    poles = np.linalg.eigvals(close(system).A)
    assert poles.real.max() > 1e-3
    tones = Tones(frequency_hz=[3.0], amplitude=[[1.0]], inputs=[plant.inputs[1]])
    for limit in (harmonic.WHOLE, 0):
        monkeypatch.setattr(harmonic, "WHOLE", limit)
        with pytest.raises(InputError, match=r"harmonic_response: 'diagram' is unstable, with a pole at .*rad/s"):
            harmonic_response(system, tones)


def test_plants_inside_large_loops_and_descriptors_go_by_their_response(published, make_plant, wheel, monkeypatch):
    plant = make_plant(n_flexible=5, n_rigid=0, zeta=0.02)
    diagram = line_of_sight_diagram(published, plant)
    first = wheel_speed_sweep(diagram, wheel, [3.0, 20.0, 70.0])
    monkeypatch.setattr(harmonic, "WHOLE", 0)
    monkeypatch.setattr(harmonic, "tone_sweep_of", None)
    second = wheel_speed_sweep(diagram, wheel, [3.0, 20.0, 70.0])
    assert first.amplitude.values == pytest.approx(second.amplitude.values, rel=1e-9)
    s = state_space(plant)
    E = np.eye(s.n_states)
    bordered = Descriptor(
        E=sp.block_diag([E, np.zeros((1, 1))], format="csr"), A=sp.block_diag([s.A, np.eye(1)], format="csr"),
        B=np.vstack([s.B, np.zeros((1, 6))]), C=np.hstack([s.C, np.zeros((2, 1))]), D=s.D, inputs=s.inputs, outputs=s.outputs,
    )  # fmt: skip
    third = wheel_speed_sweep(bordered, wheel, [3.0, 20.0])
    monkeypatch.undo()
    assert third.amplitude.values == pytest.approx(wheel_speed_sweep(plant, wheel, [3.0, 20.0]).amplitude.values, rel=1e-9)
