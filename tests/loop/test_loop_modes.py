"""A loop that feeds back into its plant, stepped in its own modes: their equations, exact motion, and where there are none."""

from dataclasses import replace

import numpy as np
import pytest
from test_cascade import whole

from flexplant.blocks.basic import gain, summing_junction
from flexplant.blocks.transfer_function import transfer_function
from flexplant.errors import InputError
from flexplant.loop import fused, loop_recursion
from flexplant.loop.cascade import cascade_of
from flexplant.loop.diagram import Diagram
from flexplant.loop.loop_modes import LoopModes, loop_modes, phi_functions
from flexplant.loop.recursion import Recursion, march
from flexplant.loop.simulate import simulate
from flexplant.loop.stream import simulate_stream
from flexplant.plant.discretize import stacked_expm
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace

DT = 1e-3


def structure(n_flexible=9, n_rigid=6, seed=4):
    """Forces and torques at a hub, and a force at a tip; angles, rates, and the tip. Torques do not move the centre of mass."""
    rng = np.random.default_rng(seed)
    omega = np.r_[np.zeros(n_rigid), np.sort(rng.uniform(3, 900, n_flexible))]
    n = omega.size
    shape, mixed = rng.normal(size=(n, 7)), np.linalg.qr(rng.normal(size=(n_rigid, n_rigid)))[0]
    shape[:n_rigid, 3:6] = 0.0
    shape[: min(3, n_rigid), 3 : 3 + min(3, n_rigid)] = np.diag([0.5, 0.4, 0.3])[: min(3, n_rigid), : min(3, n_rigid)]
    shape[:n_rigid] = mixed @ shape[:n_rigid]
    rates = np.vstack([np.zeros((3, n)), shape[:, 3:6].T, np.zeros((1, n))])
    angles = np.vstack([shape[:, 3:6].T, np.zeros((3, n)), shape[:, 6:].T])
    return ModalPlant(
        omega=omega, zeta=np.r_[np.zeros(n_rigid), np.full(n_flexible, 0.01)], shape_in=shape, shape_out=angles,
        shape_out_velocity=rates, inputs=["fx", "fy", "fz", "tx", "ty", "tz", "tip"],
        outputs=["ax", "ay", "az", "rx", "ry", "rz", "z"],
    )  # fmt: skip


def attitude_loop(plant, kind):
    """kind: "pid" on the angles with roll-off, "rate" feedback, or a "damper" at the tip behind a filter."""
    blocks, wires, inputs = {"plant": plant}, [], {"fx": "plant.fx", "fy": "plant.fy", "fz": "plant.fz"}
    if kind == "damper":
        blocks["law"] = transfer_function([-3.0, 0.0], [2e-4, 1.0], input_name="u", output_name="y")
        pairs = [("tip", "z", "law")]
        inputs |= {"tx": "plant.tx", "ty": "plant.ty", "tz": "plant.tz"}
    else:
        numbers = {"pid": ([-8.0, -6.0, -1.5], [0.01, 1.0, 0.0]), "rate": ([-8.0], [0.02, 1.0])}[kind]
        pairs = [(f"t{k}", f"{'a' if kind == 'pid' else 'r'}{k}", f"law_{k}") for k in "xyz"]
        gains = dict(zip("xyz", (1.0, 1.1, 0.9), strict=True))
        blocks |= {f"law_{k}": transfer_function(np.array(numbers[0]) * g, numbers[1]) for k, g in gains.items()}
        inputs["tip"] = "plant.tip"
    for port, seen, law in pairs:
        blocks[f"sum_{port}"] = summing_junction("++", output_name="f")
        wires += [(f"plant.{seen}", f"{law}.u"), (f"{law}.y", f"sum_{port}.in2"), (f"sum_{port}.f", f"plant.{port}")]
        inputs[port] = f"sum_{port}.in1"
    return Diagram(blocks=blocks, connections=wires, inputs=inputs, outputs={k: f"plant.{k}" for k in plant.outputs})


CASES = [("pid", 6), ("pid", 3), ("rate", 6), ("rate", 0), ("damper", 6), ("damper", 0)]


def exact(cascade, dt, w, state, hold):
    """Stepped in 64-bit mantissas by the exponential's own series: outputs and final state in the order of the whole system."""
    A, B, C, D = (matrix.astype(np.longdouble) for matrix in whole(cascade))
    n, nw = B.shape
    augmented = np.zeros((n + 2 * nw, n + 2 * nw), dtype=np.longdouble)
    augmented[:n, :n], augmented[:n, n : n + nw], augmented[n : n + nw, n + nw :] = A * dt, B * dt, np.eye(nw)
    small = augmented / 1024
    step = term = np.eye(n + 2 * nw, dtype=np.longdouble)
    for k in range(1, 25):
        term = term @ small / k
        step = step + term
    for _ in range(10):
        step = step @ step
    F, G, ramp = step[:n, :n], step[:n, n : n + nw], step[:n, n + nw :]
    x, out = state.astype(np.longdouble), []
    for k in range(w.shape[1]):
        out.append(C @ x + D @ w[:, k])
        if k + 1 < w.shape[1]:
            x = F @ x + G @ w[:, k] + (ramp @ (w[:, k + 1] - w[:, k]) if hold == "first" else 0)
    return np.array(out).T, x


@pytest.mark.parametrize(("kind", "n_rigid"), CASES)
def test_blocks_are_the_loop(kind, n_rigid):
    """A outward = outward blocks, inward outward = 1, and the forces are those of the inputs."""
    cascade = cascade_of(attitude_loop(structure(n_rigid=n_rigid), kind))
    modes = loop_modes(cascade)
    free, k = modes.omega.size, modes.omega.size + len(modes.poles)
    order = np.r_[cascade.modal_states, cascade.other_states]
    A, B = (matrix[order] for matrix in whole(cascade)[:2])
    A = A[:, order]
    first, second = np.split(np.arange(2 * k), 2)
    blocks = np.zeros((2 * k, 2 * k))
    blocks[first[:free], second[:free]], blocks[second[:free], first[:free]] = 1.0, -(modes.omega**2)
    blocks[second[:free], second[:free]] = -2 * modes.zeta * modes.omega
    turn = np.where(modes.poles[:, 0].imag > 0, modes.poles[:, 0].imag, 0.0)
    blocks[first[free:], first[free:]], blocks[second[free:], second[free:]] = modes.poles.real.T
    blocks[first[free:], second[free:]], blocks[second[free:], first[free:]] = turn, -turn
    scale = abs(modes.outward).max(axis=0) + (abs(modes.outward).max(axis=0) == 0)
    size = abs(A) @ abs(modes.outward) + abs(modes.outward) @ abs(blocks)
    assert (abs(A @ modes.outward - modes.outward @ blocks) <= 1e-11 * size.max(axis=0) + 1e-20).all()
    assert abs(modes.outward @ modes.inward @ A - A).max() < 1e-9 * abs(A).max()
    used = np.flatnonzero(abs(modes.inward).any(axis=1))
    assert used.size == len(A)
    found = (modes.inward @ modes.outward)[np.ix_(used, used)] * scale[used, None] / scale[used]
    assert np.allclose(found, np.eye(used.size), atol=1e-9)
    assert np.allclose(modes.outward @ modes.forces, B, atol=1e-10 * abs(B).max())


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize(("kind", "n_rigid"), CASES)
def test_exact_motion_of_the_loop(kind, n_rigid, hold):
    """Ten digits of every output beside long double, from any state; with rigid-body modes drifting beside the loop."""
    diagram = attitude_loop(structure(n_rigid=n_rigid), kind)
    cascade, rng = cascade_of(diagram), np.random.default_rng(1)
    t, w, state = np.arange(2000) * DT, rng.normal(size=(7, 2000)), rng.normal(size=cascade.n_states) * 1e-3
    result = simulate(diagram, t, w, hold=hold, initial=state)
    assert result.attrs["stepping"].startswith("modes of the loop")
    outputs, final = exact(cascade, DT, result.inputs.values, state, hold)
    assert (abs(result.outputs.values - outputs).max(axis=1) < 1e-10 * abs(outputs).max(axis=1)).all()
    assert abs(result.final_state.values - final).max() < 1e-10 * abs(final).max()


def test_rigid_body_modes_that_the_loop_does_not_reach_stay_rigid():
    """Torques turn the body; its three translations, mixed into the same six modes, fall free: omega exactly zero."""
    modes = loop_modes(cascade_of(attitude_loop(structure(), "pid")))
    assert modes.omega.size == 3
    assert not modes.omega.any()
    assert modes.poles.real.max() < 0


def test_a_resumed_thinned_or_streamed_run_is_the_whole_run():
    diagram, t = attitude_loop(structure(), "pid"), np.arange(1003) * DT
    w = np.random.default_rng(0).normal(size=(7, t.size))
    whole_run = simulate(diagram, t, w)
    size = abs(whole_run.outputs.values).max(axis=1, keepdims=True)
    thin = simulate(diagram, t, w, every=7).outputs.values
    assert abs(thin - whole_run.outputs.values[:, ::7]).max() <= 1e-12 * size.max()
    pieces = simulate_stream(diagram, dt=DT, samples=t.size, inputs=lambda at: w[:, np.rint(at / DT).astype(int)], piece=250)
    joined = np.hstack([piece.outputs.values for piece in pieces])
    assert (abs(joined - whole_run.outputs.values) <= 1e-11 * size).all()


def test_without_inputs_the_loop_moves_from_its_state():
    diagram = attitude_loop(structure(), "rate")
    free = Diagram(
        blocks={k: b for k, b in diagram.blocks.items() if k.startswith(("plant", "law"))},
        connections=[w for k in "xyz" for w in ((f"plant.r{k}", f"law_{k}.u"), (f"law_{k}.y", f"plant.t{k}"))],
        inputs={"tip": "plant.tip", "fx": "plant.fx", "fy": "plant.fy", "fz": "plant.fz"},
        outputs={"z": "plant.z"},
    )
    still = Diagram(
        blocks={**free.blocks, "still": gain(np.zeros((4, 4)))},
        connections=[*free.connections, *((f"still.y{k}", f"plant.{p}") for k, p in enumerate(["tip", "fx", "fy", "fz"], 1))]
        + [(f"plant.{y}", f"still.u{k}") for k, y in enumerate(["ax", "ay", "az", "z"], 1)],
        outputs={"z": "plant.z"},
    )
    state = np.random.default_rng(0).normal(size=cascade_of(free).n_states)
    t = np.arange(300) * DT
    one, other = (simulate(system, t, initial=state).outputs.values for system in (free, still))
    assert abs(one - other).max() < 1e-10 * abs(one).max()


def test_what_no_input_drives_does_not_move():
    """A loop closes on mode 0 alone, the input drives half of the others: the rest stands still under the input."""
    n, shape = 20, np.zeros((20, 2))
    shape[0], shape[1 : n // 2, 1] = 1.0, 1.0
    names = [f"x{k}" for k in range(n)]
    plant = ModalPlant(
        omega=np.linspace(10, 200, n), zeta=0.01, shape_in=shape, shape_out=np.eye(n), inputs=["f", "d"], outputs=names
    )
    blocks = {"plant": plant, "law": transfer_function([-5.0], [0.01, 1.0])}
    wires = [("plant.x0", "law.u"), ("law.y", "plant.f")]
    diagram = Diagram(blocks=blocks, connections=wires, inputs={"d": "plant.d"}, outputs={k: f"plant.{k}" for k in names})
    moved = simulate(diagram, np.arange(200) * DT, {"d": 1.0})
    assert moved.attrs["stepping"].startswith("modes of the loop")
    peak = abs(moved.outputs.values).max(axis=1)
    assert peak[: n // 2].min() > 1e-6
    assert peak[n // 2 :].max() < 1e-100


def critically_damped(w):
    """Ten bodies, each on its own active spring and damper: ten double poles at -w, each with one mode."""
    names = [f"x{k}" for k in range(10)]
    body = ModalPlant(
        omega=np.zeros(10), zeta=0.0, shape_in=np.eye(10), shape_out=np.vstack([np.eye(10), np.zeros((10, 10))]),
        shape_out_velocity=np.vstack([np.zeros((10, 10)), np.eye(10)]), inputs=names,
        outputs=names + [f"v{k}" for k in range(10)],
    )  # fmt: skip
    blocks = {"body": body, "law": gain(np.hstack([-(w**2) * np.eye(10), -2 * w * np.eye(10)]))}
    law = blocks["law"]
    wires = [(f"body.{y}", f"law.{u}") for y, u in zip(body.outputs, law.inputs, strict=True)]
    wires += [(f"law.{y}", f"body.{u}") for y, u in zip(law.outputs, names, strict=True)]
    return Diagram(blocks=blocks, connections=wires, outputs={"x": "body.x3"})


def test_multiple_poles_without_modes_take_the_dense_block_and_say_so():
    w, t = 3.0, np.arange(400) * 0.01
    result = simulate(critically_damped(w), t, initial=np.r_[np.ones(10), np.zeros(10)])
    assert result.attrs["stepping"].startswith("dense block of 20 states: its poles near 3 rad/s are nearly multiple")
    assert result.outputs[0].values == pytest.approx((1 + w * t) * np.exp(-w * t), abs=1e-12)


@pytest.mark.parametrize(("beside", "apart"), [(1.0, False), (1.00001, False), (1.3, True)])
def test_a_filter_on_a_mode_that_the_loop_does_not_drive(beside, apart):
    """Resonance of a filter with a mode apart: a double pole, which has no two modes; further off, both are stepped alone."""
    plant = structure(n_rigid=0)
    shape = plant.shape_in.copy()
    shape[3, 6] = 0.0
    plant = replace(plant, shape_in=shape)
    omega, loop = plant.omega[3] * beside, attitude_loop(plant, "damper")
    diagram = Diagram(
        blocks={**loop.blocks, "filter": transfer_function([omega**2], [1.0, 0.02 * omega, omega**2])},
        connections=[*loop.connections, ("plant.ax", "filter.u")],
        inputs=loop.inputs,
        outputs={**loop.outputs, "filtered": "filter.y"},
    )
    cascade, rng = cascade_of(diagram), np.random.default_rng(1)
    w, state = rng.normal(size=(7, 1500)), rng.normal(size=cascade.n_states) * 1e-3
    result = simulate(diagram, np.arange(1500) * DT, w, initial=state)
    why = "dense block of 21 states: a mode that the loop does not drive lies beside a pole of the loop"
    assert result.attrs["stepping"].startswith("modes of the loop" if apart else why)
    outputs, _ = exact(cascade, DT, w, state, "first")
    assert (abs(result.outputs.values - outputs).max(axis=1) < 1e-10 * abs(outputs).max(axis=1)).all()


def test_an_unstable_loop_is_refused_with_its_pole():
    plant = structure(n_rigid=0)
    loop = attitude_loop(plant, "rate")
    wrong = Diagram(
        blocks={**loop.blocks, "law_x": transfer_function([800.0], [0.02, 1.0])},
        connections=loop.connections, inputs=loop.inputs, outputs=loop.outputs,
    )  # fmt: skip
    with pytest.raises(InputError, match="unstable: pole") as caught:
        simulate(wrong, np.arange(5) * DT)
    worst = max(np.linalg.eigvals(cascade_of(wrong).A), key=lambda pole: pole.real)
    assert f"pole {worst.real:.5g}" in str(caught.value)


def growing(width):
    """x' = 3 x + u beside width - 1 states that decay; one output reads the slowest of them, one the growing one."""
    A = np.diag(np.r_[-np.arange(1.0, width), 3.0])
    C = np.eye(width)[[0, width - 1]]
    return StateSpace(A, np.ones((width, 1)), C, np.zeros((2, 1)), ["u"], ["calm", "growing"])


@pytest.mark.parametrize(("width", "compiled"), [(3, True), (30, True), (30, False)])
def test_a_run_that_overflows_stops_and_one_that_grows_is_exact(width, compiled, monkeypatch):
    """An infinite state would be nothing times infinity in the rows that do not read it."""
    if not compiled:
        for module in (fused, loop_recursion):
            monkeypatch.setattr(module, "march_kernel", lambda: None)
    t = np.arange(20_000) * 0.015
    with pytest.raises(InputError, match=r"overflow within \d+.* s: the system is unstable; simulate a shorter time"):
        simulate(growing(width), t, {"u": 1.0}, unstable="allow")
    short = simulate(growing(width), t[:14_000], {"u": 1.0}, unstable="allow").outputs.values
    assert short[1] == pytest.approx((np.exp(3 * t[:14_000]) - 1) / 3, rel=1e-9)
    assert short[0] == pytest.approx(1 - np.exp(-t[:14_000]), rel=1e-12)


def test_without_numba_the_dense_block_gives_the_same(monkeypatch):
    diagram, t = attitude_loop(structure(), "pid"), np.arange(500) * DT
    w = np.random.default_rng(0).normal(size=(7, t.size))
    compiled = simulate(diagram, t, w).outputs.values
    for module in (fused, loop_recursion):
        monkeypatch.setattr(module, "march_kernel", lambda: None)
    plain = simulate(diagram, t, w)
    assert plain.attrs["stepping"].startswith("dense block of ")
    assert (abs(plain.outputs.values - compiled).max(axis=1) < 1e-10 * abs(compiled).max(axis=1)).all()


def test_two_hundred_modes_beside_the_dense_block():
    rng, n = np.random.default_rng(3), 200
    plant = structure(n_flexible=n - 6)
    diagram = attitude_loop(plant, "pid")
    cascade, w = cascade_of(diagram), rng.normal(size=(7, 3000))
    modes = loop_modes(cascade)
    assert isinstance(modes, LoopModes)
    made = loop_recursion.LoopRecursion(cascade, modes, DT, np.zeros(cascade.n_states), "first")
    ours = march(made, w, 3000, (7, 7)).outputs
    dense = march(Recursion(cascade, DT, np.zeros(cascade.n_states), "first"), w, 3000, (7, 7)).outputs
    assert (abs(ours - dense).max(axis=1) < 1e-10 * abs(dense).max(axis=1)).all()


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-3, 0.7, 0.999, 1.001, 5.0, 40.0])
def test_phi_functions_are_those_of_the_exponential(size):
    x = size * np.exp(1j * np.linspace(np.pi / 2, 3 * np.pi / 2, 9))
    matrix = np.zeros((9, 3, 3), dtype=complex)
    matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 2] = x, 1.0, 1.0
    expected = stacked_expm(matrix)
    one, two = phi_functions(x)
    assert abs(one - expected[:, 0, 1]).max() < 1e-14
    assert abs(two - expected[:, 0, 2]).max() < 1e-14
