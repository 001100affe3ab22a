"""Entries of L counted from the pattern, against elimination carried out on the pattern, and against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from flexplant.numerics.factorization import column_counts as module
from flexplant.numerics.factorization.column_counts import cholesky_estimate, column_counts, relaxed_entries, tree_and_counts


def eliminated(matrix: np.ndarray) -> np.ndarray:
    """Counts by doing it: a column's neighbours become neighbours of each other."""
    filled = (matrix != 0).copy()
    for j in range(len(filled)):
        rows = j + 1 + np.flatnonzero(filled[j + 1 :, j])
        filled[np.ix_(rows, rows)] = True
    return np.tril(filled).sum(axis=0)


def random_pattern(n: int, density: float, seed: int) -> sp.csr_array:
    half = sp.random_array((n, n), density=density, rng=np.random.default_rng(seed))
    return sp.csr_array(half + half.T + sp.eye_array(n))


@pytest.fixture(params=["as installed", "without numba"])
def _kernels(request, monkeypatch):
    if request.param == "without numba":
        for name in ("TREE", "POSTORDER", "COUNTS"):
            monkeypatch.setattr(module, name, getattr(module, name).fallback)


@pytest.mark.usefixtures("_kernels")
@pytest.mark.parametrize("n", [1, 2, 17, 60])
@pytest.mark.parametrize("density", [0.0, 0.02, 0.1, 0.5])
def test_counts_are_those_of_elimination(n, density):
    for seed in range(3):
        matrix = random_pattern(n, density, seed)
        order = np.random.default_rng(seed + 10).permutation(n)
        np.testing.assert_array_equal(column_counts(matrix, order), eliminated(matrix.toarray()[np.ix_(order, order)]))


def test_closed_forms():
    """A band fills its band; an arrow fills nothing or everything, by its order; a forest of blocks stays apart."""
    n, half = 40, 3
    band = sp.csr_array(sp.diags_array([np.ones(n - abs(k)) for k in range(-half, half + 1)], offsets=range(-half, half + 1)))
    np.testing.assert_array_equal(column_counts(band, np.arange(n)), np.minimum(half + 1, n - np.arange(n)))
    arrow = sp.lil_array((n, n))
    arrow.setdiag(1.0)
    arrow[0, :] = arrow[:, 0] = 1.0
    np.testing.assert_array_equal(column_counts(sp.csr_array(arrow), np.arange(n)), n - np.arange(n))
    assert column_counts(sp.csr_array(arrow), np.arange(n)[::-1]).sum() == 2 * n - 1
    blocks = sp.csr_array(sp.block_diag([np.ones((4, 4))] * 5))
    np.testing.assert_array_equal(column_counts(blocks, np.arange(20)), np.tile([4, 3, 2, 1], 5))


def test_a_missing_diagonal_counts_all_the_same():
    matrix = random_pattern(30, 0.1, 5)
    matrix.setdiag(0.0)
    matrix.eliminate_zeros()
    filled = matrix.toarray() + np.eye(30)
    np.testing.assert_array_equal(column_counts(matrix, np.arange(30)), eliminated(filled))


def test_the_estimate_of_a_dense_matrix_is_the_known_one():
    n = 30
    counts = column_counts(sp.csr_array(np.ones((n, n))), np.arange(n))
    estimate = cholesky_estimate(counts, counts.sum(), 8)
    assert estimate.fill == n * (n + 1) // 2
    assert estimate.flops == n * (n + 1) * (2 * n + 1) / 6  # sum of squares: n^3 / 3 and less
    assert estimate.peak_bytes == estimate.factor_bytes + 8 * n * n


def test_merged_supernodes():
    """Nothing is merged into a full matrix, zeros are counted where two unlike columns are, and no rule merges nothing."""
    full = tree_and_counts(sp.csr_array(np.ones((9, 9))), np.arange(9))
    always, never = ((10**15, np.inf),), ()
    assert relaxed_entries(*full, never) == relaxed_entries(*full, always) == 45
    tree = sp.lil_array((7, 7))
    tree.setdiag(1.0)
    for i, j in ((2, 0), (2, 1), (5, 3), (5, 4), (6, 2), (6, 5)):
        tree[i, j] = tree[j, i] = 1.0
    binary = tree_and_counts(sp.csr_array(tree), np.arange(7))
    assert relaxed_entries(*binary, never) == binary[1].sum() == 13
    # 5 joins 6 without a zero, and 1 joins 2 with one: (6, 1)
    assert relaxed_entries(*binary, ((2, np.inf),)) == 13 + 1
    # 4 joins 5 and 6 with (6, 4), and 0 joins 1 and 2 with (1, 0) and (6, 0)
    assert relaxed_entries(*binary, ((3, np.inf),)) == 13 + 1 + 1 + 2


@pytest.mark.parametrize("n", [30, 80])
def test_merging_all_chains_leaves_a_full_lower_triangle(n):
    band = sp.csr_array(sp.diags_array([np.ones(n), np.ones(n - 1), np.ones(n - 1)], offsets=[0, 1, -1]))
    found = tree_and_counts(band, np.arange(n))
    assert relaxed_entries(*found, ()) == 2 * n - 1
    assert relaxed_entries(*found, ((10**15, np.inf),)) == n * (n + 1) // 2
