"""Products of sparse matrices and of tall blocks against numpy, for any number of columns, order in memory and kind of matrix."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from flexplant.numerics import products
from flexplant.numerics.blocks import minus, shares
from flexplant.numerics.products import product


@pytest.fixture
def compiled(monkeypatch):
    """Small matrices take the compiled loops too."""
    pytest.importorskip("numba")
    monkeypatch.setattr(products, "LARGE", 1)


def sparse(rows: int = 60, columns: int = 45) -> sp.csr_array:
    matrix = sp.random_array((rows, columns), density=0.15, rng=np.random.default_rng(2), format="csr")
    matrix.data -= 0.5
    return sp.csr_array(sp.vstack([matrix, sp.csr_array((3, columns))]))  # rows without entries


@pytest.mark.parametrize("columns", [1, 4, 7, 8, 9, 16, 17, 24, 60])
@pytest.mark.parametrize("order", ["C", "F"])
def test_products_with_columns(compiled, columns, order):
    matrix, block = sparse(), np.asarray(np.random.default_rng(0).standard_normal((45, columns)), order=order)
    kept = block.copy()
    np.testing.assert_allclose(product(matrix, block), matrix @ block, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(block, kept)
    np.testing.assert_array_equal(product(matrix, block), product(matrix, block))


def test_parts_of_arrays_and_other_kinds_of_matrices(compiled):
    matrix, whole = sparse(), np.random.default_rng(0).standard_normal((45, 40))
    np.testing.assert_allclose(product(matrix, whole[:, 3:21]), matrix @ whole[:, 3:21], rtol=0, atol=1e-14)
    for other in (matrix.tocsc(), matrix.toarray(), matrix.astype(np.float32), matrix * 1j):
        np.testing.assert_allclose(product(other, whole), other @ whole, rtol=0, atol=1e-5)
    np.testing.assert_allclose(product(matrix, whole[:, 0]), matrix @ whole[:, 0], rtol=0, atol=1e-14)
    assert product(matrix, whole[:, :0]).shape == (63, 0)
    assert product(sp.csr_array((45, 45)), whole).shape == (45, 40)


def test_without_the_compiler_the_product_is_the_same(monkeypatch):
    monkeypatch.setattr(products, "LARGE", 1)
    monkeypatch.setattr(products, "compiled_is_there", lambda: False)
    matrix, block = sparse(), np.random.default_rng(0).standard_normal((45, 9))
    np.testing.assert_array_equal(product(matrix, block), matrix @ block)


@pytest.mark.parametrize("n", [9, 1030])
@pytest.mark.parametrize("wide", [1, 8, 16, 21, 24, 40])
@pytest.mark.parametrize("count", [0, 5, 8, 19, 32])
@pytest.mark.parametrize("order", ["C", "F"])
def test_products_of_tall_blocks(compiled, n, wide, count, order):
    rng = np.random.default_rng(n + wide)
    columns = np.asarray(rng.standard_normal((n, count + 3)), order="F")[:, 2 : 2 + count]
    columns = np.asarray(columns, order=order)
    block, share = rng.standard_normal((n, wide)), rng.standard_normal((count, wide))
    kept = block.copy()
    bound = 1e-15 * n
    np.testing.assert_allclose(shares(columns, block), columns.T @ block, rtol=0, atol=10 * bound)
    np.testing.assert_allclose(minus(block, columns, share), block - columns @ share, rtol=0, atol=1e-13)
    np.testing.assert_allclose(shares(columns, np.asfortranarray(block)), columns.T @ block, rtol=0, atol=10 * bound)
    np.testing.assert_array_equal(block, kept)
