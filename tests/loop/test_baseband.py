"""The response of loops with digital blocks at the input's own frequency: against their motion, and the discrete loop."""

from __future__ import annotations

import numpy as np
import pytest

import flexplant as fp
from flexplant.blocks.basic import summing_junction
from flexplant.blocks.transfer_function import transfer_function
from flexplant.errors import DiagramError, InputError
from flexplant.loop.diagram import Diagram
from flexplant.loop.frequency import frequency_response, frequency_response_blocks
from flexplant.loop.grids import adaptive_grid
from flexplant.loop.simulate import simulate
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace

T = 1e-3
SHAPES = np.array([[1.0, -0.6], [0.7, 1.0], [-0.5, 0.8]])
PLANT = ModalPlant(
    omega=2 * np.pi * np.array([35.0, 170.0, 420.0]),
    zeta=0.2,
    shape_in=SHAPES,
    shape_out=SHAPES.T,
    shape_out_velocity=1e-3 * SHAPES.T,
    inputs=["f", "d"],
    outputs=["y", "z"],
)


def loop(first=1, second=None, *, size=3e4) -> Diagram:
    """y -> law -> f every `first` ms, z -> slow -> f every `second` ms beside it; a reference r into the law, and d."""
    blocks = {"plant": PLANT, "law": law(first, size), "error": summing_junction("++"), "sum": summing_junction("++")}
    wires = [("plant.y", "error.in1"), ("error.sum", "law.u"), ("law.y", "sum.in1"), ("sum.sum", "plant.f")]
    inputs = {"d": ["plant.d"], "r": ["error.in2"]}
    if second:
        blocks["slow"] = law(second, 0.3 * size)
        wires += [("plant.z", "slow.u"), ("slow.y", "sum.in2")]
    else:
        inputs["g"] = ["sum.in2"]
    outputs = {"y": "plant.y", "z": "plant.z", "f": "sum.sum", "u": "law.y"}
    return Diagram(blocks=blocks, connections=wires, inputs=inputs, outputs=outputs)


def law(rate, size):
    return transfer_function([-size, 0.5 * size], [1.0, -0.4], dt=rate * T)


def by_motion(diagram, entry, hz, steps, seconds):
    """Complex amplitudes at hz under a cosine from an oscillator inside the diagram, over the last `seconds`, all periods whole.

    The motion at `steps` points a millisecond is exact; held outputs are steps over them, which the mean of a step takes in.
    """
    osc = StateSpace([[0, 2 * np.pi * hz], [-2 * np.pi * hz, 0]], np.zeros((2, 0)), np.eye(2), np.zeros((2, 0)), [], ["s", "c"])
    blocks = {"osc": osc, **diagram.blocks}
    wires = [*diagram.connections, *(("osc.c", port) for port in diagram.inputs[entry])]
    inputs = {name: ports for name, ports in diagram.inputs.items() if name != entry}
    driven = Diagram(blocks=blocks, connections=wires, inputs=inputs, outputs=diagram.outputs)
    n = sum(2 * b.n_modes if isinstance(b, ModalPlant) else b.n_states for b in blocks.values())
    dt, count = T / steps, round(seconds / T * steps)
    t = np.arange(3 * count) * dt
    y = simulate(driven, t, initial=np.eye(n)[1], hold="zero").outputs.values[:, -count:]
    amplitudes = 2 * (y * np.exp(-2j * np.pi * hz * t[-count:])).mean(axis=1)
    held = np.exp(-1j * np.pi * hz * dt) * np.sinc(hz * dt)
    return amplitudes * np.array([held if name in ("f", "u") else 1.0 for name in diagram.outputs])


@pytest.mark.parametrize(("rates", "hz"), [((1,), 35.0), ((1,), 730.0), ((2, 3), 45.0), ((4, 1), 1110.0)])
def test_response_is_the_part_of_the_motion_at_the_tone(rates, hz):
    """Also above the Nyquist frequency, where the digital blocks hear another tone; order two in the distance of the points."""
    diagram, held = loop(*rates), [False, False, True, True]
    found = frequency_response(diagram, [hz]).values[:, :, 0]
    for column, entry in ((0, "d"), (1, "r")):
        errors = []
        for steps in (8, 16):
            exact = by_motion(diagram, entry, hz, steps, 0.6)
            error = abs(found[:, column] - exact) / abs(exact)
            assert error[held].max() < 1e-9
            errors.append(error[:2])
        assert errors[1].max() < 0.02
        assert np.log2(errors[0] / errors[1]) == pytest.approx([2, 2], abs=0.1)


def test_a_held_input_at_its_samples_is_the_discrete_loop():
    """What drives digital blocks alone, and is read by them, has no other frequencies at the samples."""
    diagram, hz = loop(), np.array([0.0, 3.0, 170.0, 499.0])
    discrete = frequency_response(fp.discretize(diagram, T), hz).sel(output="u", input="r").values
    hold = np.exp(-1j * np.pi * hz * T) * np.sinc(hz * T)
    assert frequency_response(diagram, hz).sel(output="u", input="r").values == pytest.approx(hold * discrete, rel=1e-10)


def test_slow_rates_are_the_limit_of_one():
    """Two blocks of one rate, and the same as two rates whose common period is that rate's double."""
    hz = np.array([5.0, 90.0, 260.0])
    one = frequency_response(loop(2, 2), hz)
    assert one.attrs["sampling"].endswith("samples: plant: continuous, law: 0.002 s, slow: 0.002 s")
    idle = loop(2, 2)
    other = Diagram(
        blocks={**idle.blocks, "idle": law(3, 1.0)},
        connections=[*idle.connections, ("plant.z", "idle.u")],
        inputs=idle.inputs,
        outputs=idle.outputs,
    )
    assert abs(frequency_response(other, hz).values - one.values).max() <= 1e-10 * abs(one.values).max()
    parts = frequency_response_blocks(other, hz, block=2)
    assert np.concatenate([part.values for part in parts], axis=2) == pytest.approx(
        frequency_response(other, hz).values, rel=1e-12
    )


def test_grids_of_digital_loops_meet_the_peaks():
    diagram = loop(size=1.2e5)
    grid = adaptive_grid(diagram, 1.0, 450.0)
    coarse, fine = (
        abs(frequency_response(diagram, hz).sel(output="y", input="d").values).max() for hz in (grid, np.geomspace(1, 450, 4000))
    )
    assert coarse == pytest.approx(fine, rel=0.01)
    assert "about the poles of every block" in grid.explanation


def test_requests_without_an_answer():
    slow = law(1, 1.0)
    many = Diagram(
        blocks={"plant": PLANT, "a": slow, "b": transfer_function([1.0], [1.0, -0.3], dt=0.997 * T)},
        connections=[("plant.y", "a.u"), ("plant.z", "b.u"), ("a.y", "plant.f")],
        inputs={"d": "plant.d"},
        outputs={"y": "plant.y"},
    )
    with pytest.raises(InputError, match=r"no common period of at most 1000 steps|make \d+ unknowns, more than 600"):
        frequency_response(many, [1.0])
    with pytest.raises(DiagramError, match=r"varies in time; discretize\(diagram, dt\) makes one discrete system"):
        fp.hinf_norm(loop())
    with pytest.raises(DiagramError, match="varies in time"):
        fp.random_response(loop(), {"d": ([1.0, 10.0], [1.0, 1.0])}, [1.0, 2.0])
    with pytest.raises(DiagramError, match="varies in time"):
        fp.harmonic_response(loop(), fp.Tones(frequency_hz=[10.0], amplitude=[[1.0]], inputs=["d"]))
