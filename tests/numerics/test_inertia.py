"""Signs of eigenvalues without pivoting between fronts: against dense eigenvalues, or left to a backend that pivots."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

pytest.importorskip("numba")

from flexplant.numerics.factorization import analyze
from flexplant.numerics.factorization.inertia import BLOCK, signed_cholesky
from flexplant.numerics.sturm import count_below


def grid(*shape: int, width: int) -> sp.csr_array:
    """Stiffness of a clamped box of points joined by random springs of `width` directions."""
    n, rng = int(np.prod(shape)), np.random.default_rng(0)
    points = np.arange(n).reshape(shape)
    k = sp.lil_array((n * width, n * width))
    for axis in range(len(shape)):
        pairs = zip(
            points.take(range(shape[axis] - 1), axis).ravel(), points.take(range(1, shape[axis]), axis).ravel(), strict=True
        )
        for a, b in pairs:
            root = rng.standard_normal((width, width))
            spring = root @ root.T + 0.1 * np.eye(width)
            rows = [slice(width * p, width * p + width) for p in (a, b)]
            for one, other, sign in ((0, 0, 1), (1, 1, 1), (0, 1, -1), (1, 0, -1)):
                k[rows[one], rows[other]] += sign * spring
    return sp.csr_array(k + 0.02 * sp.eye_array(n * width))


STIFFNESS = {"plane": grid(9, 8, width=2), "box": grid(4, 4, 5, width=3), "line": grid(60, width=2)}
STIFFNESS["twins"] = sp.csr_array(sp.kron(np.eye(3), grid(6, 5, width=2)))  # every mode three times


def mass(n: int, massless: bool) -> sp.csr_array:
    values = np.random.default_rng(1).uniform(0.5, 2.0, n // 3)
    whole = np.tile(values, 3)[:n]
    if massless:
        whole[::5] = 0.0
    return sp.csr_array(sp.diags_array(whole))


@pytest.mark.parametrize("massless", [False, True])
@pytest.mark.parametrize("name", STIFFNESS)
def test_counts_of_shifted_pencils(name, massless):
    """In the lower half of the spectrum and down to 1e-9 beside an eigenvalue: right, or none is given, which is not often."""
    k = STIFFNESS[name]
    m, rng = mass(k.shape[0], massless), np.random.default_rng(2)
    theta = la.eigvalsh(m.toarray(), k.toarray())
    omega2 = np.sort(1 / theta[theta > 1e-12])
    analysis, none = analyze(k, backend="supernodal"), 0
    shifts = [*rng.uniform(0.0, omega2[omega2.size // 2], 12)]
    shifts += [omega2[i] * (1 + side * 10.0 ** -rng.uniform(3, 9)) for i in rng.integers(0, 60, 8) for side in (-1, 1)]
    for shift in shifts:
        count = analysis.negative_eigenvalues(sp.csr_array(k - shift * m))
        none += count is None
        assert count in (None, np.count_nonzero(omega2 < shift))
    assert none <= 0.3 * len(shifts)


def test_a_limit_on_a_mode_is_not_decided_by_round_off():
    k = STIFFNESS["box"]
    exact = la.eigvalsh(k.toarray())
    analysis, eye = analyze(k, backend="supernodal"), sp.csr_array(sp.eye_array(k.shape[0]))
    for i in (0, 3, 50):
        assert analysis.negative_eigenvalues(sp.csr_array(k - exact[i] * eye)) is None
        assert count_below(k, eye, exact[i], analysis) in (i, i + 1)


def test_small_pivots_are_left_to_a_backend_that_pivots():
    """A diagonal of nearly nothing: every pivot of a front makes the rows below grow."""
    k = STIFFNESS["plane"]
    tiny = sp.csr_array(k - sp.diags_array(k.diagonal()) + 1e-9 * sp.diags_array(k.diagonal()))
    analysis, none = analyze(k, backend="supernodal"), sp.csr_array(k.shape)
    assert analysis.negative_eigenvalues(tiny) is None
    assert count_below(tiny, none, 0.0, analysis) == np.count_nonzero(la.eigvalsh(tiny.toarray()) < 0)
    assert analysis.negative_eigenvalues(sp.csr_array(k * np.inf)) is None
    assert analysis.negative_eigenvalues(sp.csr_array(k * 1j)) is None
    assert analysis.negative_eigenvalues(sp.csr_array(np.ones((5, 5)))) is None


def test_a_count_needs_no_second_ordering():
    k = STIFFNESS["box"]
    analysis, eye = analyze(k, backend="supernodal"), sp.csr_array(sp.eye_array(k.shape[0]))
    values = la.eigvalsh(k.toarray())
    assert count_below(k, eye, 0.5 * (values[8] + values[9]), analysis) == 9
    assert "pivoting" not in vars(analysis)


@pytest.mark.parametrize("n", [1, 5, BLOCK, BLOCK + 1, 4 * BLOCK + 90])
def test_signed_factors_of_dense_matrices(n):
    a = np.random.default_rng(n).standard_normal((n, n))
    a = np.asfortranarray(a + a.T)
    given = a.copy()
    signs, turn = signed_cholesky(a)
    lower = np.tril(a)
    assert (np.diagonal(lower) > 0).all()
    error = abs((lower * signs) @ lower.T - given[np.ix_(turn, turn)]).max()
    assert error < 1e-14 * n * (lower**2).sum(axis=1).max()
    assert np.count_nonzero(signs < 0) == np.count_nonzero(la.eigvalsh(given) < 0)
    assert signed_cholesky(np.zeros((3, 3), order="F")) is None
