"""Wiring errors, each one line that names the ports."""

import numpy as np
import pytest

from flexplant.blocks.basic import gain, summing_junction
from flexplant.blocks.delay import sample_delay
from flexplant.blocks.mirror import steering_mirror
from flexplant.blocks.transfer_function import transfer_function
from flexplant.errors import DiagramError
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.plant.state_space import Descriptor


def feedback(forward=None, back=None, **changes):
    """r -> (sum) -> forward -> y, y -> back -> sum."""
    parts = {
        "blocks": {
            "sum": summing_junction({"r": 1, "b": -1}, output_name="e"),
            "forward": transfer_function([10.0], [1.0, 2.0]) if forward is None else forward,
            "back": gain(0.5) if back is None else back,
        },
        "connections": [("sum.e", "forward.u"), ("forward.y", "back.u"), ("back.y", "sum.b")],
        "inputs": {"r": "sum.r"},
        "outputs": {"y": "forward.y"},
    }
    return Diagram(**{**parts, **changes})


GOOD = feedback()


def rewired(*connections):
    return {"connections": list(connections)}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (rewired(("sum.e", "forwrd.u")), r"no block 'forwrd'.* Did you mean 'forward'"),
        (rewired(("sum.err", "forward.u")), r"block 'sum' has no output 'err'.*'sum\.e'"),
        (rewired(("sum", "forward.u")), r"port 'sum' has no block.*'block\.port'"),
        (rewired(("sum.e", "forward.u"), ("forward.y", "back.u")), r"input not connected: sum\.b;"),
        (
            rewired(("sum.e", "forward.u"), ("forward.y", "back.u"), ("back.y", "sum.b"), ("sum.e", "back.u")),
            r"input driven twice: back\.u by forward\.y and sum\.e;",
        ),
        ({"inputs": {"r": ["sum.r", "sum.b"]}}, r"sum\.b by back\.y and input 'r'"),
        ({"inputs": {"r": "sum.rr"}}, r"block 'sum' has no input 'rr'"),
        ({"outputs": {"y": "forward.x"}}, r"block 'forward' has no output 'x'"),
        ({"blocks": {}}, "at least one block"),
        ({"blocks": {"a.b": gain(1.0)}}, r"block name 'a\.b'"),
    ],
)
def test_wiring_errors_are_one_line_with_the_ports(changes, message):
    with pytest.raises(DiagramError, match=message) as error:
        feedback(**changes)
    assert "\n" not in str(error.value)


def test_units_that_clash():
    mirror = steering_mirror(100.0, 0.3, axes=("x",))
    with pytest.raises(DiagramError, match=r"m\.angle_x -> k\.u: angle \[rad\] drives length \[m\]"):
        Diagram(
            blocks={"m": mirror, "k": gain(2.0, input_units=["m"])},
            connections=[("m.angle_x", "k.u")],
            inputs={"v": "m.voltage_x"},
            outputs={"y": "k.y"},
        )


def test_ports_without_units_fit_any():
    mirror = steering_mirror(100.0, 0.3, axes=("x",))
    wires = {"connections": [("m.angle_x", "k.u")], "inputs": {"v": "m.voltage_x"}, "outputs": {"y": "k.y"}}
    closed = close(Diagram(blocks={"m": mirror, "k": gain(2.0)}, **wires))
    assert closed.input_units == ("V",)


def test_algebraic_loop_is_printed_port_by_port():
    with pytest.raises(DiagramError, match="algebraic loop") as error:
        feedback(forward=gain(3.0))
    path = str(error.value).split("algebraic loop: ")[1].split(";")[0].split(" -> ")
    assert path[0] == path[-1]
    assert set(path) == {"sum.e", "forward.u", "forward.y", "back.u", "back.y", "sum.b"}
    order = ["sum.e", "forward.u", "forward.y", "back.u", "back.y", "sum.b"]
    start = order.index(path[0])
    assert path[:-1] == order[start:] + order[:start]


def test_an_algebraic_loop_may_be_solved_on_purpose():
    closed = close(feedback(forward=gain(3.0), allow_algebraic_loops=True))
    assert closed.D.item() == pytest.approx(3.0 / (1 + 3.0 * 0.5), rel=1e-15)


def test_an_ill_posed_algebraic_loop_is_an_error():
    with pytest.raises(DiagramError, match="not well posed"):
        close(feedback(forward=gain(-2.0), allow_algebraic_loops=True))


def test_feedthrough_without_a_closed_path_is_no_loop():
    """Two channels of one block: out of one, back into the other, which has no way to the first."""
    two = gain([[1.0, 0.0], [0.0, 2.0]])
    diagram = Diagram(blocks={"g": two}, connections=[("g.y1", "g.u2")], inputs={"w": "g.u1"}, outputs={"z": "g.y2"})
    assert close(diagram).D.item() == 2.0


def test_mixed_sample_times_say_so():
    with pytest.raises(DiagramError, match=r"mixed sample times \(forward: continuous.*back: 0\.1 s\)"):
        close(feedback(back=sample_delay(1, 0.1)))


def test_a_descriptor_is_no_block():
    with pytest.raises(DiagramError, match="Descriptor"):
        Diagram(blocks={"a": Descriptor(np.eye(1), -np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)), ["u"], ["y"])})


def test_stages_follow_the_signals():
    diagram = Diagram(
        blocks={"late": gain(1.0), "loop_a": transfer_function([1], [1, 1]), "loop_b": gain(-1.0), "first": gain(2.0)},
        connections=[("first.y", "late.u"), ("loop_a.y", "loop_b.u"), ("loop_b.y", "loop_a.u")],
        inputs={"w": "first.u"},
        outputs={"z": "late.y"},
    )
    stages = [set(stage) for stage in diagram.stages]
    assert {"loop_a", "loop_b"} in stages
    assert stages.index({"first"}) < stages.index({"late"})


def test_a_diagram_is_immutable():
    with pytest.raises(AttributeError):
        GOOD.name = "other"
