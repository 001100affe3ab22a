"""Stability of a loop of continuous and digital linear systems: the map of its states over the common period of its samples."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from flexplant.errors import InputError
from flexplant.loop.hybrid import Hybrid
from flexplant.loop.period_map import period_map
from flexplant.plant.state_space import StateSpace

LARGEST = 500  # states up to which the eigenvalues take less time than most simulations
LONGEST = 1000  # steps in a period


def refuse_growing(hybrid: Hybrid, dt: float, name: str, tolerance: float) -> None:
    """InputError with the multiplier where a loop whose sampled blocks are all linear grows from period to period.

    Nonlinear blocks have no multipliers, and loops of many states or a very long period are left to show it themselves.
    """
    if not hybrid.elements or not all(isinstance(e.block, StateSpace) for e in hybrid.elements):
        return
    steps = math.lcm(*(e.period(dt) for e in hybrid.elements))
    if hybrid.linear.n_states + hybrid.initial.size > LARGEST or steps > LONGEST:
        return
    z = multipliers(hybrid, dt, steps)
    worst = int(np.argmax(abs(z))) if z.size else 0
    if z.size and abs(z[worst]) > 1 + tolerance:
        raise InputError(
            f"simulate: {name!r} is unstable: multiplier z = {z[worst].real:.6g} {abs(z[worst].imag):+.6g}i over"
            f" {steps * dt:.6g} s, outside the unit circle; lower a gain, or set unstable='allow' to see it grow"
        )


def multipliers(hybrid: Hybrid, dt: float, steps: int) -> npt.NDArray[np.complex128]:
    """Eigenvalues of the map of [eta, eta', l, digital states] over `steps` samples."""
    found: npt.NDArray[np.complex128] = np.linalg.eigvals(period_map(hybrid, dt, steps).F).astype(complex)
    return found
