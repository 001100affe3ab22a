"""Modes of matrices whose mass is nearly, or quite, singular: against eigenvalues known exactly, dense and sparse."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from flexplant.errors import SolverError
from flexplant.model.component import Component
from flexplant.modes import normal_modes
from flexplant.numerics.eigen import dense_eigenpairs, sparse_eigenpairs
from flexplant.numerics.eigen_dense import finite_count

N = 40
POWERS = [20, 30, 40, 44, 46, None]  # 2^-p: 1e-6 to 1.4e-14, and 0; every entry of M below is exact in double precision
NONE = np.zeros((N, 0))


def known(power: int | None, **changed: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """K = T^T diag(w^2 m) T, M = T^T diag(m) T without any rounding, T of whole numbers with a whole inverse; w^2 ascending.

    One mass is 2^-p; its w^2 comes last. changed: w^2 of single motions, "_3" the third.
    """
    rng = np.random.default_rng(0)
    lower, upper = (np.eye(N) + np.diag(rng.choice([-1.0, 0.0, 1.0], N - 1), at) for at in (-1, 1))
    turn = lower @ upper
    masses, stiff = np.ones(N), np.round(2.0 ** np.linspace(4, 24, N))
    stiff[1] = stiff[0]  # a repeated mode
    for at, value in changed.items():
        stiff[int(at[1:])] = value
    masses[20] = 0.0 if power is None else 2.0**-power
    omega2 = np.divide(stiff, masses, out=np.full(N, np.inf), where=masses > 0)
    return turn.T @ np.diag(stiff) @ turn, turn.T @ np.diag(masses) @ turn, np.sort(omega2), np.linalg.inv(turn)


@pytest.mark.parametrize("power", POWERS)
def test_low_modes_do_not_suffer_from_a_nearly_massless_motion(power):
    k, m, omega2, _ = known(power)
    found = dense_eigenpairs(k, m, NONE)
    np.testing.assert_allclose(found.omega2[: N - 1], omega2[: N - 1], rtol=1e-12)
    low = found.vectors[:, : N - 1]
    np.testing.assert_allclose(low.T @ m @ low, np.eye(N - 1), atol=1e-11)
    omega = np.sqrt(omega2[: N - 1])
    np.testing.assert_allclose(low.T @ k @ low / np.outer(omega, omega), np.eye(N - 1), atol=1e-10)
    if found.omega2.size == N:  # what the mass' own round-off leaves certain
        assert found.omega2[-1] == pytest.approx(omega2[-1], rel=1e-14 * 2.0**power)
    sparse = sparse_eigenpairs(sp.csc_array(k), sp.csr_array(m), NONE, n_modes=15, max_omega2=None)
    np.testing.assert_allclose(sparse.omega2, omega2[:15], rtol=1e-11)


@pytest.mark.parametrize("power", POWERS)
def test_rigid_motions_stay_exact_zeros_beside_a_nearly_massless_one(power):
    k, m, omega2, motions = known(power, _0=0.0, _3=0.0)
    for rigid in (motions[:, [0, 3]], motions[:, [0, 3]] @ [[1.0, 2.0], [0.5, 3.0]]):
        found = dense_eigenpairs(k, m, rigid)
        assert found.zero == 2
        np.testing.assert_array_equal(found.omega2[:2], 0.0)
        np.testing.assert_allclose(found.omega2[2 : N - 1], omega2[2 : N - 1], rtol=1e-12)
    sparse = sparse_eigenpairs(sp.csc_array(k), sp.csr_array(m), rigid, n_modes=15, max_omega2=None)
    np.testing.assert_allclose(sparse.omega2[2:], omega2[2 : sparse.omega2.size], rtol=1e-11)
    part = Component(name="c", mass=m, stiffness=k, boundary=[(i, 1) for i in range(N)])
    modes = normal_modes(part)
    assert modes.n_rigid == 2
    np.testing.assert_allclose(modes.omega[2 : N - 1] ** 2, omega2[2 : N - 1], rtol=1e-12)


@pytest.mark.parametrize("power", [30, 40, None])
@pytest.mark.parametrize("lowest", [-1.0, -3000.0, -(2.0**21)])
def test_prestress_that_buckles_keeps_its_negative_square(power, lowest):
    k, m, omega2, _ = known(power, _7=lowest)
    found = dense_eigenpairs(k, m, NONE)
    near = max(abs(lowest), omega2[1])
    np.testing.assert_allclose(found.omega2[: N - 1], omega2[: N - 1], rtol=1e-12, atol=1e-12 * near)
    assert found.omega2[0] == pytest.approx(lowest, rel=1e-11)


@pytest.mark.parametrize("decades", [8, 14, 20])
def test_any_range_of_frequencies_is_solved_to_round_off(decades):
    """A well-conditioned mass: stiffness that spreads over decades, alone, must not blur the soft modes."""
    size = 2.0 ** np.round(np.linspace(0, decades / 0.30103, N))
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(N, N)))[0]
    inertia = turn @ np.diag(np.linspace(1, 2, N)) @ turn.T
    found = dense_eigenpairs(np.diag(size), 0.5 * (inertia + inertia.T), NONE)
    low = found.vectors[:, :5]
    # the soft motions see the stiff ones as held: w^2 from the 20 softest coordinates, to 1e-decades/2
    soft = dense_eigenpairs(np.diag(size[:20]), inertia[:20, :20], np.zeros((20, 0)))
    np.testing.assert_allclose(found.omega2[:5], soft.omega2[:5], rtol=max(4 * size[4] / size[20], 1e-13))
    np.testing.assert_allclose(np.einsum("ij,i,ij->j", low, size, low), found.omega2[:5], rtol=1e-13)
    assert found.omega2.size == N
    assert np.sum(np.log(found.omega2)) == pytest.approx(np.sum(np.log(size)) - np.linalg.slogdet(inertia)[1], rel=1e-13)
    omega = np.sqrt(found.omega2)
    np.testing.assert_allclose((found.vectors.T * size) @ found.vectors / np.outer(omega, omega), np.eye(N), atol=1e-9)


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("mass", [1e-6, 1e-12, 1e-16, 0.0])
def test_many_nearly_massless_degrees_of_freedom_leave_lanczos_its_digits(mass, free):
    """Every second mass of a chain of springs is tiny: without it, springs in series between the others."""
    n = 300
    k = 1e6 * sp.diags_array(
        [-np.ones(n - 1), np.r_[1.0 if free else 2.0, np.full(n - 2, 2.0), 1.0], -np.ones(n - 1)], offsets=[-1, 0, 1]
    )
    m = sp.diags_array(np.where(np.arange(n) % 2, mass, 1.0))
    rigid = np.ones((n, 1)) if free else np.zeros((n, 0))
    found = sparse_eigenpairs(sp.csr_array(k), sp.csr_array(m), rigid, n_modes=8, max_omega2=None)
    dense = dense_eigenpairs(k.toarray(), m.toarray(), rigid, n_modes=9)
    kept = slice(rigid.shape[1], 8)
    np.testing.assert_allclose(found.omega2[kept], dense.omega2[kept], rtol=1e-9)
    assert found.residuals[kept].max() < 1e-7
    main = np.r_[0.5 if free else 1.5, np.full(n // 2 - 2, 1.0), 0.5]  # the last one's spring leads to nothing
    series = 1e6 * (np.diag(main) - 0.5 * np.eye(n // 2, k=1) - 0.5 * np.eye(n // 2, k=-1))
    np.testing.assert_allclose(dense.omega2[kept], np.linalg.eigvalsh(series)[kept], rtol=1e-8 + 4 * mass)


def test_fewer_modes_are_the_first_of_all():
    k, m, omega2, _ = known(40)
    for limits in ({"n_modes": 3}, {"max_omega2": omega2[4]}, {"n_modes": 12, "max_omega2": omega2[5]}):
        found = dense_eigenpairs(k, m, NONE, **limits).omega2
        assert found.size >= 3
        np.testing.assert_allclose(found, omega2[: found.size], rtol=1e-11)
        assert found.size >= limits.get("n_modes", 0) or found[-1] > limits["max_omega2"]


def test_what_cannot_be_solved_is_said():
    for mass in (np.diag([1.0, -1e-3, 1.0]), np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 2.0]])):
        with pytest.raises(SolverError, match="mass matrix is indefinite"):
            dense_eigenpairs(np.eye(3), mass, np.zeros((3, 0)))
    with pytest.raises(SolverError, match="neither mass nor stiffness"):
        dense_eigenpairs(np.diag([1.0, 0.0, 2.0]), np.diag([1.0, 0.0, 2.0]), np.zeros((3, 0)))
    assert finite_count(np.zeros((3, 3))) == 0
    assert finite_count(np.diag([1.0, 1e-9, 0.0])) == 2
    assert dense_eigenpairs(np.eye(2), np.zeros((2, 2)), np.zeros((2, 0))).omega2.size == 0
