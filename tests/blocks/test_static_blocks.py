"""Gains, summing junctions and optics are plain matrices with names and units."""

import numpy as np
import pytest

from flexplant.blocks.basic import gain, renamed, summing_junction
from flexplant.blocks.controllers import proportional
from flexplant.blocks.optics import angle_sensor, flat_mirror, line_of_sight_geometry, thin_lens
from flexplant.errors import InputError, ModelError


def test_gain_takes_a_number_a_vector_or_a_matrix():
    assert gain(3.0).D.tolist() == [[3.0]]
    assert gain([1.0, 2.0]).D.tolist() == [[1.0, 0.0], [0.0, 2.0]]
    matrix = gain([[1.0, 2.0, 3.0]])
    assert matrix.D.shape == (1, 3)
    assert matrix.inputs == ("u1", "u2", "u3")
    assert matrix.outputs == ("y",)


def test_gain_refuses_ports_that_do_not_fit():
    with pytest.raises(ModelError, match="gain"):
        gain([1.0, 2.0], inputs=["a"])
    with pytest.raises(InputError, match=r"shape \(1, 1, 1\)"):
        gain([[[1.0]]])


def test_summing_junction_by_text_or_by_names():
    assert summing_junction("+-").D.tolist() == [[1.0, -1.0]]
    named = summing_junction({"reference": 1, "measured": -1}, output_name="error", unit="rad")
    assert named.inputs == ("reference", "measured")
    assert named.outputs == ("error",)
    assert named.input_units == ("rad", "rad")


@pytest.mark.parametrize("signs", ["", "+x", {}])
def test_summing_junction_refuses_other_signs(signs):
    with pytest.raises(InputError, match="signs"):
        summing_junction(signs)


def test_renamed_keeps_the_numbers():
    block = renamed(gain(2.0), name="half", inputs=["a"], outputs=["b"], input_units=["m"], output_units=["rad"])
    assert (block.name, block.inputs, block.outputs, block.input_units, block.output_units) == (
        "half",
        ("a",),
        ("b",),
        ("m",),
        ("rad",),
    )
    assert block.D.item() == 2.0


def test_optics_compose_to_the_line_of_sight_equation():
    """r = f (dx / f + 2 alpha), from the three blocks one after another."""
    f, dx, alpha = 1.5, np.array([1e-6, -2e-6]), np.array([3e-7, 4e-7])
    tilt = thin_lens(f).D @ dx
    spot = line_of_sight_geometry(f).D @ np.r_[tilt, alpha]
    assert spot == pytest.approx(dx + 2 * f * alpha, rel=1e-15)
    assert flat_mirror().D @ alpha == pytest.approx(2 * alpha, rel=1e-15)
    # the sensor gives back the mirror angle that moves the spot alone
    assert angle_sensor(f).D @ (2 * f * alpha) == pytest.approx(alpha, rel=1e-15)


def test_zero_focal_length_is_an_error():
    with pytest.raises(InputError, match="focal length 0"):
        thin_lens(0.0)


def test_proportional_gain_per_axis():
    assert proportional([1800, 900]).D.tolist() == [[1800.0, 0.0], [0.0, 900.0]]
    with pytest.raises(InputError, match="controller"):
        proportional([1.0, 2.0, 3.0])
