"""Leaving the rigid-body modes out of a plant, by an explicit choice of the caller."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexplant.errors import expect
from flexplant.plant.modal import ModalPlant
from flexplant.plant.subset import with_modes


def without_rigid_body(plant: ModalPlant) -> ModalPlant:
    """The plant with its flexible modes only (omega > 0): elastic motion relative to the drifting, turning mean body.

    A free spacecraft drifts under its wheels, and a pointing loop removes that elsewhere; simulate the elastic part where the
    drift is of no interest. Static correction and feedthrough stay. `report` counts the modes left out.
    """
    expect(plant, ModalPlant, "without_rigid_body", "modal_plant(system, ...) makes one")
    keep = plant.omega > 0
    left_out = int(np.count_nonzero(~keep))
    elastic = with_modes(plant, keep)
    return replace(elastic, report={**elastic.report, "rigid_body_modes_left_out": left_out})
