"""Time delays: a Pade all-pass in continuous time, exact samples in discrete time."""

from __future__ import annotations

import math

import numpy as np

from flexplant.blocks.basic import static
from flexplant.blocks.transfer_function import transfer_function
from flexplant.errors import InputError
from flexplant.model.arrays import is_number
from flexplant.plant.state_space import StateSpace

MAX_SAMPLES = 10_000  # states of a shift register, a dense matrix of 800 MB
MAX_PADE_ORDER = 12  # beyond it the companion form of the all-pass loses digits


def pade_delay(
    seconds: float, order: int, *, input_name: str = "u", output_name: str = "y", unit: str = "", name: str = "delay"
) -> StateSpace:
    """exp(-s T) as the diagonal Pade approximant of the given order: magnitude exactly 1, phase error O((w T)^(2 order + 1)).

    Good while w T stays below about 2 order. T = 0 is a wire. InputError for a negative T or an order outside 1..12.
    Source: Golub and Van Loan, Matrix Computations, section 9.3 (coefficients of the approximant of exp).
    """
    if not (is_number(seconds) and 0 <= seconds < math.inf):
        raise InputError(f"delay {name!r}: {seconds!r:.60} s; use a finite time that is not negative")
    if not is_number(order) or order % 1 or not 1 <= order <= MAX_PADE_ORDER:
        text = f"use 1 to {MAX_PADE_ORDER}, or sample_delay for an exact delay"
        raise InputError(f"delay {name!r:.60}: Pade order {order!r:.60}; {text}")
    if seconds == 0:
        return static([[1.0]], inputs=[input_name], outputs=[output_name], name=name, input_units=[unit], output_units=[unit])
    # c_k (sT)^k with c_k = (2n - k)! n! / ((2n)! k! (n - k)!), highest power first
    n = int(order)
    powers = range(n, -1, -1)
    c = [math.factorial(2 * n - k) * math.comb(n, k) / math.factorial(2 * n) * seconds**k for k in powers]
    numerator = [value * (-1) ** k for value, k in zip(c, powers, strict=True)]
    return transfer_function(
        numerator, c, input_name=input_name, output_name=output_name, input_unit=unit, output_unit=unit, name=name
    )


def sample_delay(
    samples: int, dt: float, *, input_name: str = "u", output_name: str = "y", unit: str = "", name: str = "delay"
) -> StateSpace:
    """y[k] = u[k - samples], exact, as a shift register of `samples` states. InputError for a negative number of samples."""
    if not is_number(samples) or samples % 1 or not 0 <= samples <= MAX_SAMPLES:
        raise InputError(f"delay {name!r:.60}: {samples!r:.60} samples; use a whole number from 0 to {MAX_SAMPLES}")
    if dt is None:
        raise InputError(f"delay {name!r:.60}: dt is None; give the sample time in seconds")
    n = int(samples)
    shift, C = np.eye(n, k=-1), np.eye(n)[-1:] if n else np.zeros((1, 0))
    D = np.zeros((1, 1)) if n else np.ones((1, 1))
    return StateSpace(
        shift, np.eye(n, 1), C, D, [input_name], [output_name], dt=dt, name=name, input_units=[unit], output_units=[unit]
    )
