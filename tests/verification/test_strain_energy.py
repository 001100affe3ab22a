"""Strain energy of rigid motion: by direction and by coordinate, against a spring whose energy is known."""

from __future__ import annotations

import numpy as np
import pytest

import flexplant as fp
from flexplant.verification import strain_energy


def bar_with_spring(spring: float) -> fp.Component:
    """Two nodes 2 m apart along x, joined axially, node 2 held in y by a spring to ground."""
    k = np.zeros((12, 12))
    k[np.ix_([0, 6], [0, 6])] = 1e6 * np.array([[1.0, -1], [-1, 1]])
    k[7, 7] += spring
    nodes = fp.Nodes([1, 2], [[0.0, 0, 0], [2.0, 0, 0]])
    return fp.Component(name="bar", mass=np.eye(12), stiffness=k, boundary=[(1, "123456"), (2, "123456")], nodes=nodes)


def test_energy_by_direction_and_coordinate():
    strain = strain_energy(bar_with_spring(40.0))
    expected = np.zeros(6)
    expected[1] = 0.5 * 40.0  # unit translation along y
    expected[5] = 0.5 * 40.0  # unit rotation about z through the middle moves node 2 by 1 m
    np.testing.assert_allclose(strain.energy, expected, atol=1e-9)
    np.testing.assert_allclose(strain.per_dof.sum(axis=0), strain.energy, atol=1e-12)
    row = strain.per_dof[7]
    np.testing.assert_allclose(row, expected, atol=1e-9)
    assert strain.worst_dof[1] == (2, 2)
    assert strain.force[1] == pytest.approx(40.0)
    assert "bar.2.2" in strain.explanation


def test_a_free_component_has_none():
    strain = strain_energy(bar_with_spring(0.0))
    assert strain.ratio.max() < 1e-15
    assert not strain.energy.any()
