"""The short ways of small models against dense algebra: the banded factor, its inertia, and modes from it."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from flexplant.numerics.eigen import Pencil, Wanted, dense_lowest, shift_invert
from flexplant.numerics.eigen_held import held_modes
from flexplant.numerics.eigen_small import SURE, all_modes, is_dense, shapes, short_lanczos
from flexplant.numerics.factorization import BandedFactor, analyze, factorize


def chain(n: int, seed: int = 3) -> tuple[sp.csr_array, sp.csr_array]:
    """Masses on uneven springs, each tied to its next three; consistent (tridiagonal) mass."""
    rng = np.random.default_rng(seed)
    k = sp.diags_array(rng.uniform(0.5, 1.0, n)).tocsr() * 1e-2
    for gap in (1, 2, 3):
        spring = rng.uniform(0.5, 2.0, n - gap)
        rows = sp.csr_array(sp.diags_array([np.ones(n - gap), -np.ones(n - gap)], offsets=[0, gap], shape=(n - gap, n)))
        k = k + rows.T @ sp.diags_array(spring) @ rows
    m = sp.diags_array([np.full(n - 1, 0.2), rng.uniform(0.9, 1.1, n), np.full(n - 1, 0.2)], offsets=[-1, 0, 1])
    return sp.csr_array(k), sp.csr_array(m)


def shuffled(matrix: sp.csr_array, seed: int = 8) -> sp.csr_array:
    order = np.random.default_rng(seed).permutation(matrix.shape[0])
    return sp.csr_array(matrix[order][:, order])


@pytest.mark.parametrize("n", [1, 3, 64, 65, 97, 300])
def test_half_solutions_are_a_root_of_the_inverse(n):
    k = shuffled(chain(n)[0]) if n > 3 else sp.csr_array(np.eye(n) * 3 + 1)
    factor = factorize(k, backend="banded")
    assert isinstance(factor, BandedFactor)
    root = factor.forward(np.eye(n))
    np.testing.assert_allclose(root.T @ root @ k.toarray(), np.eye(n), atol=1e-9)
    np.testing.assert_allclose(factor.backward(root), la.inv(k.toarray()), rtol=0, atol=1e-9 * abs(root).max() ** 2)


def test_a_random_numbering_costs_no_more_than_the_natural_one():
    k = chain(600)[0]
    natural, mixed = (analyze(x, backend="banded").estimate for x in (k, shuffled(k)))
    assert mixed.flops < 1.5 * natural.flops
    assert natural.fill < 600 * 64 * 3


def test_the_fill_of_the_estimate_is_that_of_the_factor():
    k, m = chain(333)
    analysis = analyze(shuffled(k), backend="banded")
    assert analysis.factorize(shuffled(k)).fill == analysis.estimate.fill
    assert analysis.factorize(shuffled(sp.csr_array(k - 5 * m))).fill == analysis.estimate.fill


@pytest.mark.parametrize("seed", range(4))
def test_inertia_of_shifted_pencils_adds_up_over_blocks(seed):
    k, m = chain(260, seed)
    values = la.eigvalsh(k.toarray(), m.toarray())
    analysis = analyze(shuffled(k), backend="banded")
    for below in (1, 17, 130, 259):
        shift = 0.5 * (values[below - 1] + values[below])
        factor = analysis.factorize(shuffled(sp.csr_array(k - shift * m)))
        assert factor.negative_pivots == below


def test_a_singular_leading_block_is_no_obstacle():
    """A saddle point: the first block is zero, the whole is regular."""
    n = 100
    coupling = sp.csr_array(np.random.default_rng(1).standard_normal((n, n)) + 20 * np.eye(n))
    matrix = sp.csr_array(sp.block_array([[None, coupling], [coupling.T, sp.eye_array(n)]]))
    factor = factorize(matrix, backend="banded")
    assert factor.negative_pivots == n
    b = np.random.default_rng(2).standard_normal((2 * n, 3))
    np.testing.assert_allclose(matrix @ factor.solve(b), b, atol=1e-9)


@pytest.mark.parametrize("modes", [1, 7, 40])
def test_short_lanczos_and_dense_algebra_agree(modes):
    k, m = (shuffled(x) for x in chain(420))
    factor = factorize(k, backend="banded")
    values, vectors = la.eigh(k.toarray(), m.toarray())
    found = short_lanczos(factor, m, modes)
    np.testing.assert_allclose(found.omega2, values[:modes], rtol=1e-11)
    np.testing.assert_allclose(found.vectors.T @ m @ found.vectors, np.eye(modes), atol=1e-10)
    np.testing.assert_allclose(abs(found.vectors.T @ m @ vectors[:, :modes]), np.eye(modes), atol=1e-6)


def test_the_basis_of_short_lanczos_stays_orthogonal_to_its_end(monkeypatch):
    """One pass against the whole basis would lose a digit every few blocks."""
    from flexplant.numerics import eigen_small

    k, m = chain(420)
    kept = []
    whole = eigen_small._orthogonal
    monkeypatch.setattr(eigen_small, "_orthogonal", lambda basis, image: kept.append(basis) or whole(basis, image))
    short_lanczos(factorize(k, backend="banded"), m, 60)
    assert kept[-1].shape[1] > 150
    np.testing.assert_allclose(kept[-1].T @ kept[-1], np.eye(kept[-1].shape[1]), atol=1e-13)


def test_all_modes_of_a_stiff_chain_follow_the_formula():
    """The lowest w^2 is 1e-8 of the highest."""
    n = 150
    k = sp.csr_array(sp.diags_array([np.full(n, 2.0), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1]))
    plate = sp.csr_array(k @ k)
    factor = factorize(plate, backend="banded")
    omega2, vectors = all_modes(factor, sp.eye_array(n))
    exact = (2 - 2 * np.cos(np.arange(1, n + 1) * np.pi / (n + 1))) ** 2
    np.testing.assert_allclose(omega2[:5], exact[:5], rtol=1e-8)
    np.testing.assert_allclose(omega2, exact[: omega2.size], rtol=1e-6)
    x = shapes(factor, sp.eye_array(n), vectors[:, :5])
    np.testing.assert_allclose(x.T @ plate @ x, np.diag(exact[:5]), atol=1e-10)


def test_a_singular_mass_has_as_many_modes_as_its_rank():
    k, m = chain(180)
    loaded = np.arange(0, 180, 9)
    mass = sp.csr_array((np.full(loaded.size, 2.0), (loaded, loaded)), shape=m.shape)
    factor = factorize(k, backend="banded")
    omega2, _ = all_modes(factor, mass)
    flexibility = la.inv(k.toarray())[np.ix_(loaded, loaded)]
    np.testing.assert_allclose(omega2, np.sort(1 / (2 * la.eigvalsh(flexibility))), rtol=1e-10)
    found, following = dense_lowest(factor, k, mass, None, loaded.size)
    assert found.omega2.size == loaded.size
    assert following == np.inf
    np.testing.assert_allclose(found.omega2, omega2, rtol=1e-8)


def test_an_indefinite_mass_is_left_to_the_general_way():
    k, m = chain(90)
    assert all_modes(factorize(k, backend="banded"), m - 1.2 * sp.eye_array(90)) is None


def test_a_space_that_closes_is_left_to_the_general_way():
    """Thirty equal masses on equal springs: one eigenvalue, so the second block has nothing new."""
    n = 400
    k = sp.csr_array(3.0 * sp.eye_array(n))
    assert short_lanczos(factorize(k, backend="banded"), sp.eye_array(n), 9) is None


@pytest.mark.parametrize("n_modes", [12, 30])
def test_repeated_modes_are_complete_by_count(n_modes):
    """Twelve equal plates: each mode comes twelve times, and a block is eight wide."""
    k, m = chain(45)
    k, m = (sp.csr_array(sp.block_diag([x] * 12)) for x in (k, m))
    assert not is_dense(k.shape[0], n_modes)
    analysis = analyze(k, backend="banded")
    wanted = Wanted(n_modes, None, None)
    found = shift_invert(analysis.factorize(k), Pencil(k, m, analysis), wanted, verify_count=True)
    values = np.repeat(la.eigvalsh(*(x.toarray()[:45, :45] for x in (k, m))), 12)
    assert found.proved
    np.testing.assert_allclose(found.omega2, values[:n_modes], rtol=1e-9)


def test_what_is_sure_ends_where_round_off_begins():
    k, m = chain(60)
    omega2, _ = all_modes(factorize(k, backend="banded"), m)
    assert omega2[-1] < omega2[0] / SURE
    assert omega2.size == 60


def held(k, m, wanted: Wanted, **options):
    """Short modes of a pencil in a mixed order, which must not need the general way."""
    k, m = (shuffled(sp.csr_array(x)) for x in (k, m))
    analysis = analyze(k, backend="banded")
    found = held_modes(analysis.factorize(k), Pencil(k, m, analysis), wanted, memory_limit=1e9, **options)
    assert found is not None
    np.testing.assert_allclose(found.vectors.T @ m @ found.vectors, np.eye(found.omega2.size), atol=1e-9)
    wrong = np.linalg.norm(k @ found.vectors - m @ found.vectors * found.omega2, axis=0)
    np.testing.assert_allclose(found.residuals * np.linalg.norm(k @ found.vectors, axis=0), wrong, rtol=1e-2, atol=1e-13)
    assert found.residuals.max() < 3e-9
    return found


@pytest.mark.parametrize(("n", "modes"), [(240, 1), (330, 25), (330, 80), (520, 60)])
def test_short_modes_of_random_pencils(n, modes):
    k, m = chain(n, seed=n)
    found = held(k, m, Wanted(modes, None))
    assert found.proved
    np.testing.assert_allclose(found.omega2, la.eigh(k.toarray(), m.toarray(), eigvals_only=True)[:modes], rtol=1e-10)


@pytest.mark.parametrize(("copies", "modes"), [(3, 20), (8, 30), (26, 30)])
def test_clusters_and_repeated_modes_are_all_found(copies, modes):
    """Equal chains, all but one of which differ in the tenth digit: 26 times is more often than any first block is wide."""
    k, m = chain(500 // copies)
    scale = sp.diags_array(1 + 1e-10 * np.repeat(np.arange(copies) % 2, 500 // copies))
    k, m = scale @ sp.block_diag([k] * copies), sp.csr_array(sp.block_diag([m] * copies))
    found = held(k, m, Wanted(modes, None), verify_count=True)
    assert found.proved
    once = la.eigvalsh(*(x.toarray()[: 500 // copies, : 500 // copies] for x in (k, m)))
    np.testing.assert_allclose(found.omega2, np.repeat(once, copies)[:modes], rtol=1e-9)


def test_a_count_below_a_limit_says_how_many_modes_are_wanted():
    k, m = chain(300)
    values = la.eigh(k.toarray(), m.toarray(), eigvals_only=True)
    limit = 0.5 * (values[33] + values[34])
    for n_modes in (None, 50, 34, 10):
        found = held(k, m, Wanted(n_modes, limit, 34))
        np.testing.assert_allclose(found.omega2, values[: min(34, n_modes or 34)], rtol=1e-10)
        assert found.proved
    assert not held(k, m, Wanted(10, None), verify_count=False).proved


def test_a_mass_on_few_rows_has_its_modes_found():
    k, m = chain(400)
    rows = sp.diags_array((np.arange(400) % 3 == 0).astype(float))
    found = held(k, rows @ m @ rows, Wanted(30, None))
    loaded = np.arange(0, 400, 3)
    flexibility = la.inv(k.toarray())[np.ix_(loaded, loaded)]
    theta = la.eigvalsh(la.inv(m.toarray()[np.ix_(loaded, loaded)]), flexibility)
    np.testing.assert_allclose(found.omega2, theta[:30], rtol=1e-9)
