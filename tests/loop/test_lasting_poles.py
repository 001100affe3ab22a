"""Frequencies on poles without damping are refused where the poles are not known beforehand, and only those."""

import numpy as np
import pytest
import scipy.sparse as sp

import flexplant as fp
from flexplant.errors import InputError
from flexplant.loop.close import close
from flexplant.plant.state_space import Descriptor, StateSpace


def chain(n=6, damping=0.0) -> Descriptor:
    """A chain of masses and springs, fixed at one end; its frequencies are known in closed form."""
    K = sp.diags_array([np.full(n - 1, -1.0), np.r_[np.full(n - 1, 2.0), 1.0], np.full(n - 1, -1.0)], offsets=[-1, 0, 1]) * 1e4
    one, none = sp.eye_array(n), sp.csr_array((n, n))
    force = np.zeros((2 * n, 1))
    force[-1] = 1.0
    read = np.zeros((1, 2 * n))
    read[0, n - 1] = 1.0
    return Descriptor(
        E=sp.block_array([[one, none], [none, one]], format="csr"),
        A=sp.block_array([[none, one], [-K, -damping * one]], format="csr"),
        B=force, C=read, D=np.zeros((1, 1)), inputs=["u"], outputs=["y"],
    )  # fmt: skip


def frequencies(n=6):
    return 2 * 100.0 * np.sin((2 * np.arange(1, n + 1) - 1) * np.pi / (2 * (2 * n + 1))) / (2 * np.pi)


@pytest.mark.parametrize("k", range(6))
def test_a_descriptor_is_refused_on_its_poles_and_not_beside_them(k):
    at = frequencies()[k]
    with pytest.raises(InputError, match=rf"undamped pole at {at:.9g} Hz"):
        fp.frequency_response(chain(), [at])
    with pytest.raises(InputError, match="undamped pole"):
        fp.frequency_response(chain(), np.sort(np.r_[np.linspace(1.0, 40.0, 30), at]))
    beside = np.array([at * (1 - 1e-9), at * (1 + 1e-9)])
    found = fp.frequency_response(chain(), beside).values[0, 0]
    assert found[0] == pytest.approx(-found[1], rel=1e-4)  # a simple pole between them
    assert np.isfinite(fp.frequency_response(chain(damping=1e-4), [at]).values).all()


def closed_spring(gain: float, integrators: str = "double") -> fp.Diagram:
    """A mass (or an integrator) held by a feedback gain, 1 / (s^2 + gain) or 1 / (s + gain)."""
    mass = fp.transfer_function(
        [1.0], [1.0, 0.0, 0.0] if integrators == "double" else [1.0, 0.0], input_name="u", output_name="y"
    )
    add = StateSpace(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), np.ones((1, 2)), ["a", "b"], ["e"])
    return fp.Diagram(
        blocks={"mass": mass, "gain": fp.gain(-gain), "add": add},
        connections=[("mass.y", "gain.u"), ("gain.y", "add.a"), ("add.e", "mass.u")],
        inputs={"f": "add.b"},
        outputs={"y": "mass.y"},
    )


def test_a_pole_that_the_loop_puts_on_the_axis_is_refused():
    loop, at = closed_spring(100.0), 10 / (2 * np.pi)
    with pytest.raises(InputError, match=r"diagram 'diagram' has an? (undamped )?pole .*at 1\.591549\d* Hz"):
        fp.frequency_response(loop, [1.0, at, 2.0])
    near = at * np.array([1 - 1e-7, 1 + 1e-7])
    exact = 1 / (100.0 - (2 * np.pi * near) ** 2)
    assert fp.frequency_response(loop, near).values[0, 0] == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("integrators", ["double", "single"])
def test_a_loop_holds_its_integrators_at_zero_hertz(integrators):
    """At s = 0 the block alone is infinite, the loop is 1 / gain; without a gain it is refused by its block."""
    loop = closed_spring(25.0, integrators)
    found = fp.frequency_response(loop, [0.0, 0.0, 0.3]).values[0, 0]
    whole = close(loop)
    assert found[:2] == pytest.approx((-whole.C @ np.linalg.solve(whole.A, whole.B))[0, 0], rel=1e-14)
    assert found[0] == pytest.approx(1 / 25.0, rel=1e-14)
    assert found[2] == pytest.approx(fp.frequency_response(whole, [0.3]).values[0, 0, 0], rel=1e-12)
    with pytest.raises(InputError, match="undamped pole at 0 Hz"):
        fp.frequency_response(closed_spring(0.0, integrators), [0.0, 1.0])


def test_a_lightly_damped_resonance_is_no_pole_on_the_axis():
    """Stiffness and damping fed back into a mode: the response at the top of its peak is that of the closed form."""
    for zeta in (1e-9, 1e-6):
        plant = fp.ModalPlant(
            omega=[10.0], zeta=zeta, shape_in=[[1.0, 1.0]], shape_out=[[1.0]], inputs=["u", "f"], outputs=["y"]
        )  # fmt: skip
        loop = fp.Diagram(
            blocks={"plant": plant, "gain": fp.gain(-44.0)},
            connections=[("plant.y", "gain.u"), ("gain.y", "plant.u")],
            inputs={"f": "plant.f"},
            outputs={"y": "plant.y"},
        )
        found = fp.frequency_response(loop, [12 / (2 * np.pi)]).values[0, 0, 0]
        assert found == pytest.approx(1 / (2j * zeta * 10 * 12), rel=1e-5)
