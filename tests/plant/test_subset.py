"""Plants with some of their modes."""

from __future__ import annotations

import numpy as np
import pytest

from flexplant.plant.modal import ModalPlant
from flexplant.plant.subset import with_modes
from flexplant.response.frequency import frequency_response


@pytest.mark.parametrize("mask", [True, False])
def test_modes_that_damping_does_not_couple_add_up(mask):
    """Damping couples modes 0 and 2, and 1 and 3: the two halves add up to the plant, whose direct terms each half keeps."""
    rng = np.random.default_rng(4)
    damping = np.diag([1.0, 2.0, 3.0, 4.0])
    damping[0, 2] = damping[2, 0] = 0.9
    damping[1, 3] = damping[3, 1] = -1.1
    shapes = {f"shape_out{kind}": rng.normal(size=(2, 4)) for kind in ("", "_velocity", "_acceleration")}
    feedthrough = rng.normal(size=(2, 1))
    plant = ModalPlant(
        omega=[10.0, 20.0, 30.0, 40.0],
        zeta=0.01,
        damping=damping,
        shape_in=rng.normal(size=(4, 1)),
        **shapes,
        feedthrough=feedthrough,
        inputs=["u"],
        outputs=["a", "b"],
    )
    hz = np.linspace(0.5, 9, 40)
    even = np.array([True, False, True, False])
    parts = [with_modes(plant, which if mask else np.flatnonzero(which)) for which in (even, ~even)]
    total = sum(frequency_response(part, hz).values for part in parts) - feedthrough[:, :, None]
    whole = frequency_response(plant, hz).values
    np.testing.assert_allclose(total, whole, atol=1e-12 * abs(whole).max())
