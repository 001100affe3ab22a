"""The harmonic wheel (equation 34) and sums of tones: two routes to the same signal, and Parseval."""

import numpy as np
import pytest

from flexplant.blocks.tones import Tones, rms, tone_signal
from flexplant.blocks.wheel import Wheel, harmonic_amplitudes, wheel_disturbance, wheel_tones
from flexplant.errors import InputError

EXAMPLE = {"amplitude": 5e-6, "harmonics": [1, 2, 3], "phase_rad": np.radians([0, 90, 0, 0, 90, 0])}  # the published example


def equation_34(wheel, omega, t):
    """Sum of sines, literally."""
    m = np.zeros((6, t.size))
    for j in range(6):
        for k in range(wheel.harmonics.shape[1]):
            h, c, phase = wheel.harmonics[j, k], wheel.amplitude[j, k], wheel.phase_rad[j, k]
            m[j] += c * omega**2 * np.sin(2 * np.pi * h * omega * t + phase)
    return m


@pytest.mark.parametrize("omega", [20.0, 56.4])
def test_disturbance_is_equation_34(omega):
    wheel, t = Wheel(**EXAMPLE), np.linspace(0, 0.3, 400)
    assert wheel_disturbance(wheel, omega, t) == pytest.approx(equation_34(wheel, omega, t), abs=1e-12)


def test_components_may_have_harmonics_of_their_own():
    rng = np.random.default_rng(3)
    harmonics = rng.choice([0.5, 1.0, 1.98, 3.1], size=(6, 5))  # repeated ones in a row must add up
    wheel = Wheel(amplitude=rng.normal(size=(6, 5)), harmonics=harmonics, phase_rad=rng.normal(size=(6, 5)))
    t = np.linspace(0, 0.2, 300)
    assert wheel_tones(wheel, 30.0).frequency_hz == pytest.approx(30.0 * np.array([0.5, 1.0, 1.98, 3.1]))
    assert wheel_disturbance(wheel, 30.0, t) == pytest.approx(equation_34(wheel, 30.0, t), abs=1e-9)


def test_rotation_turns_forces_and_moments():
    """Columns are the wheel's axes in the plant frame: a wheel axial force along plant x."""
    to_plant = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
    _, table = harmonic_amplitudes(Wheel(amplitude=[0, 0, 1, 0, 0, 2], harmonics=[1], rotation=to_plant))
    assert abs(table[:, 0]) == pytest.approx([1, 0, 0, 2, 0, 0], abs=1e-15)


def test_force_grows_with_speed_squared():
    wheel = Wheel(**EXAMPLE)
    assert wheel_tones(wheel, 40.0).amplitude == pytest.approx(4 * wheel_tones(wheel, 20.0).amplitude)


def test_parseval():
    tones = wheel_tones(Wheel(**EXAMPLE), 10.0)
    t = np.arange(1000) * 1e-4  # one turn of the wheel
    assert rms(tones) == pytest.approx(np.sqrt((tone_signal(tones, t) ** 2).mean(axis=1)), rel=1e-12)


def test_parseval_with_a_constant():
    tones = Tones(frequency_hz=[0.0, 5.0], amplitude=[[3.0, 4.0j]], inputs=["u"])
    t = np.arange(200) * 1e-3
    assert rms(tones) == pytest.approx(np.sqrt((tone_signal(tones, t) ** 2).mean(axis=1)), rel=1e-12)


def test_mean_sampling_is_the_mean_of_each_interval():
    tones = wheel_tones(Wheel(**EXAMPLE), 33.0)
    dt, fine = 1e-3, 2000
    inside = (np.arange(fine) + 0.5) / fine * dt
    means = tone_signal(tones, (np.arange(5)[:, None] * dt + inside).ravel()).reshape(6, 5, fine).mean(axis=2)
    assert tone_signal(tones, np.arange(5) * dt, sampling="mean") == pytest.approx(means, abs=1e-6 * abs(means).max())


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Wheel(amplitude=np.ones((6, 2)), harmonics=[1, 2, 3]), r"amplitude of shape \(6, 2\)"),
        (lambda: Wheel(amplitude=1.0, harmonics=[-1.0]), "harmonics"),
        (lambda: Wheel(amplitude=1.0, harmonics=[1.0], rotation=-np.eye(3)), "proper"),
        (lambda: Wheel(amplitude=1.0, harmonics=[1.0], inputs=["a"]), "1 input names"),
        (lambda: Wheel(amplitude=1.0, harmonics=[1.0], inputs="abcdef"), "inputs must be a list of names"),
        (lambda: Wheel(amplitude=1j, harmonics=[1.0]), "wheel: amplitude: real numbers"),
        (lambda: Wheel(amplitude=1.0, harmonics=["one"]), "wheel: harmonics: real numbers"),
        (lambda: wheel_tones(Wheel(**EXAMPLE), "20"), "wheel speed '20'"),
        (lambda: wheel_disturbance(Wheel(**EXAMPLE), 20.0, [0.0, np.nan]), "finite instants"),
        (lambda: wheel_disturbance(Wheel(**EXAMPLE), 20.0, [[0.0, 1.0]]), r"shape \(1, 2\)"),
        (lambda: wheel_tones(Wheel(**EXAMPLE), -3.0), "wheel speed -3.0"),
        (lambda: Tones(frequency_hz=[1.0, 1.0], amplitude=[[1, 1]], inputs=["u"]), "1.0 Hz is listed twice"),
        (lambda: Tones(frequency_hz=[1.0], amplitude=[[1, 1]], inputs=["u"]), r"shape \(1, 2\) for 1 inputs"),
        (lambda: tone_signal(wheel_tones(Wheel(**EXAMPLE), 3.0), [0, 1], sampling="best"), "'best' is not a choice"),
    ],
)
def test_errors(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_tones_above_half_the_sampling_rate_are_told():
    """960 Hz seen every millisecond is 40 Hz."""
    time = np.arange(100) * 1e-3
    fast = Tones(frequency_hz=[960.0, 2000.0], amplitude=[[1.0, 0.0]], inputs=["f"])
    with pytest.warns(
        UserWarning, match=r"a tone of 960 Hz is sampled at 1000 Hz and appears as one of 40 Hz: use a step below 0\.0005208"
    ):
        seen = tone_signal(fast, time)
    assert np.allclose(seen, tone_signal(Tones(frequency_hz=[40.0], amplitude=[[1.0]], inputs=["f"]), time), atol=1e-9)
    assert tone_signal(Tones(frequency_hz=[499.0], amplitude=[[1.0]], inputs=["f"]), time).shape == (1, 100)
