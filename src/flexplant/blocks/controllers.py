"""Controllers of the line-of-sight loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from flexplant.blocks.basic import static
from flexplant.blocks.optics import AXES, per_axis, ports
from flexplant.plant.state_space import StateSpace


def proportional(gains: npt.ArrayLike, *, axes: Sequence[str] = AXES, name: str = "controller") -> StateSpace:
    """V = Kp e per axis (equation 33). gains: V/rad, one value or one per axis. Ports "error_x" (rad) -> "voltage_x" (V)."""
    return static(
        np.diag(per_axis(gains, axes, f"controller {name!r}: gains")),
        inputs=ports("error", axes),
        outputs=ports("voltage", axes),
        name=name,
        input_units=["rad"] * len(axes),
        output_units=["V"] * len(axes),
    )
