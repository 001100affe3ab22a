"""Leaving the rigid-body modes out of a plant, by an explicit choice of the caller."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexplant.errors import expect
from flexplant.model.arrays import FloatArray
from flexplant.plant.modal import ModalPlant


def without_rigid_body(plant: ModalPlant) -> ModalPlant:
    """The plant with its flexible modes only (omega > 0): elastic motion relative to the drifting, turning mean body.

    A free spacecraft drifts under its wheels, and a pointing loop removes that elsewhere; simulate the elastic part where the
    drift is of no interest. Static correction and feedthrough stay. `report` counts the modes left out.
    """
    expect(plant, ModalPlant, "without_rigid_body", "modal_plant(system, ...) makes one")
    keep = plant.omega > 0

    def columns(matrix: FloatArray | None) -> FloatArray | None:
        return None if matrix is None else matrix[:, keep]

    return replace(
        plant,
        omega=plant.omega[keep],
        zeta=plant.zeta[keep],
        shape_in=plant.shape_in[keep],
        shape_out=columns(plant.shape_out),
        shape_out_velocity=columns(plant.shape_out_velocity),
        shape_out_acceleration=columns(plant.shape_out_acceleration),
        damping=None if plant.damping is None else plant.damping[np.ix_(keep, keep)],
        report={**plant.report, "rigid_body_modes_left_out": int(np.count_nonzero(~keep))},
    )
