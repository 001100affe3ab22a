"""Mass properties do not lose digits when the model stands far from its origin."""

from __future__ import annotations

import numpy as np

import flexplant as fp


def four_masses(at: np.ndarray) -> fp.Component:
    """Four lumped masses with rotational inertia about a point."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]]) + at
    mass = np.diag(np.tile([2.0, 2, 2, 0.1, 0.2, 0.3], 4))
    nodes = fp.Nodes([1, 2, 3, 4], corners)
    return fp.Component(
        name="far", mass=mass, stiffness=np.zeros((24, 24)), boundary=[(i, "123456") for i in range(1, 5)], nodes=nodes
    )


def test_inertia_ten_kilometres_away():
    here = fp.mass_properties(four_masses(np.zeros(3)))
    at = np.array([1e4, -2e4, 3e4])
    there = fp.mass_properties(four_masses(at))
    np.testing.assert_allclose(there.inertia, here.inertia, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(there.center_of_gravity - at, here.center_of_gravity, atol=1e-9)
