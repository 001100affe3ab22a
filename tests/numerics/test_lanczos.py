"""Block Lanczos against LAPACK and closed forms: repeated modes, singular mass, deflation, restarts, Sturm counts."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from flexplant.errors import SolverError
from flexplant.numerics.eigen import Wanted, count_below, dense_eigenpairs, shift_invert, sparse_eigenpairs
from flexplant.numerics.factorization import BACKENDS, analyze, factorize
from flexplant.numerics.lanczos import lanczos


def laplacian(n: int) -> sp.csr_array:
    return sp.csr_array(sp.diags_array([np.full(n, 2.0), np.full(n - 1, -1.0), np.full(n - 1, -1.0)], offsets=[0, 1, -1]))


def membrane(n: int) -> tuple[sp.csr_array, np.ndarray]:
    """A square membrane of n x n points and its exact eigenvalues: most of them double."""
    eye = sp.eye_array(n)
    k = sp.csr_array(sp.kron(laplacian(n), eye) + sp.kron(eye, laplacian(n)))
    line = 4 * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1))) ** 2
    return k, np.sort((line[:, None] + line).ravel())


def problem(n: int = 400, seed: int = 5) -> tuple[sp.csr_array, sp.csr_array]:
    """A banded stiffness and a consistent mass with unequal entries."""
    rng = np.random.default_rng(seed)
    springs = sp.diags_array(rng.uniform(1e3, 1e5, n + 1))
    d = sp.diags_array([np.ones(n), -np.ones(n)], offsets=[0, -1], shape=(n + 1, n))
    m = sp.diags_array(rng.uniform(0.5, 2, n)) + 0.1 * laplacian(n)
    return sp.csr_array(d.T @ springs @ d), sp.csr_array(m)


def test_modes_agree_with_lapack():
    k, m = problem()
    found = lanczos(factorize(k).solve, m, 40)
    expected = la.eigh(k.toarray(), m.toarray(), eigvals_only=True, subset_by_index=[0, 39])
    np.testing.assert_allclose(found.omega2, expected, rtol=1e-10)
    gram = found.vectors.T @ (m @ found.vectors)
    np.testing.assert_allclose(gram, np.eye(40), atol=1e-12)
    force = k @ found.vectors
    residual = np.linalg.norm(force - (m @ found.vectors) * found.omega2, axis=0) / np.linalg.norm(force, axis=0)
    assert residual.max() < 1e-6


def test_double_modes_are_both_found():
    k, exact = membrane(30)
    found = lanczos(factorize(k).solve, sp.eye_array(900, format="csr"), 50)
    np.testing.assert_allclose(found.omega2, exact[:50], rtol=1e-12)


def test_a_mode_repeated_more_often_than_the_block_is_wide():
    k, m = problem(60)
    copies = 13
    k, m = (sp.csr_array(sp.block_diag([x] * copies)) for x in (k, m))
    one = la.eigh(problem(60)[0].toarray(), problem(60)[1].toarray(), eigvals_only=True)
    limit = 0.5 * (one[2] + one[3])
    found = sparse_eigenpairs(k, m, np.zeros((k.shape[0], 0)), n_modes=None, max_omega2=limit)
    assert found.proved
    np.testing.assert_allclose(found.omega2, np.repeat(one[:3], copies), rtol=1e-10)


def test_singular_mass_has_only_finite_modes():
    k, _ = problem(300)
    mass = sp.csr_array(sp.diags_array(np.where(np.arange(300) % 3, 0.0, 1.0)))
    expected = dense_eigenpairs(k, mass, np.zeros((300, 0))).omega2
    assert expected.size == 100
    found = lanczos(factorize(k).solve, mass, 30)
    np.testing.assert_allclose(found.omega2, expected[:30], rtol=1e-9)
    force = k @ found.vectors
    assert np.linalg.norm(force - (mass @ found.vectors) * found.omega2) < 1e-6 * np.linalg.norm(force)
    everything = lanczos(factorize(k).solve, mass, 150)
    assert everything.exhausted
    np.testing.assert_allclose(everything.omega2, expected, rtol=1e-9)


def test_rigid_motion_is_deflated():
    k, m = problem()
    k = k - sp.csr_array(sp.diags_array(np.r_[k.sum(axis=1)]))  # cut the springs to ground
    rigid = np.ones((400, 1))
    found = sparse_eigenpairs(k, m, rigid, n_modes=10, max_omega2=None)
    assert found.zero == 1
    assert found.omega2[0] == 0.0
    expected = la.eigh(k.toarray(), m.toarray(), eigvals_only=True, subset_by_index=[1, 10])
    np.testing.assert_allclose(found.omega2[1:], expected, rtol=1e-8)
    assert abs(rigid.T @ (m @ found.vectors[:, 1:])).max() < 1e-10


def test_a_bounded_basis_restarts_and_finds_the_same():
    k, m = problem(1500)
    free = lanczos(factorize(k).solve, m, 30)
    bounded = lanczos(factorize(k).solve, m, 30, memory_limit=8 * 1500 * 80)
    assert bounded.restarts > 0
    assert free.restarts == 0
    np.testing.assert_allclose(bounded.omega2, free.omega2, rtol=1e-11)


def test_modes_around_a_shift_between_them():
    k, m = problem()
    values = la.eigh(k.toarray(), m.toarray(), eigvals_only=True)
    shift = 0.5 * (values[3] + values[4])
    factor = factorize(sp.csc_array(k - shift * m))
    assert factor.negative_pivots == 4
    found = lanczos(factor.solve, m, 12, shift=shift, below=4)
    np.testing.assert_allclose(found.omega2, values[:12], rtol=1e-9)


@pytest.mark.parametrize("backend", sorted(BACKENDS))
def test_sturm_count_equals_the_number_of_eigenvalues(backend):
    k, m = problem()
    values = la.eigh(k.toarray(), m.toarray(), eigvals_only=True)
    analysis = analyze(k, backend=backend)
    for number in (0, 1, 17, 200, 400):
        limit = 0.5 * (np.r_[0.0, values][number] + np.r_[values, 2 * values[-1]][number])
        counted = count_below(k, m, limit, analysis)
        assert counted == number or (backend == "superlu" and counted is None)  # None where it had to pivot


def test_a_missing_mode_is_an_error():
    k, m = problem()
    values = la.eigh(k.toarray(), m.toarray(), eigvals_only=True, subset_by_index=[0, 9])
    wrong = Wanted(n_modes=None, max_omega2=float(values[6]) * 0.999, count=9)
    with pytest.raises(SolverError, match="9 modes lie below the limit, but only 6"):
        shift_invert(factorize(k), m, wrong)


def test_runs_are_bit_equal():
    k, m = problem()
    a, b = (lanczos(factorize(k).solve, m, 20) for _ in range(2))
    np.testing.assert_array_equal(a.omega2, b.omega2)
    np.testing.assert_array_equal(a.vectors, b.vectors)


def test_progress_rises_and_can_interrupt():
    k, m = problem()
    shares: list[float] = []
    lanczos(factorize(k).solve, m, 20, progress=lambda what, share: shares.append(share))
    assert shares[-1] == 1.0
    assert len(shares) > 1

    def stop(what: str, share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        lanczos(factorize(k).solve, m, 20, progress=stop)
    assert lanczos(factorize(k).solve, m, 20).omega2.size == 20


def test_estimate_comes_before_the_work_and_refuses():
    k, _ = membrane(60)
    estimate = analyze(k, backend="rslab").estimate
    factor = factorize(k, backend="rslab")
    assert estimate.fill == pytest.approx(factor.fill, rel=0.05)
    assert estimate.peak_bytes > 8 * factor.fill
    with pytest.raises(SolverError, match=r"would need .* GB held .* allowed") as caught:
        factorize(k, memory_limit=1e5)
    assert "\n" not in str(caught.value)
    assert analyze(k, backend="superlu").estimate is None


@pytest.mark.parametrize("backend", sorted(BACKENDS))
def test_complex_symmetric_solutions(backend):
    k, m = problem()
    a = sp.csc_array(k * (1 + 0.03j) - 1e3 * m)
    b = np.random.default_rng(1).standard_normal((400, 3))
    factor = factorize(a, backend=backend)
    assert factor.negative_pivots is None
    np.testing.assert_allclose(a @ factor.solve(b), b, atol=1e-9)


def test_an_analysis_serves_other_values_and_patterns():
    k, m = problem()
    analysis = analyze(k, backend="rslab")
    b = np.ones(400)
    for matrix in (k, sp.csr_array(k + 7 * m), sp.csr_array(sp.diags_array(np.arange(1.0, 401)))):
        np.testing.assert_allclose(matrix @ analysis.factorize(matrix).solve(b), b, atol=1e-9)
