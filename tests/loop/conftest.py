"""A free-free plant with a wheel and a lens, and the published loop parameters."""

import numpy as np
import pytest

from flexplant.blocks.wheel import Wheel
from flexplant.loop.line_of_sight import LineOfSight
from flexplant.plant.modal import ModalPlant

WHEEL_INPUTS = [f"bus.9001.{d}" for d in range(1, 7)]
LENS_OUTPUTS = ["optic.1.1", "optic.1.2"]


@pytest.fixture(scope="session")
def published():
    """Table 3 of the published example."""
    return LineOfSight(focal_length=1.5, gain=1800.0, mirror_omega=100.0, mirror_zeta=0.3)


@pytest.fixture(scope="session")
def wheel():
    """Table 3's wheel on the plant's inputs."""
    return Wheel(amplitude=5e-6, harmonics=[1, 2, 3], phase_rad=np.radians([0, 90, 0, 0, 90, 0]), inputs=WHEEL_INPUTS)


def build_plant(n_flexible=12, n_rigid=6, zeta=0.005, seed=1):
    rng = np.random.default_rng(seed)
    omega = np.r_[np.zeros(n_rigid), 2 * np.pi * np.sort(rng.uniform(50, 700, n_flexible))]
    n = omega.size
    return ModalPlant(
        omega=omega,
        zeta=zeta,
        shape_in=rng.normal(size=(n, 6)) / 10,
        shape_out=rng.normal(size=(2, n)) / 10,
        static_correction=rng.normal(size=(2, 6)) * 1e-9,
        inputs=WHEEL_INPUTS,
        outputs=LENS_OUTPUTS,
        input_units=["N"] * 3 + ["N m"] * 3,
        output_units=["m"] * 2,
    )


@pytest.fixture(scope="session")
def plant():
    """Six rigid-body and twelve flexible modes."""
    return build_plant()


@pytest.fixture(scope="session")
def make_plant():
    return build_plant
