"""Nonlinear and digital blocks in the loop: against all-discrete systems, hand-written steps, and fine integration."""

import numba
import numpy as np
import pytest
import scipy.integrate

from flexplant.blocks.basic import gain, summing_junction
from flexplant.blocks.delay import sample_delay
from flexplant.blocks.sampled import dead_zone, quantiser, rate_limiter, saturation, user_block
from flexplant.blocks.transfer_function import transfer_function
from flexplant.errors import DiagramError, InputError
from flexplant.loop import hybrid_recursion
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.frequency import frequency_response
from flexplant.loop.hybrid import hybrid_of
from flexplant.loop.monodromy import multipliers
from flexplant.loop.simulate import simulate
from flexplant.plant.discretize import discretize
from flexplant.plant.modal import ModalPlant

DT = 1e-3


def structure(n=9, seed=0):
    rng = np.random.default_rng(seed)
    return ModalPlant(
        omega=np.r_[0.0, np.sort(rng.uniform(20, 900, n - 1))],
        zeta=0.02,
        shape_in=rng.normal(size=(n, 2)),
        shape_out=rng.normal(size=(2, n)),
        inputs=["f", "d"],
        outputs=["y", "z"],
    )


def servo(plant, controller, *, filters=None):
    """d -> plant -> y -> [blocks in a row] -> f, the feedback path made of the given blocks."""
    chain = {"controller": controller, **(filters or {})}
    ports = ["plant.y"]
    wires = []
    for name, block in chain.items():
        wires.append((ports[-1], f"{name}.{block.inputs[0]}"))
        ports.append(f"{name}.{block.outputs[0]}")
    wires.append((ports[-1], "plant.f"))
    outputs = {"y": "plant.y", "z": "plant.z", "f": ports[-1]}
    return Diagram(blocks={"plant": plant, **chain}, connections=wires, inputs={"d": "plant.d"}, outputs=outputs)


def disturbance(nt, scale=1.0):
    return scale * np.random.default_rng(7).normal(size=nt)


def close_to(a, b, tolerance=1e-11):
    return float(abs(np.asarray(a) - b).max()) <= tolerance * float(abs(np.asarray(b)).max())


LEAD = transfer_function([-3.0, 2.0], [1.0, -0.3], dt=DT)


def test_digital_controller_on_a_continuous_plant_is_the_discrete_loop():
    """Zero-order hold makes both exact at the samples: mixed sample times against everything at one dt."""
    nt = 800
    mixed = simulate(servo(structure(), LEAD), np.arange(nt) * DT, disturbance(nt), hold="zero")
    discrete = simulate(servo(discretize(structure(), DT), LEAD), np.arange(nt) * DT, disturbance(nt), unstable="allow")
    assert close_to(mixed.outputs, discrete.outputs.values)


@pytest.mark.parametrize("rate", [2, 5])
def test_slow_controller_is_the_slow_discrete_loop_at_its_samples(rate):
    nt = 600
    slow = transfer_function([-3.0, 2.0], [1.0, -0.3], dt=rate * DT)
    held = np.repeat(disturbance(nt // rate), rate)
    fine = simulate(servo(structure(), slow), np.arange(nt) * DT, held, hold="zero", every=rate)
    plant = discretize(structure(), rate * DT)
    coarse = simulate(servo(plant, slow), np.arange(nt // rate) * rate * DT, held[::rate], unstable="allow")
    assert fine.outputs.dims == ("output", "output_time")
    assert close_to(fine.outputs, coarse.outputs.values, 1e-10)


def test_delay_in_samples():
    nt = 300
    mixed = simulate(
        servo(structure(), LEAD, filters={"delay": sample_delay(3, DT)}), np.arange(nt) * DT, disturbance(nt), hold="zero"
    )
    plant = discretize(structure(), DT)
    discrete = simulate(
        servo(plant, LEAD, filters={"delay": sample_delay(3, DT)}), np.arange(nt) * DT, disturbance(nt), unstable="allow"
    )
    assert close_to(mixed.outputs, discrete.outputs.values, 1e-10)


LAWS = {
    "saturation": (saturation(-0.3, 0.5), lambda u, s: (min(max(u, -0.3), 0.5), s)),
    "dead zone": (dead_zone(-0.3, 0.5), lambda u, s: (u - min(max(u, -0.3), 0.5), s)),
    "quantiser": (quantiser(0.25), lambda u, s: (0.25 * np.floor(u / 0.25 + 0.5), s)),
    "rate limiter": (rate_limiter(-40.0, 60.0), lambda u, s: (s + min(max(u - s, -0.04), 0.06),) * 2),
}


@pytest.mark.parametrize("law", list(LAWS))
def test_laws_against_hand_written_steps(law):
    """x[k+1] = F x + G u with the law in between, written out; and the user's own function gives the same."""
    block, formula = LAWS[law]
    nt, plant = 500, structure()
    step, d, s = discretize(plant, DT), disturbance(500, 30.0), 0.0
    x, expected = np.zeros(step.n_states), []
    for k in range(nt):
        y = step.C @ x
        f, s = formula(-400.0 * y[0], s)
        expected.append([*y, f])
        x = step.A @ x + step.B @ [f, d[k]]
    loop = servo(plant, gain(-400.0), filters={"law": block})
    found = simulate(loop, np.arange(nt) * DT, d, hold="zero")
    assert close_to(found.outputs, np.array(expected).T)
    assert np.unique(np.array(expected)[:, 2]).size > 3

    def function(t, u, state):
        y, state = formula(u[0], state[0])
        return np.array([y]), np.array([state])

    own = user_block(function, inputs=["u"], outputs=["y"], initial=[0.0])
    again = simulate(servo(plant, gain(-400.0), filters={"law": own}), np.arange(nt) * DT, d, hold="zero")
    assert close_to(again.outputs, found.outputs.values, 1e-12)


def test_compiled_steps_equal_plain_ones(monkeypatch):
    filters = {"law": saturation(-0.5, 0.5), "delay": sample_delay(2, DT), "coarse": quantiser(0.01)}
    loop = servo(structure(), LEAD, filters=filters)
    t, d = np.arange(300) * DT, disturbance(300, 50.0)
    first = simulate(loop, t, d)
    monkeypatch.setattr(hybrid_recursion, "numba", lambda: None)
    second = simulate(loop, t, d)
    assert close_to(first.outputs, second.outputs.values, 1e-12)
    assert close_to(first.final_state, second.final_state.values, 1e-12)


def limited_rate(t, u, state):
    y = state[0] + min(max(u[0] - state[0], -0.04), 0.06)
    return np.array([y]), np.array([y])


def with_function(function, nt=6000, initial=(0.0,), scale=30.0):
    own = user_block(function, inputs=["u"], outputs=["y"], initial=initial)
    return simulate(servo(structure(), gain(-400.0), filters={"law": own}), np.arange(nt) * DT, disturbance(nt, scale))


def test_functions_are_compiled_into_the_loop_where_numba_can():
    """The block made of it, the function compiled by hand or by itself in a long run, and one that only Python can call."""
    log, block = [], LAWS["rate limiter"][0]
    loop = servo(structure(), gain(-400.0), filters={"law": block})
    expected = simulate(loop, np.arange(6000) * DT, disturbance(6000, 30.0))

    def logged(t, u, state):
        log.append(t)
        return limited_rate(t, u, state)

    for function, in_python in ((limited_rate, False), (numba.njit(limited_rate), False), (logged, True)):
        found = with_function(function)
        assert found.attrs.get("called_in_python", "") == ("law" if in_python else "")
        assert close_to(found.outputs, expected.outputs.values, 1e-12)
        assert close_to(found.final_state, expected.final_state.values, 1e-12)
    assert log[:6000] == pytest.approx(np.arange(6000) * DT)
    assert with_function(limited_rate, nt=300).attrs["called_in_python"] == "law"


def test_functions_without_a_state_may_return_a_number():
    expected = with_function(numba.njit(lambda t, u: np.array([min(u[0], 0.4)])), nt=50, initial=None)
    found = with_function(numba.njit(lambda t, u: min(u[0], 0.4)), nt=50, initial=None)
    assert np.array_equal(found.outputs, expected.outputs)


def test_random_numbers_stay_under_the_seed_of_numpy():
    def noisy(t, u):
        return np.array([np.random.normal()])  # noqa: NPY002

    np.random.seed(3)  # noqa: NPY002
    found = with_function(noisy, initial=None)
    np.random.seed(3)  # noqa: NPY002
    assert found.outputs[2, 0] == np.random.normal()  # noqa: NPY002


def outside(t, u):
    return np.array([u[1 if t > 0.5 else 0]])


def silent(t, u):
    return None if t > 0.5 else 0.25


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda t, u: np.zeros(2), r"at t = 0 s: shapes \(2,\), \(0,\)"),
        (lambda t, u: np.sqrt(u - u - (t > 0.5)), r"at t = 0\.501 s: returned values that are not finite"),
        (
            lambda t, u: np.array([1.0 / (0.0 if t > 0.5 else 1.0)]),
            r"at t = 0\.501 s: the function raised ZeroDivisionError: .*zero",
        ),
        (outside, r"at t = 0\.501 s: the function raised IndexError: index .*is out of bounds"),
        (silent, r"at t = 0\.501 s: the function returned None; return values on every path"),
    ],
)
def test_a_compiled_function_fails_as_in_python(function, message, capfd):
    for compiled in (numba.njit(function), function):
        with pytest.raises(InputError, match=rf"^user block '\w+' {message}"):
            with_function(compiled, nt=600, initial=None)
    assert not capfd.readouterr().err


def test_a_compiled_function_may_not_write_outside_its_state():
    def law(t, u, x):
        x[2] = t
        return u, x

    with pytest.raises(InputError, match=r"IndexError: index 2 is out of bounds for axis 0 with size 1"):
        with_function(law)


@pytest.mark.parametrize("rate", [1, 3])
def test_multipliers_are_the_poles_of_the_discrete_loop(rate):
    slow = transfer_function([-3.0, 2.0], [1.0, -0.3], dt=rate * DT)
    found = multipliers(hybrid_of(servo(structure(), slow)), DT, rate)
    expected = np.linalg.eigvals(close(servo(discretize(structure(), rate * DT), slow)).A)
    assert found.size == expected.size
    assert abs(found[:, None] - expected).min(axis=1).max() < 1e-9
    assert abs(found[:, None] - expected).min(axis=0).max() < 1e-9


def test_a_sampled_loop_that_grows_is_refused_before_it_runs():
    unstable = servo(structure(), transfer_function([-3e4, 2.0], [1.0, -0.3], dt=2 * DT))
    t = np.arange(50) * DT
    with pytest.raises(InputError, match=r"unstable: multiplier z = .* over 0\.002 s, outside the unit circle"):
        simulate(unstable, t)
    grown = abs(simulate(unstable, np.arange(800) * DT, disturbance(800), unstable="allow").outputs[0].values)
    assert grown[-100:].max() > 100 * grown[:100].max()
    with pytest.raises(InputError, match="not a choice"):
        simulate(unstable, t, unstable="maybe")


def test_a_loop_that_overflows_says_where_and_when():
    growing = transfer_function([-1e9], [1.0, -0.3], dt=DT)
    for monitor in ({"clip": saturation(-np.inf, np.inf)}, {"own": user_block(lambda t, u: u, inputs=["u"], outputs=["y"])}):
        loop = servo(structure(), growing, filters=monitor)
        with pytest.raises(InputError, match=r"(block|overflow).*t = 0\.\d+ s.*unstable"):
            simulate(loop, np.arange(900) * DT, disturbance(900), unstable="allow")


def los_like(law, plant):
    """A plant that only listens, with a saturated mirror loop beside it, and the same loop without the law."""
    blocks = {"plant": plant, "error": summing_junction("+-"), "law": law, "mirror": transfer_function([900.0], [1.0, 30.0, 0.0])}
    wires = [
        ("plant.y", "error.in1"),
        ("mirror.y", "error.in2"),
        ("error.sum", f"law.{law.inputs[0]}"),
        ("law." + law.outputs[0], "mirror.u"),
    ]
    return Diagram(
        blocks=blocks, connections=wires, inputs={"f": "plant.f", "d": "plant.d"}, outputs={"e": "error.sum", "m": "mirror.y"}
    )


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_listening_modes_are_stepped_ahead(hold):
    """Against the same modes stepped in the loop: a block that reaches the plant with zero gain keeps them there."""
    law, plant, nt = saturation(-1e-4, 2e-4), structure(), 700
    ahead = los_like(law, plant)
    inside = Diagram(
        blocks={**ahead.blocks, "none": gain(0.0), "add": summing_junction("++", name="add"), "held": quantiser(1e9)},
        connections=[
            *ahead.connections,
            ("mirror.y", "held.u"),
            ("held.y", "none.u"),
            ("none.y", "add.in2"),
            ("add.sum", "plant.f"),
        ],
        inputs={"f": "add.in1", "d": "plant.d"},
        outputs=ahead.outputs,
    )
    t, u = np.arange(nt) * DT, np.random.default_rng(1).normal(size=(2, nt))
    a, b = (simulate(diagram, t, u, hold=hold) for diagram in (ahead, inside))
    assert close_to(a.outputs, b.outputs.values)


def test_nonlinear_loop_converges_to_the_continuous_law():
    """First order in the step, against an integrator that takes the law inside."""
    loop = los_like(saturation(-2e-3, 1e-3), structure())
    linear = Diagram(
        blocks={k: v for k, v in loop.blocks.items() if k != "law"},
        connections=[c for c in loop.connections if "law" not in c[0] + c[1]],
        inputs={"f": "plant.f", "d": "plant.d", "v": "mirror.u"},
        outputs=loop.outputs,
    )
    system = close(linear)

    def slope(t, x):
        forces = np.array([np.sin(50 * t), 0.0])
        error = (system.C @ x)[0]
        return system.A @ x + system.B @ np.r_[forces, min(max(error, -2e-3), 1e-3)]

    exact = scipy.integrate.solve_ivp(slope, (0, 0.2), np.zeros(system.n_states), rtol=1e-9, atol=1e-13, max_step=1e-3).y[:, -1]
    errors = []
    for n in (400, 800, 1600):
        t = np.linspace(0, 0.2, n + 1)
        errors.append(abs(simulate(loop, t, {"f": np.sin(50 * t)}).final_state.values - exact)[-2:].max())
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx([1, 1], abs=0.15)


def test_progress_and_stopping():
    seen = []
    t = np.arange(60_000) * DT
    whole = simulate(structure(), t, {"d": disturbance(t.size)}, progress=lambda done, total: seen.append((done, total)), every=7)
    assert seen[-1] == (60_000, 60_000)
    assert len(seen) > 1
    assert np.array_equal(whole.output_time, t[::7])

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(structure(), t, progress=stop)


def unstable_loop():
    return servo(structure(), transfer_function([50.0], [1.0, 1.0]))


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: saturation(1.0, -1.0), InputError, "lower one must not exceed"),
        (lambda: saturation([0, 1], [1, 2, 3], channels=2), InputError, "one value or one a channel"),
        (lambda: quantiser(0.0), InputError, "must be positive"),
        (lambda: rate_limiter(1.0, 2.0), InputError, "fall < 0 < rise"),
        (lambda: quantiser(1.0, dt=-1.0), InputError, "positive number of seconds"),
        (lambda: user_block(3, inputs=["u"], outputs=["y"]), InputError, "cannot be called"),
        (lambda: close(servo(structure(), LEAD)), DiagramError, r"mixed sample times \(plant: continuous, controller: 0.001 s\)"),
        (
            lambda: frequency_response(servo(structure(), saturation(-1, 1)), [1.0]),
            DiagramError,
            r"nonlinear blocks \(controller\)",
        ),
        (lambda: simulate(servo(structure(), LEAD), np.arange(9) * 7e-4), InputError, "not a whole multiple of the time step"),
        (lambda: simulate(unstable_loop(), np.arange(9) * DT), InputError, r"unstable: pole .*rad/s.*doubles every"),
        (lambda: simulate(structure(), np.arange(9) * DT, every=0), InputError, "every .* must be a whole number from 1, got 0"),
        (lambda: simulate(structure(), np.arange(9) * DT, unstable="no"), InputError, "unstable='no'"),
        (lambda: simulate(servo(structure(), LEAD), np.arange(9) * DT, initial=[1.0]), InputError, "19 finite values"),
    ],
)
def test_sampled_errors(call, error, message):
    with pytest.raises(error, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda t, u: np.zeros(2), r"shapes \(2,\)"),
        (lambda t, u: [np.nan], "not finite"),
    ],
)
def test_user_functions_are_checked(function, message):
    block = user_block(function, inputs=["u"], outputs=["y"], name="mine")
    with pytest.raises(InputError, match=rf"'mine' at t = 0 s.*{message}"):
        simulate(servo(structure(), block), np.arange(9) * DT)


def test_sampled_loop_without_delay_is_refused():
    blocks = {"a": saturation(-1, 1), "b": quantiser(0.1)}
    with pytest.raises(DiagramError, match="algebraic loop"):
        Diagram(blocks=blocks, connections=[("a.y", "b.u"), ("b.y", "a.u")], outputs={"y": "b.y"})
    loose = Diagram(blocks=blocks, connections=[("a.y", "b.u"), ("b.y", "a.u")], outputs={"y": "b.y"}, allow_algebraic_loops=True)
    with pytest.raises(DiagramError, match="loop without a delay: "):
        simulate(loose, np.arange(9) * DT)


def test_unresolved_mode_warns_with_numbers():
    with pytest.warns(UserWarning, match=r"time step 0\.05 s does not resolve the fastest mode"):
        simulate(structure(), np.arange(9) * 0.05)
