"""The fast steering mirror."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from flexplant.blocks.optics import AXES, per_axis, ports
from flexplant.errors import InputError
from flexplant.plant.state_space import StateSpace


def steering_mirror(omega: npt.ArrayLike, zeta: npt.ArrayLike, *, axes: Sequence[str] = AXES, name: str = "mirror") -> StateSpace:
    """alpha / V = omega^2 / (s^2 + 2 zeta omega s + omega^2) per axis, uncoupled (equations 31-32).

    omega: rad/s, zeta: damping ratio, each one value or one per axis. Ports "voltage_x" ... -> "angle_x" ...
    The states are angle and angular rate / omega, so the matrices scale with omega alone. InputError for omega <= 0.
    """
    w, z = per_axis(omega, axes, f"mirror {name!r}: omega"), per_axis(zeta, axes, f"mirror {name!r}: zeta")
    if not (w > 0).all() or not (z >= 0).all():
        raise InputError(f"mirror {name!r}: omega {w} must be positive and zeta {z} not negative")
    n = len(axes)
    W, none = np.diag(w), np.zeros((n, n))
    A = np.block([[none, W], [-W, -2 * np.diag(z * w)]])
    B, C = np.vstack([none, W]), np.hstack([np.eye(n), none])
    return StateSpace(
        A,
        B,
        C,
        none,
        ports("voltage", axes),
        ports("angle", axes),
        name=name,
        input_units=["V"] * n,
        output_units=["rad"] * n,
    )
