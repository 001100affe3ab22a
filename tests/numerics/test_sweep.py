"""Factoring a sweep of one pattern: both backends against dense LAPACK, entries of K and M at different places."""

import numpy as np
import pytest
import scipy.sparse as sp

from flexplant.errors import SolverError
from flexplant.numerics.factorization import rslab_backend
from flexplant.numerics.sweep import PencilSweep

N = 40


def pencil() -> tuple[sp.csr_array, sp.csr_array]:
    """A stiffness with a gap in its diagonal, and a mass whose pattern is not contained in it."""
    rng = np.random.default_rng(3)
    k = sp.random_array((N, N), density=0.08, rng=rng)
    k = k + k.T + sp.diags_array(np.where(np.arange(N) == 5, 0.0, 4.0))
    m = sp.diags_array(np.r_[np.zeros(3), np.ones(N - 3)]).tolil()
    m[0, N - 1] = m[N - 1, 0] = 0.3
    return sp.csr_array(k), sp.csr_array(m)


@pytest.mark.parametrize("backend", ["rslab", "superlu"])
@pytest.mark.parametrize("omega", [0.3, 1.7, 9.0])
def test_solutions_are_those_of_the_dense_matrix(monkeypatch, backend, omega):
    monkeypatch.setattr(rslab_backend, "available", lambda: backend == "rslab")
    k, m = pencil()
    a, b = 1 + 0.02j, -(omega**2)
    right = np.random.default_rng(4).normal(size=(N, 2)) + 0j
    factor = PencilSweep(k, m).factor(a, b)
    assert factor.backend == backend
    expected = np.linalg.solve(a * k.toarray() + b * m.toarray(), right)
    np.testing.assert_allclose(factor.solve(right), expected, rtol=1e-9, atol=1e-11 * abs(expected).max())


def test_a_singular_matrix_is_an_error():
    zero = sp.csr_array(np.diag(np.r_[0.0, np.ones(4)]))
    with pytest.raises(SolverError, match="singular"):
        PencilSweep(zero, zero).factor(1.0, 0.0)
