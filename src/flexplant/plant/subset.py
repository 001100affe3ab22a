"""A plant with some of its modes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from flexplant.model.arrays import FloatArray, IntArray
from flexplant.plant.modal import ModalPlant


def with_modes(plant: ModalPlant, which: npt.NDArray[np.bool_] | IntArray) -> ModalPlant:
    """The plant with only the modes `which`, a mask (n,) or places, and all its direct terms."""
    at: IntArray = np.flatnonzero(which) if which.dtype == bool else np.asarray(which, dtype=np.int64)

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
        report=_counted(plant, at),
    )


def _counted(plant: ModalPlant, at: IntArray) -> dict[str, Any]:
    """The plant's report with the counts of what is left, where it has them; residual modes lie above all others."""
    report, n = dict(plant.report), plant.n_modes
    own = at
    if "residual_modes" in report:
        own = at[at < n - report["residual_modes"]]
        report["residual_modes"] = int(at.size - own.size)
    if "modes_kept" in report:
        report["modes_kept"] = int(own.size)
    if "highest_frequency_hz" in report:
        report["highest_frequency_hz"] = float(plant.frequency_hz[own].max(initial=0.0))
    return report
