"""Transfer functions, PID, delays and the mirror against their formulas."""

import control
import numpy as np
import pytest

from flexplant.blocks.basic import gain
from flexplant.blocks.delay import pade_delay, sample_delay
from flexplant.blocks.mirror import steering_mirror
from flexplant.blocks.pid import pid
from flexplant.blocks.transfer_function import transfer_function
from flexplant.errors import InputError
from flexplant.response.frequency import frequency_response

HZ = np.geomspace(1e-2, 1e4, 41)
S = 2j * np.pi * HZ


def siso(block):
    return frequency_response(block, HZ).values[0, 0]


@pytest.mark.parametrize(
    ("num", "den"),
    [
        ([5.0], [2.0]),
        ([3.0], [1.0, 0.0, 0.0]),
        ([2.0, 1.0], [1.0, 3.0]),
        ([0.0, 0.0, 1.0, 4.0], [2.0, 60.0, 1e4]),
        ([1.0, 0.0, 0.0, 7.0], [1.0, 1e3, 1e6, 1e12]),
        ([1e18], np.poly([-1.0, -1e3, -2e3 + 5e3j, -2e3 - 5e3j, -1e6]).real),
    ],
)
def test_transfer_function_is_the_ratio_of_its_polynomials(num, den):
    expected = np.polyval(num, S) / np.polyval(den, S)
    # where G falls far below its feedthrough, the difference of the two is all that state space can hold
    floor = 1e-14 * abs(num[0] / den[0]) if len(num) == len(den) else 0.0
    assert siso(transfer_function(num, den)) == pytest.approx(expected, rel=1e-9, abs=floor)


def test_transfer_function_entries_stay_near_the_pole_size():
    """A companion form of poles near 1e4 rad/s has entries up to 1e24 as it stands; the scaled one stays near 1e4."""
    block = transfer_function([1.0], np.poly(-1e4 * np.arange(1, 7)))
    assert abs(block.A).max() < 1e6
    assert np.sort(np.linalg.eigvals(block.A).real) == pytest.approx(-1e4 * np.arange(6, 0, -1), rel=1e-6)


def test_transfer_function_agrees_with_python_control():
    num, den = [2.0, 3.0, 5.0], [1.0, 4.0, 50.0, 600.0]
    peer = control.frequency_response(control.tf(num, den), 2 * np.pi * HZ).complex.ravel()
    assert siso(transfer_function(num, den)) == pytest.approx(peer, rel=1e-10, abs=0)


def test_discrete_transfer_function():
    block = transfer_function([0.5, 0.1], [1.0, -0.4], dt=1e-5)
    z = np.exp(S * 1e-5)
    assert siso(block) == pytest.approx((0.5 * z + 0.1) / (z - 0.4), rel=1e-12, abs=0)


def test_transfer_function_errors():
    with pytest.raises(InputError, match="improper: numerator of degree 2 over degree 1"):
        transfer_function([1, 0, 0], [1, 1])
    with pytest.raises(InputError, match="denominator is zero"):
        transfer_function([1], [0, 0])
    with pytest.raises(InputError, match="numerator"):
        transfer_function([np.nan], [1, 1])


@pytest.mark.parametrize(("kp", "ki", "kd", "states"), [(2.0, 0, 0, 0), (2.0, 30.0, 0, 1), (0, 0, 0.5, 1), (2.0, 30.0, 0.5, 2)])
def test_pid_response(kp, ki, kd, states):
    block = pid(kp, ki, kd, filter_time=1e-3)
    assert block.n_states == states
    floor = 1e-15 * kd / 1e-3  # the derivative at low frequency is a small difference of feedthrough and lag
    assert siso(block) == pytest.approx(kp + ki / S + kd * S / (1e-3 * S + 1), rel=1e-12, abs=floor)


def test_pid_needs_a_derivative_filter():
    with pytest.raises(InputError, match="filter_time"):
        pid(1.0, 0.0, 0.1)


@pytest.mark.parametrize("order", [1, 2, 3, 5, 8])
def test_pade_is_all_pass_with_error_of_order_2n_plus_1(order):
    T = 1e-3
    block = pade_delay(T, order)
    assert abs(siso(block)) == pytest.approx(1.0, rel=1e-9, abs=0)

    def phase_error(x):
        G = frequency_response(block, [x / (2 * np.pi * T)]).values[0, 0]
        return abs(np.angle(G[0] * np.exp(1j * x)))

    x = 0.5 * order if order < 8 else 6.0
    slope = np.log2(phase_error(x) / phase_error(x / 2))
    assert slope == pytest.approx(2 * order + 1, abs=0.6)


def test_pade_agrees_with_python_control():
    num, den = control.pade(2e-3, 4)
    assert siso(pade_delay(2e-3, 4)) == pytest.approx(np.polyval(num, S) / np.polyval(den, S), rel=1e-8, abs=0)


def test_no_delay_is_a_wire():
    assert pade_delay(0.0, 3).n_states == 0
    assert sample_delay(0, 1e-3).D.item() == 1.0


def test_sample_delay_is_exact():
    dt, samples = 1e-5, 7
    assert siso(sample_delay(samples, dt)) == pytest.approx(np.exp(-S * samples * dt), rel=1e-12, abs=0)


@pytest.mark.parametrize("call", [lambda: pade_delay(-1.0, 2), lambda: pade_delay(1.0, 0), lambda: sample_delay(-1, 1e-3)])
def test_delay_errors(call):
    with pytest.raises(InputError, match="delay 'delay'"):
        call()


def test_steering_mirror_per_axis():
    omega, zeta = np.array([100.0, 250.0]), np.array([0.3, 0.7])
    G = frequency_response(steering_mirror(omega, zeta), HZ).values
    for k in range(2):
        assert G[k, k] == pytest.approx(omega[k] ** 2 / (S**2 + 2 * zeta[k] * omega[k] * S + omega[k] ** 2), rel=1e-12, abs=0)
    assert not G[0, 1].any()
    with pytest.raises(InputError, match="mirror"):
        steering_mirror(0.0, 0.3)


@pytest.mark.parametrize(
    "call",
    [
        lambda: gain("high"),
        lambda: gain(1j),
        lambda: transfer_function(["one"], [1, 1]),
        lambda: transfer_function([1j], [1, 1]),
        lambda: pade_delay("0.1", 2),
        lambda: pade_delay(0.1, 2.5),
        lambda: sample_delay("3", 0.1),
        lambda: sample_delay(np.nan, 0.1),
        lambda: pid("high"),
        lambda: pid(1.0, np.nan),
    ],
)
def test_arguments_that_are_no_real_numbers(call):
    with pytest.raises(InputError, match=r"^(gain|transfer function|delay|pid) '"):
        call()
