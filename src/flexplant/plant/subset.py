"""A plant with some of its modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from flexplant.model.arrays import FloatArray, IntArray
from flexplant.plant.modal import ModalPlant


def with_modes(plant: ModalPlant, which: npt.NDArray[np.bool_] | IntArray) -> ModalPlant:
    """The plant with only the modes `which`, a mask (n,) or places, and all its direct terms."""
    at = np.flatnonzero(which) if which.dtype == bool else which

    def columns(shapes: FloatArray | None) -> FloatArray | None:
        return None if shapes is None else shapes[:, at]

    return replace(
        plant,
        omega=plant.omega[at],
        zeta=plant.zeta[at],
        damping=None if plant.damping is None else plant.damping[np.ix_(at, at)],
        shape_in=plant.shape_in[at],
        shape_out=columns(plant.shape_out),
        shape_out_velocity=columns(plant.shape_out_velocity),
        shape_out_acceleration=columns(plant.shape_out_acceleration),
    )
