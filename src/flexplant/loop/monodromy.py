"""Stability of a loop of continuous and digital linear systems: the map of its states over the common period of its samples."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from flexplant.errors import InputError
from flexplant.loop.hybrid import Hybrid
from flexplant.loop.stepping import stepper
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
    """Eigenvalues of the map of [eta, eta', l, digital states] over `steps` samples, stepped from each unit vector."""
    linear, nw, nz, one = hybrid.linear, hybrid.nw, hybrid.nz, stepper(hybrid.linear, dt, "zero")
    width, n = linear.B.shape[1], linear.omega.size
    rows, direct, forced = np.hstack([linear.C_modes, linear.C])[nz:], linear.D[nz:, nw:], one.drive[nw:width].T
    size, states = linear.n_states, hybrid.initial.size
    unit = np.eye(size + states)
    x, s, p = unit[:size], unit[size:], np.zeros((width - nw, size + states))
    for k in range(steps):
        due = [(e, e.block) for e in hybrid.elements if k % e.period(dt) == 0 and isinstance(e.block, StateSpace)]
        seen = rows @ x
        for e, block in due:
            p[e.outputs] = block.C @ s[e.states] + block.D @ (seen[e.inputs] + direct[e.inputs] @ p)
        s = s.copy()
        for e, block in due:
            s[e.states] = block.A @ s[e.states] + block.B @ (seen[e.inputs] + direct[e.inputs] @ p)
        modes = np.einsum("nij,jnk->ink", one.modes, x[: 2 * n].reshape(2, n, -1)).reshape(2 * n, -1)
        x = np.vstack([modes, one.from_modes @ x[: 2 * n] + one.A @ x[2 * n :]]) + forced @ p
    found: npt.NDArray[np.complex128] = np.linalg.eigvals(np.vstack([x, s])).astype(complex)
    return found
