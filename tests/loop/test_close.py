"""Closing a diagram against python-control, and the frequency response of a diagram against its closed state space."""

import control
import numpy as np
import pytest

from flexplant.blocks.basic import gain, summing_junction
from flexplant.blocks.delay import sample_delay
from flexplant.blocks.pid import pid
from flexplant.blocks.transfer_function import transfer_function
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.frequency import frequency_response
from flexplant.loop.line_of_sight import line_of_sight_diagram
from flexplant.plant.state_space import StateSpace, state_space

HZ = np.geomspace(0.03, 3e3, 60)


def random_block(rng, n, nu, ny, *, feedthrough):
    A = rng.normal(size=(n, n)) - 3 * np.eye(n)
    D = rng.normal(size=(ny, nu)) if feedthrough else np.zeros((ny, nu))
    inputs, outputs = [f"u{k}" for k in range(nu)], [f"y{k}" for k in range(ny)]
    return StateSpace(A, rng.normal(size=(n, nu)), rng.normal(size=(ny, n)), D, inputs, outputs)


def as_control(name, block):
    inputs = [f"{name}_{p}" for p in block.inputs]
    outputs = [f"{name}_{p}" for p in block.outputs]
    return control.ss(block.A, block.B, block.C, block.D, inputs=inputs, outputs=outputs, name=name)


def as_control_names(port):
    block, name = port.split(".")
    return f"{block}.{block}_{name}"


def test_interconnection_agrees_with_python_control():
    """Three multivariable blocks, two nested feedback paths, one of them through a feedthrough."""
    rng = np.random.default_rng(11)
    blocks = {
        "a": random_block(rng, 3, 2, 2, feedthrough=False),
        "b": random_block(rng, 2, 2, 1, feedthrough=True),
        "c": random_block(rng, 2, 1, 2, feedthrough=True),
    }
    connections = [("a.y0", "b.u0"), ("a.y1", "b.u1"), ("b.y0", "c.u0"), ("c.y1", "a.u1")]
    diagram = Diagram(
        blocks=blocks,
        connections=connections,
        inputs={"w": "a.u0"},
        outputs={"z0": "c.y0", "z1": "a.y1"},
    )
    peer = control.interconnect(
        [as_control(name, block) for name, block in blocks.items()],
        connections=[[as_control_names(end), as_control_names(start)] for start, end in connections],
        inplist=["a.a_u0"],
        outlist=["c.c_y0", "a.a_y1"],
    )
    theirs = control.frequency_response(peer, 2 * np.pi * HZ).complex
    ours = frequency_response(diagram, HZ).values
    assert np.allclose(ours[:, 0], theirs.reshape(2, -1), rtol=1e-10, atol=1e-13)


def test_unity_feedback_agrees_with_python_control():
    num, den, controller = [4.0, 8.0], [1.0, 2.0, 40.0], pid(3.0, 5.0, 0.1, filter_time=0.01, input_name="e", output_name="c")
    diagram = Diagram(
        blocks={
            "sum": summing_junction({"r": 1, "y": -1}, output_name="e"),
            "pid": controller,
            "plant": transfer_function(num, den),
        },
        connections=[("sum.e", "pid.e"), ("pid.c", "plant.u"), ("plant.y", "sum.y")],
        inputs={"r": "sum.r"},
        outputs={"y": "plant.y", "c": "pid.c"},
    )
    s = control.tf("s")
    law = 3.0 + 5.0 / s + 0.1 * s / (0.01 * s + 1)
    T = control.feedback(law * control.tf(num, den), 1)
    theirs = control.frequency_response(T, 2 * np.pi * HZ).complex.ravel()
    assert frequency_response(diagram, HZ).values[0, 0] == pytest.approx(theirs, rel=1e-9, abs=0)
    assert np.sort_complex(np.linalg.eigvals(close(diagram).A)) == pytest.approx(np.sort_complex(T.poles()), rel=1e-8)


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("commands", [True, False])
def test_block_by_block_response_equals_the_closed_state_space(published, plant, closed, commands):
    structure = None if commands else plant
    signals = ("spot", "angle", "voltage", "tilt")
    diagram = line_of_sight_diagram(published, structure, closed=closed, commands=commands, signals=signals)
    whole, parts = frequency_response(close(diagram), HZ), frequency_response(diagram, HZ)
    assert parts.dims == ("output", "input", "frequency")
    size = abs(whole).max("input")
    assert float((abs(parts - whole) / size.where(size > 0, 1.0)).max()) < 1e-9


def test_block_by_block_response_with_a_solved_algebraic_loop():
    diagram = Diagram(
        blocks={"a": transfer_function([2.0, 1.0], [1.0, 5.0]), "b": gain(-0.7)},
        connections=[("b.y", "a.u")],
        inputs={"w": "b.u"},
        outputs={"z": "a.y"},
    )
    looped = Diagram(
        blocks={"sum": summing_junction("++", output_name="s"), **diagram.blocks},
        connections=[("sum.s", "a.u"), ("a.y", "b.u"), ("b.y", "sum.in2")],
        inputs={"w": "sum.in1"},
        outputs={"z": "a.y"},
        allow_algebraic_loops=True,
    )
    s = 2j * np.pi * HZ
    G = (2 * s + 1) / (s + 5)
    assert frequency_response(looped, HZ).values[0, 0] == pytest.approx(G / (1 + 0.7 * G), rel=1e-12, abs=0)
    assert frequency_response(close(looped), HZ).values[0, 0] == pytest.approx(G / (1 + 0.7 * G), rel=1e-12, abs=0)


def test_discrete_loop():
    dt = 1e-4
    diagram = Diagram(
        blocks={"sum": summing_junction("+-", output_name="s"), "delay": sample_delay(2, dt), "k": gain(0.4)},
        connections=[("sum.s", "delay.u"), ("delay.y", "k.u"), ("k.y", "sum.in2")],
        inputs={"w": "sum.in1"},
        outputs={"z": "k.y"},
    )
    z = np.exp(2j * np.pi * HZ * dt)
    L = 0.4 / z**2
    assert frequency_response(diagram, HZ).values[0, 0] == pytest.approx(L / (1 + L), rel=1e-12, abs=0)
    assert close(diagram).dt == dt


def test_external_input_may_drive_several_ports():
    diagram = Diagram(
        blocks={"a": gain(2.0), "b": gain(3.0), "sum": summing_junction("++")},
        connections=[("a.y", "sum.in1"), ("b.y", "sum.in2")],
        inputs={"w": ["a.u", "b.u"]},
        outputs={"z": "sum.sum"},
    )
    assert close(diagram).D.item() == 5.0


def test_states_are_those_of_the_blocks_in_order(published, plant):
    closed = close(line_of_sight_diagram(published, plant))
    n = 2 * plant.n_modes
    assert closed.n_states == n + 4
    # the disturbance enters at the output: nothing comes back from mirror to structure
    assert np.array_equal(closed.A[:n, :n], state_space(plant).A)
    assert not closed.A[:n, n:].any()
