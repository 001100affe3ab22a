"""Long runs in pieces: the pieces are the whole, and memory does not grow."""

import tracemalloc

import numpy as np
import pytest

from flexplant.blocks.sampled import saturation
from flexplant.blocks.wheel import wheel_tones
from flexplant.errors import InputError
from flexplant.loop.diagram import Diagram
from flexplant.loop.line_of_sight import line_of_sight_diagram
from flexplant.loop.simulate import simulate
from flexplant.loop.stream import simulate_stream

DT = 1e-4


def signal(t):
    return {"bus.9001.1": np.sin(300 * t), "bus.9001.5": np.cos(1000 * t)}


@pytest.mark.parametrize("every", [1, 6])
@pytest.mark.parametrize("nonlinear", [False, True])
def test_pieces_are_the_whole(published, plant, every, nonlinear):
    system = line_of_sight_diagram(published, plant)
    if nonlinear:
        system = Diagram(
            blocks={"plant": plant, "clip": saturation(-1e-7, 1e-7)},
            connections=[("plant.optic.1.1", "clip.u")],
            inputs={name: f"plant.{name}" for name in plant.inputs},
            outputs={"clipped": "clip.y", "raw": "plant.optic.1.2"},
        )
    nt = 23_457
    t = DT * np.arange(nt)
    whole = simulate(system, t, signal(t), every=every)
    pieces = list(simulate_stream(system, dt=DT, samples=nt, inputs=signal, every=every, piece=5000))
    assert len(pieces) == 5
    joined = np.hstack([p.outputs.values for p in pieces])
    assert np.allclose(np.hstack([p.time.values for p in pieces]), t[::every])
    size = abs(whole.outputs.values).max(axis=1, keepdims=True)
    assert float((abs(joined - whole.outputs.values) / size).max()) < 1e-10
    assert np.allclose(pieces[-1].final_state, whole.final_state, rtol=1e-10, atol=1e-14)


def test_tones_stream(published, plant, wheel):
    system, tones, t = line_of_sight_diagram(published, plant), wheel_tones(wheel, 20.0), DT * np.arange(4000)
    joined = np.hstack([p.outputs.values for p in simulate_stream(system, dt=DT, samples=4000, inputs=tones, piece=1500)])
    expected = simulate(system, t, tones).outputs.values
    assert abs(joined - expected).max() < 1e-4 * abs(expected).max()


def test_memory_is_bounded(plant):
    def peak(samples):
        tracemalloc.start()
        for _ in simulate_stream(plant, dt=DT, samples=samples, inputs=signal, piece=20_000, every=10):
            pass
        used = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return used

    peak(30_000)
    assert peak(400_000) < 1.2 * peak(60_000)


def test_stream_errors(plant):
    with pytest.raises(InputError, match="must be positive"):
        simulate_stream(plant, dt=0.0, samples=10)
    with pytest.raises(InputError, match="function of the instants"):
        simulate_stream(plant, dt=DT, samples=10, inputs=np.zeros((6, 10)))
