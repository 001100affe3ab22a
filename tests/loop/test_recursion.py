"""The lifted recursion: against stepping one by one, in any chunk, decimated, compiled or not."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from flexplant.blocks.delay import sample_delay
from flexplant.loop import fused, layout, lifted, recursion, tiled
from flexplant.loop.cascade import cascade_of
from flexplant.loop.line_of_sight import line_of_sight_diagram
from flexplant.loop.stepping import stepper
from flexplant.plant.modal import ModalPlant


def one_by_one(cascade, dt, w, state, hold):
    """The defining recursion, in the sorted order of states."""
    one = stepper(cascade, dt, hold)
    rows, x, out = np.hstack([cascade.C_modes, cascade.C]), state.copy(), []
    for k in range(w.shape[1]):
        out.append(rows @ x + cascade.D @ w[:, k])
        if k + 1 < w.shape[1]:
            x = lifted.stepped(one, x[None])[0] + np.r_[w[:, k], w[:, k + 1] - w[:, k]] @ one.drive
    return np.array(out).T, x


ENGINES = {"lifted": recursion.Recursion, "fused": fused.FusedRecursion}


def march(cascade, dt, w, state, hold, every=1, engine="lifted"):
    runner = ENGINES[engine](cascade, dt, state, hold, every)
    return recursion.march(runner, w, w.shape[1], cascade.D.shape[::-1], every)


def error(a, b):
    return float(abs(a - b).max() / abs(b).max())


@pytest.mark.parametrize("engine", list(ENGINES))
@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("every", [1, 3, 25, 64, 509])
def test_blocks_equal_one_by_one(published, make_plant, hold, every, engine):
    cascade = cascade_of(line_of_sight_diagram(published, make_plant(n_rigid=0), signals=("spot", "angle", "tilt")))
    rng = np.random.default_rng(3)
    w, state = rng.normal(size=(6, 1200)), rng.normal(size=cascade.n_states) * 1e-7
    order = np.r_[cascade.modal_states, cascade.other_states]
    outputs, final = one_by_one(cascade, 2e-4, w, state[order], hold)
    run = march(cascade, 2e-4, w, state, hold, every, engine)
    assert error(run.outputs, outputs[:, ::every]) < 1e-12
    assert error(run.final_state[order], final) < 1e-12


@pytest.mark.parametrize("engine", list(ENGINES))
@pytest.mark.parametrize("zeta", [0.0, 1e-4, 0.5, 1.0])
def test_slow_modes_near_one(zeta, engine):
    """Modes whose z is within 1e-9 of 1, and rigid-body modes, at any damping."""
    omega = np.array([0.0, 1e-6, 1e-3, 0.1, 30.0, 2e3])
    rng = np.random.default_rng(0)
    plant = ModalPlant(
        omega=omega, zeta=zeta, shape_in=rng.normal(size=(6, 2)), shape_out=np.eye(6), inputs=["a", "b"], outputs=list("123456")
    )
    cascade, w, state = cascade_of(plant), rng.normal(size=(2, 3000)), np.zeros(12)
    outputs, _ = one_by_one(cascade, 1e-3, w, state, "first")
    run = march(cascade, 1e-3, w, state, "first", engine=engine)
    assert (abs(run.outputs - outputs).max(axis=1) <= 1e-12 * abs(outputs).max(axis=1)).all()


def test_compiled_and_plain_recursion_agree(published, plant):
    rng = np.random.default_rng(1)
    cascade = cascade_of(line_of_sight_diagram(published, plant))
    made = recursion.Recursion(cascade, 1e-4, np.zeros(cascade.n_states), "zero")
    driven = rng.normal(size=(40, cascade.n_states))
    results = []
    for kernel in (lifted.block_starts, lifted.block_starts.fallback, lifted.block_starts.loops):
        x, starts = np.ones(cascade.n_states), np.empty_like(driven)
        kernel(*made._long, driven, x, starts)
        results.append(np.vstack([starts, x]))
    assert error(results[0], results[1]) < 1e-13
    assert error(results[2], results[1]) < 1e-13


@pytest.mark.parametrize("engine", list(ENGINES))
def test_discrete_systems_are_stepped_too(engine):
    delay = sample_delay(7, 0.1)
    w = np.random.default_rng(0).normal(size=(1, 500))
    run = march(cascade_of(delay), 0.1, w, np.zeros(7), "first", 10, engine)
    assert np.array_equal(run.outputs[0, 1:], w[0, 3:-7:10])


@pytest.mark.parametrize("n", [1, 16, 17])
@pytest.mark.parametrize(("nu", "ny"), [(1, 1), (9, 3), (2, 11)])
def test_any_number_of_modes_inputs_and_outputs(n, nu, ny):
    """Padded to whole lanes, with velocities, accelerations, static parts and rows that are multiples of one another."""
    rng = np.random.default_rng(n)
    rows = {f"shape_out{kind}": rng.normal(size=(ny, n)) for kind in ("", "_velocity", "_acceleration")}
    rows = {kind: np.where(np.arange(ny)[:, None] == 1, -3 * values[:1], values) for kind, values in rows.items()}
    plant = ModalPlant(
        omega=np.r_[0.0, rng.uniform(1, 2000, n - 1)],
        zeta=rng.uniform(0, 1, n),
        shape_in=rng.normal(size=(n, nu)),
        static_correction=rng.normal(size=(ny, nu)),
        inputs=[f"u{k}" for k in range(nu)],
        outputs=[f"y{k}" for k in range(ny)],
        **rows,
    )
    cascade, w, state = cascade_of(plant), rng.normal(size=(nu, 203)), rng.normal(size=2 * n)
    for hold in ("zero", "first"):
        outputs, final = one_by_one(cascade, 1e-3, w, state, hold)
        run = march(cascade, 1e-3, w, state, hold, engine="fused")
        assert (abs(run.outputs - outputs).max(axis=1) <= 1e-12 * abs(outputs).max(axis=1)).all()
        assert error(run.final_state, final) < 1e-12


@pytest.mark.parametrize(("still", "moving"), [(1, 0), (6, 0), (0, 1), (3, 2), (2, 4), (7, 0), (5, 6), (9, 9), (25, 0)])
def test_rows_are_summed_in_registers(still, moving):
    """Any mixture of rows with and without velocities, resumed after any number of samples; 25 rows are too many."""
    rng, n, ny = np.random.default_rng(still), 21, still + moving
    plant = ModalPlant(
        omega=np.r_[0.0, rng.uniform(1, 2000, n - 1)],
        zeta=rng.uniform(0, 1, n),
        shape_in=rng.normal(size=(n, 3)),
        shape_out=rng.normal(size=(ny, n)),
        shape_out_velocity=rng.normal(size=(ny, n)) * (np.arange(ny) >= still)[:, None],
        inputs=list("abc"),
        outputs=[f"y{k}" for k in range(ny)],
    )
    cascade, w, state = cascade_of(plant), rng.normal(size=(3, 120)), rng.normal(size=2 * n)
    expected, final = one_by_one(cascade, 1e-3, w, state, "first")
    runner, at, parts = fused.FusedRecursion(cascade, 1e-3, state, "first"), 0, []
    assert isinstance(runner._steps, tiled.TileSteps) == (ny <= tiled.MOST_ROWS)
    for count in (1, 7, 40, 3, 66, 2):
        parts.append(runner.run(w[:, at : at + count + 1].T, count))
        at += count
    outputs = np.vstack([*parts, runner.last(w[:, -1])]).T
    assert (abs(outputs - expected).max(axis=1) <= 1e-12 * abs(expected).max(axis=1)).all()
    assert error(runner.state, final) < 1e-12


@pytest.mark.parametrize("first", [0.0, 1e-70, 1e-12, 1.0])
def test_a_mode_that_the_first_input_hardly_drives(first):
    """Modes are counted in what the first input adds to them: nothing, next to nothing, and modes that no input drives."""
    rng, n = np.random.default_rng(0), 11
    shape = rng.normal(size=(n, 3))
    shape[::2, 0] *= first
    shape[4] = 0.0
    plant = ModalPlant(
        omega=np.r_[0.0, rng.uniform(1, 2000, n - 1)], zeta=0.01, shape_in=shape, shape_out=np.eye(n), inputs=list("abc"),
        outputs=[f"y{k}" for k in range(n)],
    )  # fmt: skip
    cascade, w, state = cascade_of(plant), rng.normal(size=(3, 77)), rng.normal(size=2 * n)
    expected, final = one_by_one(cascade, 1e-3, w, state, "first")
    run = march(cascade, 1e-3, w, state, "first", engine="fused")
    assert (abs(run.outputs - expected).max(axis=1) <= 1e-12 * abs(expected).max(axis=1)).all()
    assert (abs(run.final_state - final) <= 1e-11 * abs(final)).all()


@pytest.mark.parametrize("m", [1, 3, 16])
def test_other_states_move_eight_samples_side_by_side(m):
    """A block of any size that hears a mode and the inputs, and one that hears the inputs alone."""
    rng = np.random.default_rng(m)
    A = rng.normal(size=(m, m)) * 30 - 60 * np.sqrt(m) * np.eye(m)
    base = cascade_of(
        ModalPlant(omega=[40.0], zeta=0.0, shape_in=[[1.0, 2.0]], shape_out=[[1.0]], inputs=["a", "b"], outputs=["y"])
    )
    for heard in (0.0, 1.0):
        cascade = replace(
            base, A=A, from_modes=rng.normal(size=(m, 2)) * heard, B=rng.normal(size=(m, 2)), C=rng.normal(size=(1, m)),
            other_states=np.arange(2, 2 + m),
        )  # fmt: skip
        w, state = rng.normal(size=(2, 101)), rng.normal(size=2 + m)
        expected, final = one_by_one(cascade, 1e-2, w, state, "first")
        run = march(cascade, 1e-2, w, state, "first", engine="fused")
        assert error(run.outputs, expected) < 1e-12
        assert error(run.final_state, final) < 1e-12


def test_rows_that_are_multiples_are_read_once():
    rows = np.array([[0.0, 0.0], [1.0, 2.0], [-2.0, -4.0], [1.0, 2.1], [0.5, 1.05]])
    share, row, chosen = layout.shared_rows(rows)
    assert chosen == [1, 3]
    assert np.array_equal(share[:, None] * rows[chosen][row], rows)


def test_exact_to_twelve_digits_against_long_double():
    """Every mode and the mirror stepped in 64-bit mantissas, from the same exact coefficients: what the order of sums costs."""
    rng = np.random.default_rng(5)
    plant = ModalPlant(
        omega=2 * np.pi * np.r_[0.0, 1e-4, 1e-2, rng.uniform(1, 4000, 60)],
        zeta=np.r_[0.0, 0.0, 1.0, np.full(60, 0.005)],
        shape_in=rng.normal(size=(63, 3)),
        shape_out=rng.normal(size=(4, 63)),
        inputs=list("abc"),
        outputs=list("wxyz"),
    )
    cascade, w, dt = cascade_of(plant), rng.normal(size=(3, 5000)), 1e-4
    one = stepper(cascade, dt, "zero")
    F, drive = one.modes.astype(np.longdouble), one.drive[:3].astype(np.longdouble)
    q, v, expected = np.zeros(63, dtype=np.longdouble), np.zeros(63, dtype=np.longdouble), []
    for k in range(w.shape[1]):
        expected.append(plant.shape_out.astype(np.longdouble) @ q)
        forced = w[:, k] @ drive
        q, v = F[:, 0, 0] * q + F[:, 0, 1] * v + forced[:63], F[:, 1, 0] * q + F[:, 1, 1] * v + forced[63:]
    expected = np.array(expected).T
    for engine in ENGINES:
        run = march(cascade, dt, w, np.zeros(126), "zero", engine=engine)
        assert (abs(run.outputs - expected).max(axis=1) <= 1e-12 * abs(expected).max(axis=1)).all()


THREADS = """
import numpy as np
from flexplant.blocks.sampled import saturation
from flexplant.blocks.tones import Tones
from flexplant.blocks.transfer_function import transfer_function
from flexplant.loop.diagram import Diagram
from flexplant.loop.frequency import frequency_response
from flexplant.loop.harmonic import harmonic_response
from flexplant.loop.line_of_sight import LineOfSight, line_of_sight_diagram
from flexplant.loop.simulate import simulate
from flexplant.loop.stream import simulate_stream
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace

rng = np.random.default_rng(0)
phi = rng.normal(size=(200, 6))
plant = ModalPlant(
    omega=np.r_[0.0, np.sort(rng.uniform(5, 6000, 199))], zeta=0.005, shape_in=phi,
    shape_out=np.vstack([phi[:, 5], rng.normal(size=(5, 200))]), inputs=[f"u{k}" for k in range(6)],
    outputs=[f"y{k}" for k in range(6)],
)
los = LineOfSight(focal_length=1.5, gain=1800.0, mirror_omega=100.0, mirror_zeta=0.3)
loop = line_of_sight_diagram(los, plant, plant_outputs=["y0", "y1"], signals=("spot", "angle", "tilt"))

def around(block, **outputs):
    wires = [("plant.y0", "block.u"), ("block.y", "plant.u5")]
    inputs = {f"u{k}": f"plant.u{k}" for k in range(5)}
    blocks, outputs = {"plant": plant, "block": block}, {"y": "plant.y1", **outputs}
    return Diagram(blocks=blocks, connections=wires, inputs=inputs, outputs=outputs)

limited = around(saturation(-1.0, 1.0), p="block.y")
damped = around(transfer_function([-30.0, -1000.0], [1e-3, 1.0]))
turned = np.linalg.qr(rng.normal(size=(240, 240)))[0]
double = turned @ np.kron(np.eye(120), [[-60.0, 9.0], [0.0, -60.0]]) @ turned.T
dense = StateSpace(double, turned[:, :2], turned[:3], np.zeros((3, 2)), ["u", "v"], ["x", "y", "z"])
t = np.arange(9001) * 1e-4
for system, nt in ((plant, 9001), (loop, 9001), (limited, 9001), (damped, 500), (dense, 500)):
    result = simulate(system, t[:nt], rng.normal(size=(len(system.inputs), nt)))
    print(result.attrs.get("stepping", "sampled")[:17], end=", ")
    print(result.outputs.values.tobytes().hex()[-4000:], result.final_state.values.tobytes().hex())
for piece in simulate_stream(limited, dt=1e-4, samples=900, piece=300, inputs=lambda t: {"u0": np.sin(9 * t)}):
    print(piece.outputs.values.tobytes().hex(), piece.final_state.values.tobytes().hex())
tones = Tones(frequency_hz=[30.0, 400.0], amplitude=[[1.0, 2.0]], inputs=["u1"])
print(harmonic_response(damped, tones).values.tobytes().hex(), frequency_response(damped, [1.0, 77.0]).values.tobytes().hex())
"""


def test_one_and_more_threads_give_the_same_bits():
    """Open loop, mirror, a saturation around the modes, a loop in its own modes, a dense block, pieces of a run, and tones."""
    found = []
    for threads in ("1", "2", "3"):
        names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
        environment = {**os.environ, **dict.fromkeys(names, threads)}
        run = subprocess.run([sys.executable, "-c", THREADS], env=environment, capture_output=True, text=True, check=True)
        found.append(run.stdout)
    assert [line.split(", ")[0] for line in found[0].splitlines()[:5]] == [
        "modes of the stru", "modes of the stru", "sampled", "modes of the loop", "dense block of 24",
    ]  # fmt: skip
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize(("kind", "products"), [("angles", 5), ("rates", 3), ("both", 8)])
def test_rows_of_one_ratio_read_one_sum_of_a_mode(kind, products):
    """What two equal mirrors do (position and rate in one ratio a mode), rates alone, and both of these, which have no ratio."""
    rng = np.random.default_rng(0)
    y, a, b, none = rng.normal(size=(2, 50)), rng.normal(size=50), rng.normal(size=50) * 1e-4, np.zeros((2, 50))
    y[0, 3] = y[:, 4] = 0.0
    angles, rates = np.hstack([y * a, y * b]), np.hstack([none, y])
    given = {"angles": [np.hstack([y, none]), angles], "rates": [rates], "both": [angles, rates]}[kind]
    rows = tiled.Rows(np.vstack(given))
    assert (rows.ratio is None) == (kind == "both")
    assert rows.cost == products
    assert rows.placed @ rows.whole == pytest.approx(np.vstack(given), rel=1e-14, abs=1e-25)
