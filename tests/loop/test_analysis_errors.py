"""Bad requests to norms, margins, grids, sweeps and spectra: one line each, of our own kind, that says what is wrong."""

import numpy as np
import pytest

import flexplant as fp
from flexplant.plant.modal import ModalPlant

RNG = np.random.default_rng(0)
SHAPES = {"shape_in": RNG.normal(size=(3, 2)), "shape_out": RNG.normal(size=(2, 3)), "inputs": ["a", "b"], "outputs": ["x", "y"]}
PLANT = ModalPlant(omega=[10.0, 20.0, 30.0], zeta=0.01, **SHAPES)
UNDAMPED = ModalPlant(omega=[10.0, 20.0, 30.0], zeta=0.0, **SHAPES)
ON_MODE = 20.0 / (2 * np.pi)
STABLE = fp.state_space(PLANT)
UNSTABLE = fp.StateSpace(STABLE.A + np.eye(6), STABLE.B, STABLE.C, STABLE.D, STABLE.inputs, STABLE.outputs)
DIAGRAM = fp.Diagram(blocks={"p": PLANT}, inputs={"a": "p.a", "b": "p.b"}, outputs={"x": "p.x"})
RESPONSE = fp.frequency_response(PLANT, [1.0, 2.0])
ONES = np.ones((1, 1, 3))
PAIR = np.ones(2)

CASES = [
    (lambda: fp.hinf_norm(3), "needs a plant, got int"),
    (lambda: fp.hinf_norm(RESPONSE), "needs a plant, got DataArray"),
    (lambda: fp.hinf_norm(PLANT, tolerance="x"), "tolerance is relative"),
    (lambda: fp.hinf_norm(UNSTABLE, unbounded="error"), "unstable pole at 0.9"),
    (lambda: fp.hinf_norm(UNDAMPED, unbounded="error"), "mode 0 .* at 1.59155 Hz has no damping"),
    (lambda: fp.singular_values(PLANT), "needs frequency_hz"),
    (lambda: fp.singular_values(3, [1.0]), "got int"),
    (lambda: fp.singular_values(np.ones((2, 2, 3))), "got ndarray"),
    (lambda: fp.singular_values(PLANT, [-1.0]), "entry 0 is -1.0"),
    (lambda: fp.singular_values(UNDAMPED, [ON_MODE]), "exactly on mode 1"),
    (lambda: fp.h2_norm(3), "got int"),
    (lambda: fp.h2_norm(DIAGRAM), "got Diagram .close"),
    (lambda: fp.white_noise_rms(PLANT, np.eye(3)), r"shape \(3, 3\)"),
    (lambda: fp.white_noise_rms(PLANT, -np.eye(2)), "not negative"),
    (lambda: fp.white_noise_rms(PLANT, np.array([[1.0, 0.5], [0.0, 1.0]])), "symmetric"),
    (lambda: fp.white_noise_rms(PLANT, "x"), "real numbers"),
    (lambda: fp.margins(3), "got int"),
    (lambda: fp.margins(fp.select(PLANT, inputs=["a"])), "give a square one"),
    (lambda: fp.margins(DIAGRAM), "loop_margins"),
    (lambda: fp.sensitivity(3), "got int"),
    (lambda: fp.complementary_sensitivity(fp.state_space(fp.select(PLANT, inputs=["a"]))), "needs a square one"),
    (lambda: fp.crossing_hz(PLANT, "a"), "must be finite"),
    (lambda: fp.bandwidth_hz(PLANT, "a"), "must be negative"),
    (lambda: fp.adaptive_grid(PLANT, "a", 2.0), "give 0 < low < high"),
    (lambda: fp.adaptive_grid(PLANT, 2.0, 1.0), "give 0 < low < high"),
    (lambda: fp.adaptive_grid(PLANT, 1.0, 2.0, per_mode=5.5), "whole, at least 3"),
    (lambda: fp.adaptive_grid(PLANT, 1.0, 2.0, per_mode="a"), "whole, at least 3"),
    (lambda: fp.GainSweep(np.ones((2, 2)), ONES, ONES, ONES), r"G_zw of shape \(2, 2\)"),
    (lambda: fp.GainSweep("a", ONES, ONES, ONES), "not an array of numbers"),
    (lambda: fp.GainSweep(ONES * np.nan, ONES, ONES, ONES), "finite response"),
    (lambda: fp.GainSweep(ONES, ONES, ONES, ONES)("a"), "must be a finite number"),
    (lambda: fp.GainSweep(ONES, ONES, ONES, ONES)(np.nan), "must be a finite number"),
    (lambda: fp.GainSweep(ONES, ONES, ONES, ONES)(1.0), "a pole exactly at frequency number 0"),
    (lambda: fp.GainSweep(ONES, ONES, ONES, ONES)(2.0, np.zeros((1, 1, 2), complex)), r"out is complex128 \(1, 1, 2\)"),
    (lambda: fp.random_response(3, {}, [1.0, 2.0]), "got int"),
    (lambda: fp.random_response(PLANT, {"A": 1.0}, [1.0, 2.0]), "no input 'A'"),
    (lambda: fp.random_response(UNDAMPED, {"a": 1.0}, [1.0, ON_MODE]), "exactly on mode 1"),
    (lambda: fp.random_response(PLANT, {"a": "x"}, [1.0, 2.0]), "real numbers"),
    (lambda: fp.random_response(PLANT, None, [1.0, 2.0]), r"\(2, 2, 2\) is needed"),
    (lambda: fp.random_response(PLANT, "psd", [1.0, 2.0]), "neither a mapping"),
    (lambda: fp.random_response(PLANT, np.array([[1, 1j], [1j, 1]])[:, :, None] * PAIR, [1.0, 2.0]), "Hermitian"),
    (lambda: fp.random_response(PLANT, np.array([[1, 2], [2, 1]])[:, :, None] * PAIR, [1.0, 2.0]), "coherence above one"),
    (lambda: fp.random_response(UNSTABLE, {"a": 1.0}, [1.0, 2.0]), r"pole at 0\.9.*rad/s"),
    (lambda: fp.loop_figures(3), "needs a LineOfSight"),
    (lambda: fp.loop_response(3, "a"), "broken in a Diagram"),
]


@pytest.mark.parametrize("k", range(len(CASES)))
def test_a_bad_request_is_answered_in_one_line(k):
    call, message = CASES[k]
    with pytest.raises(fp.InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300
