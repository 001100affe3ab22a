"""Compliant connections: springs and dampers against explicit spring elements assembled by hand."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from structures import chain_halves, elastic_hz, random_rotation

from flexplant.assembly import Connection, couple
from flexplant.errors import CouplingError
from flexplant.model.component import Component
from flexplant.model.geometry import Placement, cross_matrix
from flexplant.modes import normal_modes

METHODS = ["dual", "primal"]


def relative_motion(axes, arm):
    """(6, 12) C (u_a + theta_a x r - u_b), C (theta_a - theta_b) for coincident basic frames."""
    link = np.eye(6)
    link[:3, 3:] = -cross_matrix(arm)
    return np.kron(np.eye(2), axes) @ np.hstack([link, -np.eye(6)])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["number", "values", "matrix"])
def test_springs_equal_explicit_elements(method, kind):
    rng = np.random.default_rng(3)
    factor = rng.normal(size=(6, 6))
    k = {"number": 4e4, "values": 10.0 ** rng.uniform(3, 6, 6), "matrix": 1e4 * factor @ factor.T}[kind]
    matrix = {"number": 4e4 * np.eye(6), "values": np.diag(np.atleast_1d(k)) if kind == "values" else None, "matrix": k}[kind]
    axes, arm = random_rotation(9), np.array([0.1, 0.2, -0.3])
    left, right = chain_halves()
    joint = Connection("left", "right", [(4, 4)], frame=axes, stiffness=k, damping=np.multiply(k, 1e-4))
    system = couple([left, right], [joint], method=method, placements={"right": Placement(translation=arm)})
    g = np.zeros((6, left.n + right.n))
    g[:, np.r_[18:24, 24:30]] = relative_motion(axes, arm)
    stiffness = la.block_diag(left.stiffness, right.stiffness) + g.T @ matrix @ g
    np.testing.assert_allclose(system.stiffness.toarray(), stiffness, atol=1e-9 * abs(stiffness).max())
    np.testing.assert_allclose(system.damping.toarray(), 1e-4 * g.T @ matrix @ g, atol=1e-9 * abs(matrix).max())
    hz = normal_modes(system).frequency_hz
    assert not hz[:6].any()
    expected = elastic_hz(la.block_diag(left.mass, right.mass), stiffness, 6)
    round_off = 10 * np.finfo(float).eps * (expected.max() / expected) ** 2  # of LAPACK's smallest values, relative
    assert (abs(hz[6:] / expected - 1) < 1e-9 + round_off).all()


def test_a_stiff_spring_tends_to_the_rigid_connection():
    parts = chain_halves()
    rigid = normal_modes(couple(parts, [Connection("left", "right", [(4, 4)])])).frequency_hz[6:16]
    errors = []
    for k in (1e9, 1e10):
        soft = normal_modes(couple(parts, [Connection("left", "right", [(4, 4)], stiffness=k)])).frequency_hz[6:16]
        errors.append(abs(soft / rigid - 1).max())
    assert errors[1] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.05), "first order in 1/k"


@pytest.mark.parametrize("stiffness", [1e-6, 1e-3, 1.0, 1e3])
def test_a_soft_suspension_is_not_declared_rigid(stiffness):
    """On six soft springs to ground a stiff frame bounces at sqrt(k/m): small, and never zero."""
    left, right = chain_halves()
    joint = Connection("left", "right", [(4, 4)])
    held = couple([left, right], [joint, Connection("left", "ground", [1], "123", stiffness=stiffness, damping=0.0)])
    modes = normal_modes(held)
    assert modes.n_rigid == 3, "a ball joint leaves three rotations"
    assert (modes.frequency_hz[3:6] > 0).all()
    mass = sum(float(c.mass.diagonal().sum()) for c in (left, right))
    assert modes.frequency_hz[3] < np.sqrt(stiffness) / 2 / np.pi * 10 < 10 * mass * np.sqrt(stiffness)


def test_soft_springs_between_two_bodies_leave_six_rigid_modes():
    parts = chain_halves()
    modes = normal_modes(couple(parts, [Connection("left", "right", [(4, 4)], stiffness=1e-4)]))
    assert modes.n_rigid == 6
    assert (modes.frequency_hz[6:12] > 0).all()
    assert modes.frequency_hz[11] < 0.1


def test_springs_between_single_coordinates():
    part = {"mass": np.eye(2), "stiffness": np.zeros((2, 2)), "boundary": [(1, 1), (2, 1)]}
    parts = [Component(name="a", **part), Component(name="b", **part)]
    pairs = [((1, 1), (1, 1)), ((2, 1), (2, 1))]
    for stiffness in (8.0, [8.0, 8.0], np.diag([8.0, 8.0])):
        system = couple(parts, [Connection("a", "b", pairs, stiffness=stiffness)])
        expected = 8.0 * np.kron([[1, -1], [-1, 1]], np.eye(2))
        np.testing.assert_array_equal(system.stiffness.toarray(), expected)
    with pytest.raises(CouplingError, match=r"stiffness must be a number, 2 numbers"):
        Connection("a", "b", pairs, stiffness=[1.0, 2.0, 3.0])


@pytest.mark.parametrize("bad", [[1.0, 2.0], np.ones((2, 3)), "stiff", np.nan, [[1.0, 2.0], [3.0, 4.0]]])
def test_a_stiffness_that_does_not_fit_is_an_error(bad):
    with pytest.raises(CouplingError, match="connection 'a-b': stiffness"):
        Connection("a", "b", [(1, 1)], directions="12456", stiffness=bad)
