"""Time simulation: against stepping one by one, closed forms, other integrators, and the harmonic steady state."""

from dataclasses import replace

import control
import numpy as np
import pytest
import scipy.integrate
import stepwise_simulation as transient
import xarray as xr

from flexplant.blocks.basic import gain, summing_junction
from flexplant.blocks.delay import sample_delay
from flexplant.blocks.tones import Tones, rms, tone_signal
from flexplant.blocks.transfer_function import transfer_function
from flexplant.blocks.wheel import wheel_disturbance, wheel_tones
from flexplant.errors import InputError
from flexplant.loop.cascade import cascade_of
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.harmonic import harmonic_response
from flexplant.loop.line_of_sight import line_of_sight_diagram
from flexplant.loop.random import random_response
from flexplant.loop.simulate import simulate
from flexplant.loop.stream import simulate_stream
from flexplant.plant.discretize import discretize
from flexplant.plant.modal import ModalPlant, select
from flexplant.plant.rigid_body import without_rigid_body
from flexplant.plant.state_space import Descriptor, StateSpace, state_space


def relative(a, b):
    a, b = np.asarray(a), np.asarray(b)
    return float((abs(a - b).max(axis=-1) / abs(b).max(axis=-1)).max())


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("nt", [2, 3, 50, 1237])
def test_pieces_side_by_side_equal_one_step_after_another(plant, wheel, hold, nt):
    t = np.arange(nt) * 3e-4
    u = wheel_disturbance(wheel, 31.0, t)
    start = np.random.default_rng(2).normal(size=2 * plant.n_modes) * 1e-7
    ours = simulate(plant, t, u, hold=hold, initial=start)
    peer = transient.simulate(plant, t, u, hold=hold, initial_state=start)
    assert relative(ours.outputs, peer.outputs) < 1e-11
    assert relative(ours.final_state, peer.final_state) < 1e-11


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("closed", [True, False])
def test_structured_loop_equals_the_dense_closed_loop(published, plant, wheel, hold, closed):
    """Modes stepped as 2 x 2 blocks with the mirror beside them, against one matrix exponential of everything."""
    diagram = line_of_sight_diagram(published, plant, closed=closed, signals=("spot", "angle"))
    assert cascade_of(diagram).omega.size == plant.n_modes
    t = np.arange(900) * 2e-4
    u = wheel_disturbance(wheel, 56.4, t)
    start = np.random.default_rng(5).normal(size=2 * plant.n_modes + 4) * 1e-7
    ours = simulate(diagram, t, u, hold=hold, initial=start)
    peer = transient.simulate(close(diagram), t, u, hold=hold, initial_state=start)
    size = abs(peer.outputs).max()
    assert float(abs(ours.outputs - peer.outputs).max() / size) < 1e-10
    assert relative(ours.final_state, peer.final_state) < 1e-9


@pytest.mark.filterwarnings("ignore:simulate. the time step")
def test_coarse_steps_stay_exact_inside_the_step(published, plant, wheel):
    """The same straight-line input, sampled 8 times as often: nothing that happens within a step is lost."""
    diagram = line_of_sight_diagram(published, plant)
    coarse, fine = np.arange(101) * 1.6e-3, np.arange(801) * 2e-4
    u = wheel_disturbance(wheel, 20.0, coarse)
    u_fine = np.array([np.interp(fine, coarse, row) for row in u])
    assert relative(simulate(diagram, coarse, u).outputs, simulate(diagram, fine, u_fine).outputs[:, ::8]) < 1e-9


def test_against_an_adaptive_integrator(published, make_plant, wheel):
    plant = make_plant(n_flexible=3, zeta=0.02)
    diagram = line_of_sight_diagram(published, plant)
    whole, tones = close(diagram), wheel_tones(wheel, 25.0)
    t = np.arange(120) * 5e-4

    def slope(time, x):
        return whole.A @ x + whole.B @ tone_signal(tones, [time])[:, 0]

    solved = scipy.integrate.solve_ivp(
        slope, (0, t[-1]), np.zeros(whole.n_states), t_eval=t, method="DOP853", rtol=1e-10, atol=1e-18
    )
    expected = whole.C @ solved.y + whole.D @ tone_signal(tones, t)
    assert relative(simulate(diagram, t, tones).outputs, expected) < 1e-7


def test_against_python_control(plant, wheel):
    flexible = without_rigid_body(plant)
    system, t = state_space(flexible), np.arange(400) * 2e-4
    u = wheel_disturbance(wheel, 40.0, t)
    peer = control.forced_response(control.ss(system.A, system.B, system.C, system.D), t, u)
    assert relative(simulate(flexible, t, u).outputs, peer.outputs) < 1e-9


@pytest.mark.parametrize(("hold", "sampling", "order"), [("zero", "point", 1), ("first", "point", 2), ("zero", "mean", 2)])
def test_order_of_the_hold(published, plant, wheel, hold, sampling, order):
    """Against the exact response to the tones; the response to the held input is exact, so only the hold's error is left."""
    diagram, tones, end = line_of_sight_diagram(published, without_rigid_body(plant)), wheel_tones(wheel, 20.0), 0.08

    def error(steps):
        t = np.linspace(0, end, steps + 1)
        held = tone_signal(tones, t, sampling=sampling)
        # states, not outputs: a direct part would show the sample itself
        exact = simulate(diagram, t, tones).final_state
        return float(abs(simulate(diagram, t, held, hold=hold).final_state - exact).max())

    errors = [error(n) for n in (800, 1600, 3200)]
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert slopes == pytest.approx([order, order], abs=0.1)


@pytest.mark.parametrize("start", [0.0, 0.013])
def test_tones_from_rest_are_the_limit_of_fine_samples(published, plant, wheel, start):
    """Rigid-body modes included: a steady state plus the drift that starting from rest leaves, from any first instant."""
    diagram, tones = line_of_sight_diagram(published, plant, signals=("spot", "tilt")), wheel_tones(wheel, 20.0)
    t = start + np.linspace(0, 0.2, 20001)
    assert relative(simulate(diagram, t, tones).outputs, simulate(diagram, t, tone_signal(tones, t)).outputs) < 1e-5


@pytest.mark.parametrize("closed", [True, False])
def test_steady_state_start_has_the_harmonic_rms(published, plant, wheel, closed):
    """Time = frequency (Parseval over one turn of the wheel), rigid-body modes included: no drift, no settling."""
    diagram, tones = line_of_sight_diagram(published, plant, closed=closed), wheel_tones(wheel, 20.0)
    t = np.arange(2000) * (0.05 / 2000)
    spot = simulate(diagram, t, tones, initial="steady_state").outputs
    amplitude = harmonic_response(diagram, tones)
    expected = rms(Tones(frequency_hz=tones.frequency_hz, amplitude=amplitude.values, inputs=["x", "y"]))
    assert np.sqrt((spot**2).mean("time")).values == pytest.approx(expected, rel=1e-9, abs=0)


def test_a_steady_state_stays_one_when_stepped(published, plant, wheel):
    """Start the sampled simulation on the steady state: it follows the tones to the accuracy of the hold."""
    diagram, tones = line_of_sight_diagram(published, plant), wheel_tones(wheel, 20.0)
    t = np.linspace(0, 0.05, 10001)
    steady = simulate(diagram, t, tones, initial="steady_state")
    # one turn of the wheel later the state is what it was
    stepped = simulate(diagram, t, tone_signal(tones, t), initial=steady.final_state.values)
    assert relative(stepped.outputs, steady.outputs) < 1e-5
    assert relative(stepped.final_state, steady.final_state) < 1e-5


def test_long_simulation_from_rest_settles_to_the_harmonic_rms(published, make_plant, wheel):
    flexible = without_rigid_body(make_plant(zeta=0.05))
    diagram, tones = line_of_sight_diagram(published, flexible, closed=False), wheel_tones(wheel, 20.0)
    t = np.arange(60_001) * 5e-5
    spot = simulate(diagram, t, tone_signal(tones, t)).outputs[:, -20_000:]
    expected = np.sqrt((abs(harmonic_response(diagram, tones)) ** 2).sum("frequency") / 2)
    assert np.sqrt((spot**2).mean("time")).values == pytest.approx(expected.values, rel=1e-4, abs=0)


def test_free_fall_of_a_rigid_body():
    """Constant force on a free mass: x = F t^2 / (2 m), exact to round-off at any step."""
    mass = 4.0
    body = ModalPlant(omega=[0.0], zeta=0.0, shape_in=[[mass**-0.5]], shape_out=[[mass**-0.5]], inputs=["f"], outputs=["x"])
    t = np.arange(50) * 0.7
    assert simulate(body, t, {"f": 3.0}).outputs[0].values == pytest.approx(3.0 * t**2 / (2 * mass), rel=1e-13, abs=1e-13)


def test_feedback_into_the_structure():
    """A plant inside the loop goes through the dense path: a mass on an active spring is an oscillator."""
    body = ModalPlant(omega=[0.0], zeta=0.0, shape_in=[[1.0]], shape_out=[[1.0]], inputs=["f"], outputs=["x"])
    w = 7.0
    diagram = Diagram(
        blocks={"sum": summing_junction("++", output_name="f"), "body": body, "spring": gain(-(w**2))},
        connections=[("sum.f", "body.f"), ("body.x", "spring.u"), ("spring.y", "sum.in2")],
        inputs={"f": "sum.in1"},
        outputs={"x": "body.x"},
    )
    assert cascade_of(diagram).omega.size == 0
    t = np.arange(300) * 0.05
    assert simulate(diagram, t, initial=[1.0, 0.0]).outputs[0].values == pytest.approx(np.cos(w * t), abs=1e-11)


def test_full_modal_damping_goes_through_the_dense_path(published, make_plant, wheel):
    """A full matrix that happens to be diagonal gives what damping ratios give; so does the descriptor form."""
    plant = make_plant(n_flexible=4)
    full = replace(plant, damping=np.diag(2 * plant.zeta * plant.omega))
    system = state_space(plant)
    descriptor = Descriptor(np.eye(system.n_states), system.A, system.B, system.C, system.D, plant.inputs, plant.outputs)
    t = np.arange(300) * 2e-4
    u = wheel_disturbance(wheel, 20.0, t)
    assert cascade_of(full).omega.size == 0
    expected = simulate(plant, t, u).outputs
    assert relative(simulate(full, t, u).outputs, expected) < 1e-10
    assert relative(simulate(descriptor, t, u).outputs, expected) < 1e-10
    loops = [simulate(line_of_sight_diagram(published, p), t, u).outputs for p in (full, plant)]
    assert relative(*loops) < 1e-7


def test_discrete_loop_steps_by_its_own_matrices():
    diagram = Diagram(
        blocks={"delay": sample_delay(3, 0.1), "k": gain(2.0)},
        connections=[("delay.y", "k.u")],
        inputs={"u": "delay.u"},
        outputs={"y": "k.y"},
    )
    u = np.random.default_rng(0).normal(size=200)
    y = simulate(diagram, np.arange(200) * 0.1, u).outputs[0].values
    assert y[3:] == pytest.approx(2 * u[:-3], rel=1e-15)
    assert not y[:3].any()
    with pytest.raises(InputError, match=r"dt = 0\.1 s, but time advances by 0\.2"):
        simulate(diagram, np.arange(9) * 0.2, np.zeros(9))


def test_instants_in_single_precision_stand_for_even_ones(plant):
    t = np.arange(3000) * 5e-4
    u = np.sin(20 * t)
    expected = simulate(plant, t, {plant.inputs[0]: u})
    found = simulate(plant, t.astype(np.float32), {plant.inputs[0]: u})
    assert relative(found.outputs, expected.outputs) < 1e-4
    assert np.ptp(np.diff(found.time)) < 1e-12


def test_discrete_steady_state():
    system = transfer_function([0.2], [1.0, -0.8], dt=1e-3)
    tones = Tones(frequency_hz=[10.0, 70.0], amplitude=[[1.0, 2j]], inputs=["u"])
    t = np.arange(2000) * 1e-3
    steady = simulate(system, t, tones, initial="steady_state").outputs
    rest = simulate(system, t, tone_signal(tones, t)).outputs
    assert steady[0, 500:].values == pytest.approx(rest[0, 500:].values, abs=1e-12)


def test_result_carries_names_units_and_final_state(published, plant, wheel):
    diagram = line_of_sight_diagram(published, plant, signals=("spot", "angle"))
    t = np.arange(100) * 5e-4
    result = simulate(diagram, t, {"bus.9001.1": np.sin(t)}, outputs=["angle_y", "spot_x"])
    assert list(result["output"].values) == ["angle_y", "spot_x"]
    assert list(result["output_units"].values) == ["rad", "m"]
    assert list(result["input_units"].values[[0, 3]]) == ["N", "N m"]
    assert not result.inputs.sel(input="bus.9001.2").any()
    # the final state continues the run
    first, second = simulate(diagram, t[:40], result.inputs[:, :40]), slice(39, None)
    rest = simulate(diagram, t[second], result.inputs[:, second], initial=first.final_state.values)
    assert relative(rest.outputs.sel(output=["angle_y", "spot_x"]), result.outputs[:, second]) < 1e-9


def test_without_rigid_body_leaves_only_the_drift_out(plant, wheel):
    t = np.arange(300) * 1e-4
    u = wheel_disturbance(wheel, 40.0, t)
    rigid = plant.omega == 0
    body = ModalPlant(
        omega=plant.omega[rigid],
        zeta=0.0,
        shape_in=plant.shape_in[rigid],
        shape_out=plant.shape_out[:, rigid],
        inputs=plant.inputs,
        outputs=plant.outputs,
    )
    parts = simulate(without_rigid_body(plant), t, u).outputs + simulate(body, t, u).outputs
    assert relative(parts, simulate(plant, t, u).outputs) < 1e-12
    assert without_rigid_body(plant).report["rigid_body_modes_left_out"] == 6


T = np.arange(5) * 0.1
BODY = ModalPlant(omega=[0.0, 3.0], zeta=0.0, shape_in=[[1.0], [1.0]], shape_out=[[1.0, 1.0]], inputs=["f"], outputs=["x"])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: simulate(BODY, [0, 1, 3], np.zeros(3)), "not uniform"),
        (lambda: simulate(BODY, [0.0], [0.0]), "at least two"),
        (lambda: simulate(BODY, T, progress=5), "progress must be a function"),
        (lambda: simulate(BODY, (1000 + T * 1e-5).astype(np.float32)), "float32 is too coarse for them"),
        (lambda: simulate(BODY, np.array([0, 1, 2.01], dtype=np.float32)), "not uniform"),
        (lambda: simulate(BODY, T[::-1]), "not uniform and increasing"),
        (lambda: simulate(BODY, T, np.zeros((2, 5))), r"shape \(2, 5\), but \(1 inputs, 5 instants\)"),
        (lambda: simulate(BODY, T, {"g": 1.0}), "no input 'g'"),
        (lambda: simulate(BODY, T, [0, np.inf, 1, -np.inf, 0]), "'f' has values that are not finite"),
        (lambda: simulate(BODY, T, {"f": [1.0, 2.0]}), r"input 'f' has shape \(2,\)"),
        (lambda: simulate(BODY, T, [0, 0, np.nan, 0, 0]), "'f' has values that are not finite"),
        (lambda: simulate(BODY, T, xr.DataArray(np.zeros((1, 5)), dims=("a", "time"))), "dims input and time"),
        (lambda: simulate(BODY, T, outputs=["y"]), "no output 'y'"),
        (lambda: simulate(BODY, T, outputs=5), "outputs must be a list of names such as .*, got 5"),
        (lambda: simulate(BODY, T, outputs=[5]), "outputs must be a list of names"),
        (lambda: simulate(BODY, np.asarray(T) + 1j), "time: real numbers"),
        (lambda: simulate(BODY, "1 s"), "time: real numbers"),
        (lambda: simulate(BODY, T, np.ones(5) * 1j), "inputs: real numbers"),
        (lambda: simulate(BODY, T, {"f": [1, [2]]}), "input 'f': real numbers"),
        (lambda: simulate(BODY, T, {"f": np.sin}), "input 'f': real numbers"),
        (lambda: simulate(BODY, T, initial=1j * np.ones(4)), "initial state: real numbers"),
        (lambda: simulate(BODY, T, initial="steady_state"), "Tones"),
        (lambda: simulate(BODY, T, initial="here"), "'rest'"),
        (lambda: simulate(BODY, T, initial=[1.0]), "4 finite values"),
        (lambda: simulate(BODY, T, hold="second"), "hold.*'second'"),
        (lambda: simulate("plant", T), "cannot simulate a str"),
        (lambda: simulate(BODY, T, Tones(frequency_hz=[0.0], amplitude=[[1.0]], inputs=["f"])), r"no steady state.*0 Hz.*mode 0"),
        (lambda: simulate(BODY, T, Tones(frequency_hz=[1.0], amplitude=[[1.0]], inputs=["g"])), "no input 'g'"),
    ],
)
def test_errors(call, message):
    with pytest.raises(InputError, match=message):
        call()


@pytest.mark.parametrize("plant_first", [True, False])
def test_the_final_state_stands_in_the_diagrams_own_order(plant_first):
    """A listening plant and a filter behind it, in either order: the state is that of the closed system, and starts it again."""
    plant = ModalPlant(omega=[5.0, 9.0], zeta=0.02, shape_in=[[1.0], [0.5]], shape_out=[[1.0, 2.0]], inputs=["f"], outputs=["y"])
    lag = StateSpace(np.array([[-3.0]]), np.array([[2.0]]), np.array([[1.0]]), np.zeros((1, 1)), ["in"], ["out"])
    blocks = {"plant": plant, "lag": lag} if plant_first else {"lag": lag, "plant": plant}
    wires = {"connections": [("plant.y", "lag.in")], "inputs": {"f": "plant.f"}, "outputs": {"z": "lag.out", "y": "plant.y"}}
    diagram = Diagram(blocks=blocks, **wires)
    t, u = np.arange(301) * 0.01, np.random.default_rng(3).normal(size=(1, 301))
    whole = simulate(diagram, t, u, hold="zero")
    step = discretize(close(diagram), 0.01, hold="zero")
    x = np.zeros(step.n_states)
    for value in u[0, :-1]:
        x = step.A @ x + step.B @ [value]
    np.testing.assert_allclose(whole.final_state.values, x, atol=1e-12 * abs(x).max())
    again = simulate(
        diagram, t[:101], u[:, 200:], initial=simulate(diagram, t[:201], u[:, :201], hold="zero").final_state, hold="zero"
    )
    np.testing.assert_allclose(again.outputs.values, whole.outputs.values[:, 200:], atol=1e-12 * abs(whole.outputs.values).max())


@pytest.mark.parametrize("empty", [{"inputs": []}, {"outputs": []}, {"inputs": [], "outputs": []}])
def test_a_plant_without_channels_has_empty_results(empty):
    body = ModalPlant(
        omega=[0.0, 30.0], zeta=[0.0, 0.01], shape_in=np.eye(2), shape_out=np.eye(2), inputs=["f", "g"], outputs=["x", "y"]
    )
    part = select(body, **empty)
    sizes = {"output": len(part.outputs), "input": len(part.inputs)}
    assert simulate(part, T).sizes == {**sizes, "time": T.size, "state": 4}
    assert next(simulate_stream(part, dt=0.1, samples=9)).sizes == {"output": sizes["output"], "time": 9, "state": 4}
    flexible = select(replace(body, omega=[10.0, 30.0], zeta=[0.1, 0.1]), **empty)
    spectra = random_response(flexible, dict.fromkeys(flexible.inputs, 1.0), [1.0, 2.0, 3.0])
    assert spectra.psd.shape == (sizes["output"], 3)
    assert not empty.get("inputs", True) or not spectra.rms.values.any()
