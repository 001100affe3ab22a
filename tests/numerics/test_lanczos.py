"""Block Lanczos against LAPACK and closed forms: repeated modes, singular mass, deflation, restarts, Sturm counts."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from flexplant.errors import SolverError
from flexplant.numerics import products
from flexplant.numerics.completion import completed
from flexplant.numerics.eigen import Pencil, Wanted, dense_eigenpairs, shift_invert, sparse_eigenpairs
from flexplant.numerics.factorization import Estimate, analyze, factorize
from flexplant.numerics.krylov import Krylov
from flexplant.numerics.lanczos import lanczos
from flexplant.numerics.sturm import count_below, gap_below_last, is_cheap


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


@pytest.mark.parametrize("large", [False, True])
def test_the_number_of_modes_cuts_a_pair_or_a_cluster(large, monkeypatch):
    """Of equal or nearly equal modes at the band's edge some are wanted, some not; by the loops of large models too."""
    if large:
        pytest.importorskip("numba")
        monkeypatch.setattr(products, "LARGE", 1)
    k, exact = membrane(30)
    factor = factorize(k, backend="supernodal" if large else None)
    assert exact[20] == pytest.approx(exact[21], rel=1e-12)
    found = lanczos(factor.solve, sp.eye_array(900, format="csr"), 21)
    np.testing.assert_allclose(found.omega2, exact[:21], rtol=1e-12)
    stretched = sp.csr_array(sp.kron(laplacian(30), sp.eye_array(30)) + (1 + 1e-7) * sp.kron(sp.eye_array(30), laplacian(30)))
    line = 4 * np.sin(np.arange(1, 31) * np.pi / 62) ** 2
    exact = np.sort((line[:, None] + (1 + 1e-7) * line).ravel())
    found = lanczos(factorize(stretched, backend="supernodal" if large else None).solve, sp.eye_array(900, format="csr"), 21)
    np.testing.assert_allclose(found.omega2, exact[:21], rtol=1e-12)


@pytest.mark.parametrize("backend", ["rslab", "supernodal"])
def test_free_and_singular_problems_by_either_factor(backend, monkeypatch):
    """A small negative shift makes a free model definite; massless rows have no modes. Both compiled, as large models are."""
    pytest.importorskip("numba")
    monkeypatch.setattr(products, "LARGE", 1)
    k, m = problem()
    free = sp.csr_array(k - sp.diags_array(np.r_[k.sum(axis=1)]))
    shift = -1e-3 * float((k.diagonal() / m.diagonal()).max())
    factor = factorize(sp.csc_array(free - shift * m), backend=backend)
    assert factor.backend == backend
    rigid = np.ones((400, 1)) / np.sqrt(m.sum())
    found = lanczos(factor.solve, m, 12, shift=shift, locked=rigid)
    expected = la.eigh(free.toarray(), m.toarray(), eigvals_only=True, subset_by_index=[1, 12])
    np.testing.assert_allclose(found.omega2, expected, rtol=1e-7)
    mass = sp.csr_array(sp.diags_array(np.where(np.arange(400) % 3, 0.0, 1.0)))
    found = lanczos(factorize(k, backend=backend).solve, mass, 30)
    np.testing.assert_allclose(found.omega2, dense_eigenpairs(k, mass, np.zeros((400, 0))).omega2[:30], rtol=1e-9)


def test_a_mode_repeated_more_often_than_the_block_is_wide():
    k, m = problem(60)
    copies = 13
    k, m = (sp.csr_array(sp.block_diag([x] * copies)) for x in (k, m))
    one = la.eigh(problem(60)[0].toarray(), problem(60)[1].toarray(), eigvals_only=True)
    limit = 0.5 * (one[2] + one[3])
    found = sparse_eigenpairs(k, m, np.zeros((k.shape[0], 0)), n_modes=None, max_omega2=limit)
    assert found.proved
    np.testing.assert_allclose(found.omega2, np.repeat(one[:3], copies), rtol=1e-10)


def repeated(copies: int) -> tuple[sp.csr_array, sp.csr_array, np.ndarray]:
    """Equal, separate structures: every w^2 comes `copies` times."""
    k, m = problem(60)
    one = la.eigh(k.toarray(), m.toarray(), eigvals_only=True)
    k, m = (sp.csr_array(sp.block_diag([x] * copies)) for x in (k, m))
    return k, m, np.repeat(one, copies)


@pytest.mark.parametrize("n_modes", [9, 12, 13])
def test_the_first_modes_are_counted_where_one_repeats_twelve_times(n_modes):
    k, m, exact = repeated(12)
    none = np.zeros((k.shape[0], 0))
    found = sparse_eigenpairs(k, m, none, n_modes=n_modes, max_omega2=None, verify_count=True)
    assert found.proved
    np.testing.assert_allclose(found.omega2, exact[:n_modes], rtol=1e-10)


def test_what_is_not_counted_is_not_called_proved():
    """A block of 8 sees 8 of 40 equal modes: why counting is worth its price."""
    k, m, exact = repeated(40)
    none = np.zeros((k.shape[0], 0))
    missed = sparse_eigenpairs(k, m, none, n_modes=12, max_omega2=None, verify_count=False)
    assert not missed.proved
    assert missed.omega2[8] > 2 * exact[0]
    found = sparse_eigenpairs(k, m, none, n_modes=12, max_omega2=None, verify_count=True)
    np.testing.assert_allclose(found.omega2, exact[:12], rtol=1e-10)
    assert found.proved


def test_a_count_that_stays_different_is_an_error():
    class Miscounted(Pencil):
        def count_below(self, omega2: float) -> int | None:
            return 7

    k, m = problem()
    with pytest.raises(SolverError, match="7 modes lie below the limit, but only 4"):
        shift_invert(factorize(k), Miscounted(k, m, analyze(k)), Wanted(5, None), verify_count=True)


def test_counting_by_default_where_a_factor_is_cheap():
    k, m = problem()
    none = np.zeros((400, 0))
    assert sparse_eigenpairs(k, m, none, n_modes=10, max_omega2=None).proved
    estimate, factor = Estimate(10, 80, 160, 1e9), factorize(k)
    assert not is_cheap(estimate, factor, columns=10)
    assert is_cheap(estimate, factor, columns=10**8)
    assert not is_cheap(None, factor, columns=10**8)


@pytest.mark.parametrize(
    ("omega2", "expected"), [([1.0, 2.0, 3.0], 2.9997), ([1.0, 3.0, 3.0 + 1e-8], 2.9997), ([4.0, 4.0], 3.9996)]
)
def test_counts_are_made_below_the_last_group(omega2, expected):
    assert gap_below_last(np.array(omega2)) == pytest.approx(expected, rel=1e-9)


def test_counts_stay_in_a_narrow_gap():
    limit = gap_below_last(np.array([1.0, 2.0, 2.00001]))
    assert 2.0 < limit < 2.00001


def test_residuals_are_those_of_the_matrices():
    k, m = problem()
    k = k - sp.csr_array(sp.diags_array(np.r_[k.sum(axis=1)]))
    found = sparse_eigenpairs(k, m, np.ones((400, 1)), n_modes=12, max_omega2=None)
    kd, md, x = k.toarray(), m.toarray(), found.vectors
    force = kd @ x
    size = np.linalg.norm(np.c_[abs(kd) @ abs(x[:, :1]), force[:, 1:]], axis=0)
    honest = np.linalg.norm(force - md @ x * found.omega2, axis=0) / size
    np.testing.assert_allclose(found.residuals, honest, rtol=0.05, atol=1e-12)
    assert found.residuals.shape == (13,)
    assert found.residuals.max() < 1e-7


def test_a_loose_solution_says_so():
    """Stopped early, the recurrence's own residuals bound what comes back, and are not zero."""
    k, m = problem(1500)
    loose = lanczos(factorize(k).solve, m, 20, tolerance=1e-3)
    force = k @ loose.vectors
    true = np.linalg.norm(force - (m @ loose.vectors) * loose.omega2, axis=0) / np.linalg.norm(force, axis=0)
    assert 1e-12 < loose.residuals.max() <= 1e-3
    assert true.max() < 1e-2


def test_singular_mass_is_counted_too():
    k, _ = problem(300)
    mass = sp.csr_array(sp.diags_array(np.where(np.arange(300) % 3, 0.0, 1.0)))
    found = sparse_eigenpairs(k, mass, np.zeros((300, 0)), n_modes=25, max_omega2=None, verify_count=True)
    assert found.proved
    expected = dense_eigenpairs(k, mass, np.zeros((300, 0))).omega2[:25]
    np.testing.assert_allclose(found.omega2, expected, rtol=1e-9)


def test_rigid_motions_are_left_out_of_the_count():
    k, m = problem()
    k = k - sp.csr_array(sp.diags_array(np.r_[k.sum(axis=1)]))
    found = sparse_eigenpairs(k, m, np.ones((400, 1)), n_modes=10, max_omega2=None, verify_count=True)
    assert found.proved
    assert found.omega2.size == 11


def test_nothing_is_counted_among_rigid_motions():
    """Sixteen separate floating chains: the first twelve modes are all round-off around zero."""
    k, m = problem(60)
    k = sp.csr_array(k - sp.diags_array(np.r_[k.sum(axis=1)]))
    k, m = (sp.csr_array(sp.block_diag([x] * 16)) for x in (k, m))
    none = np.zeros((k.shape[0], 0))
    found = sparse_eigenpairs(k, m, none, n_modes=12, max_omega2=None, verify_count=True)
    assert abs(found.omega2).max() < 1e-3
    assert not found.proved


def test_a_completed_pattern_is_the_same_matrix_to_the_last_bit():
    plane, _ = membrane(12)
    k = sp.csr_array(sp.kron(plane, np.diag([1.0, 2.0, 3.0])))
    groups = np.repeat(np.arange(144), 3)
    full = completed(k, groups)
    assert full.nnz == k.nnz  # blocks that are mostly empty stay as they are
    mixed = sp.csr_array(k + sp.csr_array(sp.kron(plane, [[0, 1, 0], [1, 0, 1], [0, 1, 0]])) * 0.1)
    full = completed(mixed, groups)
    assert full.nnz == 9 * plane.nnz
    assert mixed.nnz < full.nnz
    np.testing.assert_array_equal(np.where(mixed.toarray() == 0, 0, full.toarray()), mixed.toarray())
    assert abs(full - full.T).max() == 0
    b = np.ones(432)
    np.testing.assert_allclose(factorize(full).solve(b), factorize(mixed).solve(b), rtol=1e-12)
    dead = sp.csr_array(mixed - sp.diags_array(np.r_[mixed.diagonal()[0], np.zeros(431)]))
    assert completed(dead, groups).nnz == dead.nnz  # a row without stiffness must stay visible


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


@pytest.mark.parametrize("backend", ["rslab", "superlu"])
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
        shift_invert(factorize(k), Pencil(k, m, analyze(k)), wrong)


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
    with pytest.raises(SolverError, match="would need"):
        factorize(k, backend="superlu", memory_limit=1e5)


@pytest.mark.parametrize("backend", ["rslab", "superlu"])
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


def test_ritz_vectors_are_one_application_better():
    """X = OP V S / theta, which the recurrence has in its next block, without another solution."""
    k, m = problem()
    factor = factorize(k)
    space = Krylov(factor.solve, m, np.zeros((k.shape[0], 0)), 80, 4, 1)
    for _ in range(5):
        space.step()
    theta, s, _ = space.ritz()
    pick = slice(-6, None)
    found = space.vectors(theta[pick], s[:, pick])
    applied = factor.solve(m @ (space.basis[:, : space.last] @ s[:, pick])) / theta[pick]
    np.testing.assert_allclose(found, applied, atol=1e-10 * abs(applied).max())
    assert abs(found - space.basis[:, : space.last] @ s[:, pick]).max() > 1e-6 * abs(found).max(), "the blocks left something"
