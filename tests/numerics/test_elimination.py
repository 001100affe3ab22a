"""Sparse elimination: an exact null space, ranks by scale, sparsity, names of the rows that are redundant."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from flexplant.numerics.elimination import eliminate
from flexplant.numerics.rank import jacobi_scale, split_semidefinite


def random_rows(seed, m, n, repeated):
    rng = np.random.default_rng(seed)
    b = rng.normal(size=(m, n)) * (rng.uniform(size=(m, n)) < 0.5)
    b[abs(b).max(axis=1) == 0, 0] = 1.0
    mixed = rng.normal(size=(repeated, m)) @ b
    order = rng.permutation(m + repeated)
    return np.vstack([b, mixed])[order]


@given(st.integers(0, 10**6), st.integers(1, 7), st.integers(0, 4))
@settings(max_examples=60)
def test_the_basis_spans_the_null_space(seed, m, repeated):
    n = 12
    b = random_rows(seed, m, n, repeated)
    found = eliminate(sp.csr_array(b))
    rank = np.linalg.matrix_rank(b)
    assert found.independent.size == rank
    assert found.redundant.size == b.shape[0] - rank
    basis = found.basis.toarray()
    assert basis.shape == (n, n - rank)
    scale = abs(b).max() * abs(basis).max()
    assert abs(b @ basis).max() < 1e-11 * scale
    np.testing.assert_array_equal(basis[found.kept], np.eye(n - rank))
    assert sorted([*found.kept, *found.eliminated]) == list(range(n))
    assert la.subspace_angles(basis, la.null_space(b)).max() < 1e-7


@given(st.integers(0, 10**6))
@settings(max_examples=30)
def test_boolean_rows_eliminate_exactly(seed):
    rng = np.random.default_rng(seed)
    n, m = 20, 14
    b = np.zeros((m, n))
    for i in range(m):
        j, k = rng.choice(n, 2, replace=False)
        b[i, [j, k]] = 1.0, -1.0
    found = eliminate(sp.csr_array(b))
    assert set(found.basis.data.tolist()) <= {1.0}
    assert abs(b @ found.basis).max() == 0.0
    assert found.independent.size == np.linalg.matrix_rank(b)
    assert not found.locked


def test_a_ground_row_locks_and_what_follows_is_redundant():
    b = sp.csr_array(np.array([[1.0, -1, 0], [0, 1, -1], [1, 0, 0], [0, 0, 2.0]]))
    found = eliminate(b)
    assert found.independent.tolist() == [0, 1, 2]
    assert found.redundant.tolist() == [3]
    assert list(found.locked) == [2]
    assert found.basis.shape == (3, 0)


def test_no_rows_and_no_columns():
    assert eliminate(sp.csr_array((0, 4))).basis.toarray().tolist() == np.eye(4).tolist()
    assert eliminate(sp.csr_array((0, 0))).basis.shape == (0, 0)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_rank_does_not_depend_on_units(scale):
    rng = np.random.default_rng(0)
    b = rng.normal(size=(3, 6))
    rows = np.vstack([b, b[0] * 0.3 + b[1] * 7]) * np.array([1.0, scale, 1 / scale, scale])[:, None]
    assert eliminate(sp.csr_array(rows)).redundant.tolist() == [3]


def test_a_long_chain_stays_sparse():
    n = 3000
    b = sp.diags_array([np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1], shape=(n - 1, n)).tocsr()
    found = eliminate(b[np.random.default_rng(1).permutation(n - 1)])
    assert found.basis.nnz == n
    assert found.basis.shape == (n, 1)


@given(st.integers(0, 10**6), st.integers(0, 4), st.integers(1, 5))
@settings(max_examples=40)
def test_split_finds_the_null_space_in_any_units(seed, nullity, rank):
    rng = np.random.default_rng(seed)
    n = nullity + rank
    factor = rng.normal(size=(n, rank))
    units = 10.0 ** rng.uniform(-4, 4, n)
    a = units[:, None] * (factor @ factor.T) * units
    split = split_semidefinite(0.5 * (a + a.T))
    assert split.null.shape == (n, nullity)
    assert split.span.shape == (n, rank)
    scaled = split.null / np.maximum(np.linalg.norm(split.null, axis=0), 1e-300)
    assert abs(a @ scaled).max(initial=0.0) < 1e-9 * abs(a).max()
    assert np.linalg.matrix_rank(np.hstack([split.span, split.null]) * units[:, None]) == n


def test_split_of_zero_negative_and_empty_matrices():
    assert split_semidefinite(np.zeros((3, 3))).null.shape == (3, 3)
    assert split_semidefinite(np.zeros((0, 0))).null.shape == (0, 0)
    bent = split_semidefinite(np.diag([1.0, -2.0, 0.0]))
    assert bent.lowest == pytest.approx(-1.0)
    np.testing.assert_array_equal(abs(bent.null), [[0], [0], [1]])
    np.testing.assert_allclose(jacobi_scale(np.diag([4.0, 0.0, 1e-40])), [0.5, 0.0, 0.0])
