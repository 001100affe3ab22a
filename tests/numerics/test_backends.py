"""Every factorisation backend against rslab and dense algebra: solutions, inertia, estimates, reuse, refusals."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from flexplant.errors import InputError, MissingExtraError, SolverError
from flexplant.numerics.factorization import (
    BACKENDS,
    analyze,
    cholmod_backend,
    factorize,
    pardiso_backend,
    rslab_backend,
    supernodal_backend,
)

THERE = {"rslab": rslab_backend.available, "superlu": lambda: True, "banded": lambda: True}
THERE |= {"pardiso": pardiso_backend.available, "cholmod": cholmod_backend.available}
THERE |= {"supernodal": supernodal_backend.available}
WHY = {"rslab": "rslab is not installed", "pardiso": "mkl is not installed", "cholmod": "scikit-sparse is not installed"}


def backends(*names):
    return [pytest.param(n, marks=pytest.mark.skipif(not THERE[n](), reason=WHY.get(n, ""))) for n in names]


ALL = backends("rslab", "superlu", "pardiso", "cholmod", "banded")
COMPLEX = backends("rslab", "superlu", "pardiso")


def grid(n: int = 14) -> tuple[sp.csr_array, sp.csr_array]:
    """Stiffness and mass of a square membrane held at its rim, with uneven entries."""
    line = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    k = sp.csr_array(sp.kron(line, sp.eye_array(n)) + sp.kron(sp.eye_array(n), 1.3 * line))
    m = sp.diags_array(np.random.default_rng(2).uniform(0.5, 1.5, n * n)).tocsr()
    return k, m


@pytest.mark.parametrize("backend", ALL)
def test_solutions_and_inertia_of_shifted_pencils(backend):
    k, m = grid()
    values = la.eigvalsh(k.toarray(), m.toarray())
    rng = np.random.default_rng(1)
    analysis = analyze(k, backend=backend)
    for below in (0, 1, 37):
        shift = 0.0 if not below else 0.5 * (values[below - 1] + values[below])
        matrix = sp.csr_array(k - shift * m)
        factor = analysis.factorize(matrix)
        assert factor.backend == backend
        assert factor.negative_pivots in (below, None) if backend == "superlu" else factor.negative_pivots == below
        for b in (rng.standard_normal(k.shape[0]), rng.standard_normal((k.shape[0], 5))):
            x = factor.solve(b)
            assert x.shape == b.shape
            assert np.linalg.norm(matrix @ x - b) < 1e-10 * np.linalg.norm(b)
            np.testing.assert_allclose(x, la.solve(matrix.toarray(), b), rtol=0, atol=1e-9 * abs(x).max())
        assert factor.solve(np.zeros((k.shape[0], 0))).shape == (k.shape[0], 0)


@pytest.mark.parametrize("backend", backends("pardiso", "cholmod", "banded"))
def test_the_same_as_rslab(backend):
    k, m = grid(20)
    b = np.random.default_rng(5).standard_normal((k.shape[0], 3))
    for shift in (0.0, 0.9):
        ours, other = (factorize(sp.csr_array(k - shift * m), backend=x) for x in ("rslab", backend))
        assert ours.negative_pivots == other.negative_pivots
        np.testing.assert_allclose(ours.solve(b), other.solve(b), rtol=0, atol=1e-9 * abs(ours.solve(b)).max())


@pytest.mark.parametrize("backend", COMPLEX)
def test_complex_symmetric_matrices(backend):
    k, m = grid()
    matrix = sp.csr_array((1 + 0.02j) * k - 0.7 * m)
    b = np.random.default_rng(3).standard_normal((k.shape[0], 4))
    factor = factorize(matrix, backend=backend)
    assert factor.negative_pivots is None
    np.testing.assert_allclose(factor.solve(b), la.solve(matrix.toarray(), b), rtol=0, atol=1e-9)


@pytest.mark.parametrize("backend", ALL)
def test_two_factors_of_one_analysis_live_side_by_side(backend):
    k, m = grid()
    analysis = analyze(k, backend=backend)
    b = np.ones(k.shape[0])
    first = analysis.factorize(k)
    before = first.solve(b)
    second = analysis.factorize(sp.csr_array(k + 3 * m))
    np.testing.assert_array_equal(first.solve(b), before)
    np.testing.assert_allclose((k + 3 * m) @ second.solve(b), b, rtol=1e-9)
    other = grid(9)[0]
    np.testing.assert_allclose(other @ analysis.factorize(other).solve(np.ones(81)), np.ones(81), rtol=1e-9)


@pytest.mark.parametrize("directions", [1, 3])
@pytest.mark.parametrize("backend", ALL)
def test_the_estimate_is_there_before_and_right_after(backend, directions):
    """Within 10 % of the true fill, of a scalar membrane and of one with three coupled DOF a point."""
    one, _ = grid(60 if directions == 1 else 35)
    k = sp.csr_array(sp.kron(one, np.eye(directions) + 0.1))
    analysis = analyze(k, backend=backend)
    estimate = analysis.estimate
    factor = analysis.factorize(k)
    assert estimate.fill == pytest.approx(factor.fill, rel=0.1)
    assert estimate.peak_bytes >= estimate.factor_bytes >= 8 * k.shape[0]
    assert estimate.flops > 0


@pytest.mark.parametrize("backend", ALL)
def test_what_would_not_fit_is_refused_before_any_number_is_computed(backend, monkeypatch):
    k, _ = grid(30)
    analysis = type(analyze(k, backend=backend))
    monkeypatch.setattr(analysis, "factorize", lambda self, matrix: pytest.fail("it started"))
    with pytest.raises(SolverError, match="GB"):
        factorize(k, backend=backend, memory_limit=1e3)


def test_rows_in_other_units_cost_superlu_nothing():
    """Rotations beside translations: without scaling it would pivot, fill twice as much and hide the inertia."""
    k, m = grid(20)
    d = sp.diags_array(10.0 ** np.random.default_rng(4).integers(-6, 7, k.shape[0]))
    shifted = sp.csr_array(k - 0.9 * m)
    even, uneven = (factorize(sp.csr_array(x), backend="superlu") for x in (shifted, d @ shifted @ d))
    assert uneven.fill == even.fill
    assert uneven.negative_pivots == even.negative_pivots > 0
    b = np.ones(k.shape[0])
    np.testing.assert_allclose(d @ uneven.solve(d @ b), even.solve(b), rtol=1e-6)


@pytest.mark.parametrize("backend", ALL)
def test_a_singular_matrix_is_refused_or_blows_up(backend):
    """Some pivots vanish exactly, some as round-off: then the solution shows it, as the callers check."""
    k = sp.csr_array(np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 2.0]]))
    with pytest.raises(SolverError, match="singular"):
        factorize(k, backend=backend).solve(np.ones(3))


@pytest.mark.parametrize("backend", backends("pardiso", "cholmod", "banded"))
def test_a_stored_zero_diagonal_is_no_obstacle_to_an_indefinite_matrix(backend):
    matrix = sp.csr_array(np.array([[2.0, 0.0, 1.0], [0.0, -3.0, 0.0], [1.0, 0.0, 0.0]]))
    factor = factorize(matrix, backend=backend)
    assert factor.negative_pivots == 2
    np.testing.assert_allclose(matrix @ factor.solve(np.ones(3)), 1.0, rtol=1e-12)


def test_what_is_missing_or_unknown(monkeypatch):
    k, _ = grid(4)
    with pytest.raises(InputError, match="pardiso"):
        analyze(k, backend="pardizo")
    with pytest.raises(InputError, match="unknown factorization backend 3"):
        analyze(k, backend=3)
    monkeypatch.setattr(pardiso_backend, "available", lambda: False)
    with pytest.raises(MissingExtraError, match=r"flexplant\[mkl\]"):
        analyze(k, backend="pardiso")
    monkeypatch.setitem(sys.modules, "sksparse", None)
    with pytest.raises(MissingExtraError, match=r"flexplant\[cholmod\]"):
        analyze(k, backend="cholmod")
    assert set(BACKENDS) == set(THERE)


@pytest.mark.parametrize("backend", backends("cholmod", "banded"))
def test_real_backends_refuse_complex_matrices(backend):
    with pytest.raises(InputError, match=r"complex(-symmetric)?"):
        analyze(1j * grid(4)[0], backend=backend)


@pytest.mark.parametrize("backend", ALL)
def test_a_reduction_by_any_backend_is_the_same(backend):
    import flexplant as fp

    k, m = grid(12)
    model = fp.FiniteElementModel(name="net", stiffness=k, mass=m, dofs=[(i + 1, 3) for i in range(144)])
    boundary = [(1, 3), (12, 3), (140, 3)]
    ours, other = (fp.craig_bampton(model, boundary, max_frequency_hz=0.3, backend=x) for x in (None, backend))
    assert other.report.proved or backend == "superlu"
    np.testing.assert_allclose(other.fixed_interface_hz, ours.fixed_interface_hz, rtol=1e-10)
    np.testing.assert_allclose(other.stiffness, ours.stiffness, atol=1e-10)
