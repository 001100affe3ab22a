"""The modal plant that a study asks for."""

from __future__ import annotations

from flexplant.assembly import System
from flexplant.plant.modal import ModalPlant, modal_plant
from flexplant.plant.truncation import reduce_modes
from flexplant.study.schema import StudySpec


def build_plant(study: StudySpec, system: System) -> ModalPlant:
    """The modal plant of a study."""
    spec, damping = study.plant, study.damping
    plant = modal_plant(
        system,
        inputs=spec.inputs,
        outputs=spec.outputs,
        max_frequency_hz=spec.max_frequency_hz,
        damping_ratio=damping.ratio if damping is not None and damping.on == "system" else None,
        static_correction=spec.static_correction,
        off_diagonal_damping=spec.off_diagonal_damping,
    )
    return plant if spec.drop_tolerance is None else reduce_modes(plant, tolerance=spec.drop_tolerance)
