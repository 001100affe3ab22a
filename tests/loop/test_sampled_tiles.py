"""The sampled loop in tiles of four samples against stepping one by one: any length, any rate, states beside the modes."""

import numpy as np
import pytest
from test_sampled import DT, LEAD, close_to, structure

from flexplant.blocks.sampled import quantiser, saturation
from flexplant.blocks.transfer_function import transfer_function
from flexplant.loop import hybrid_recursion
from flexplant.loop.diagram import Diagram
from flexplant.loop.sampled_loop import SampledLoop, TiledLoop
from flexplant.loop.simulate import simulate
from flexplant.plant.modal import ModalPlant


def two_loops(*, driven=True, sensor=True, n=19):
    """Two actuators behind limits, digital laws at two rates, a continuous sensor (other states), and rates among the outputs."""
    rng = np.random.default_rng(n)
    plant = ModalPlant(
        omega=np.r_[0.0, np.sort(rng.uniform(20, 900, n - 1))], zeta=0.02, shape_in=rng.normal(size=(n, 3)),
        shape_out=rng.normal(size=(3, n)), shape_out_velocity=rng.normal(size=(3, n)) * [[0.0], [0.1], [0.0]],
        inputs=["f", "g", "d"], outputs=["x", "y", "z"],
    )  # fmt: skip
    sense = {"sensor": transfer_function([90.0], [1.0, 12.0, 90.0])} if sensor else {}
    blocks = {"plant": plant, **sense, "fast": LEAD, "slow": transfer_function([-2.0, 1.0], [1.0, -0.2], dt=3 * DT)}
    blocks |= {"stop": saturation(-0.3, 0.3), "round": quantiser(0.02)}
    wires = [("plant.x", "sensor.u"), ("sensor.y", "fast.u")] if sensor else [("plant.x", "fast.u")]
    wires += [("plant.y", "slow.u"), ("fast.y", "stop.u"), ("slow.y", "round.u"), ("stop.y", "plant.f"), ("round.y", "plant.g")]
    hold = {} if driven else {"none": quantiser(1.0)}
    wires += [] if driven else [("plant.z", "none.u"), ("none.y", "plant.d")]
    return Diagram(
        blocks={**blocks, **hold}, connections=wires, inputs={"d": "plant.d"} if driven else {},
        outputs={"x": "plant.x", "y": "plant.y", "z": "plant.z", "f": "stop.y"},
    )  # fmt: skip


def both_ways(loop, t, monkeypatch, **more):
    with monkeypatch.context() as patch:
        patch.setattr(hybrid_recursion, "numba", lambda: None)
        plain = simulate(loop, t, **more)
    return simulate(loop, t, **more), plain


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("sensor", [True, False])
@pytest.mark.parametrize("nt", [2, 4, 5, 8, 31, 32, 33, 34, 35, 100, 515])
def test_tiles_are_the_steps(nt, sensor, hold, monkeypatch):
    loop, t = two_loops(sensor=sensor), np.arange(nt) * DT
    d, state = np.random.default_rng(1).normal(size=nt), np.random.default_rng(2).normal(size=38 + 2 * sensor + 2) * 1e-2
    found, plain = both_ways(loop, t, monkeypatch, inputs={"d": d}, hold=hold, initial=state)
    assert close_to(found.outputs, plain.outputs.values, 1e-12)
    assert close_to(found.final_state, plain.final_state.values, 1e-12)


@pytest.mark.parametrize("every", [3, 4, 7, 50])
def test_thinned_tiles_keep_the_right_samples(every, monkeypatch):
    t = np.arange(203) * DT
    d = np.random.default_rng(1).normal(size=t.size)
    found, plain = both_ways(two_loops(), t, monkeypatch, inputs={"d": d}, every=every)
    assert close_to(found.outputs, plain.outputs.values, 1e-12)


def test_tiles_without_an_input_from_outside(monkeypatch):
    t, state = np.arange(150) * DT, np.full(42, 0.01)
    found, plain = both_ways(two_loops(driven=False), t, monkeypatch, initial=state)
    assert abs(plain.outputs.values).max() > 1e-3
    assert close_to(found.outputs, plain.outputs.values, 1e-12)


def test_many_rows_go_without_tiles(monkeypatch):
    """Thirty outputs of a plant that a saturation drives: the loop in single steps, and both agree with the plain one."""
    rng = np.random.default_rng(0)
    plants = {
        ny: ModalPlant(
            omega=rng.uniform(20, 900, 40), zeta=0.02, shape_in=rng.normal(size=(40, 2)), shape_out=rng.normal(size=(ny, 40)),
            inputs=["f", "d"], outputs=[f"y{k}" for k in range(ny)],
        )
        for ny in (20, 30)
    }  # fmt: skip
    chosen = []
    for kind in (TiledLoop, SampledLoop):
        run = kind.run
        monkeypatch.setattr(kind, "run", lambda self, *given, run=run: (chosen.append(type(self).__name__), run(self, *given))[1])
    for plant in plants.values():
        loop = Diagram(
            blocks={"plant": plant, "stop": saturation(-0.3, 0.3)},
            connections=[("plant.y0", "stop.u"), ("stop.y", "plant.f")],
            inputs={"d": "plant.d"},
            outputs={name: f"plant.{name}" for name in plant.outputs},
        )
        t = np.arange(90) * DT
        found, plain = both_ways(loop, t, monkeypatch, inputs={"d": rng.normal(size=90) * 100})
        assert close_to(found.outputs, plain.outputs.values, 1e-12)
    assert set(chosen[:2]) == {"TiledLoop"}
    assert set(chosen[2:]) == {"SampledLoop"}


def test_the_first_input_that_is_not_finite_is_named_with_its_instant():
    loop = Diagram(
        blocks={"plant": structure(), "stop": transfer_function([1e200, 0.0], [1.0, -0.3], dt=DT)},
        connections=[("plant.y", "stop.u"), ("stop.y", "plant.f")],
        inputs={"d": "plant.d"},
        outputs={"y": "plant.y"},
    )
    with pytest.raises(Exception, match=r"input of block 'stop' is not finite at t = 0\.00\d+ s") as tiled:
        simulate(loop, np.arange(50) * DT, {"d": 1.0}, unstable="allow")
    assert "unstable" in str(tiled.value)
