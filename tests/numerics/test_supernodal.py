"""The supernodal Cholesky factorisation: order, structure and solutions against dense algebra, and what it leaves to others."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

pytest.importorskip("numba")

import flexplant.numerics.factorization as factorization
from flexplant.numerics.factorization import analyze, factorize, supernodal_backend
from flexplant.numerics.factorization.dissection import bisected, dissected
from flexplant.numerics.factorization.multifrontal import cholesky, layout
from flexplant.numerics.factorization.separators import LARGER_SIDE, SEPARATOR
from flexplant.numerics.factorization.supernodes import alike, supernodes
from flexplant.numerics.sturm import count_below


def grid_graph(*shape: int) -> sp.csr_array:
    """Points of a box, each joined to all that touch it, without loops."""
    line = [sp.diags_array([1.0, 1.0, 1.0], offsets=[-1, 0, 1], shape=(n, n)) for n in shape]
    whole = line[0]
    for other in line[1:]:
        whole = sp.kron(whole, other)
    whole = sp.csr_array(whole - sp.eye_array(whole.shape[0]))
    whole.eliminate_zeros()
    whole.sort_indices()
    return whole


def definite(pattern: sp.csr_array, width: int = 1, seed: int = 0) -> sp.csr_array:
    """A symmetric, diagonally dominant matrix with full blocks of `width` rows where the pattern has an entry."""
    full = sp.csr_array(sp.kron(pattern + sp.eye_array(pattern.shape[0]), np.ones((width, width))))
    values = np.random.default_rng(seed).uniform(-1, 1, full.nnz)
    half = sp.csr_array((values, full.indices, full.indptr), shape=full.shape)
    matrix = half + half.T
    return sp.csr_array(matrix + sp.diags_array(np.asarray(abs(matrix).sum(axis=0)) + 1.0))


def random_graph(n: int, edges: int, seed: int = 3) -> sp.csr_array:
    rng = np.random.default_rng(seed)
    a, b = rng.integers(n, size=(2, edges))
    both = sp.csr_array((np.ones(2 * edges), (np.r_[a, b], np.r_[b, a])), shape=(n, n))
    both.setdiag(0)
    both.eliminate_zeros()
    both.data[:] = 1.0
    return both


def star(n: int) -> sp.csr_array:
    """One point joined to all others, as the node of a rigid element."""
    others = np.arange(1, n)
    return sp.csr_array((np.ones(2 * n - 2), (np.r_[0 * others, others], np.r_[others, 0 * others])), shape=(n, n))


GRAPHS = {
    "one": sp.csr_array((1, 1)),
    "none joined": sp.csr_array((7, 7)),
    "line": grid_graph(300),
    "plane": grid_graph(23, 17),
    "box": grid_graph(9, 8, 7),
    "random": random_graph(400, 900),
    "dense": sp.csr_array(np.ones((40, 40)) - np.eye(40)),
    "star": star(500),
    "parts": sp.csr_array(sp.block_diag([grid_graph(12, 12), grid_graph(200), sp.csr_array((5, 5)), grid_graph(5, 5, 5)])),
}


@pytest.mark.parametrize("width", [1, 3, 6])
@pytest.mark.parametrize("name", GRAPHS)
def test_solutions_of_any_number_of_columns(name, width):
    matrix = definite(GRAPHS[name], width)
    factor = factorize(matrix, backend="supernodal")
    assert factor.backend == "supernodal"
    assert factor.negative_pivots == 0
    rng = np.random.default_rng(1)
    for shape in ((), (1,), (3,), (8,), (16,), (21,), (24,), (41,)):
        b = rng.standard_normal((matrix.shape[0], *shape))
        if shape and shape[0] > 16:
            b[rng.random(matrix.shape[0]) < 0.98] = 0.0  # most supernodes have no force
        x = factor.solve(b)
        assert x.shape == b.shape
        assert np.linalg.norm(matrix @ x - b) <= 1e-13 * np.linalg.norm(b)


@pytest.mark.parametrize("name", GRAPHS)
def test_every_entry_of_the_factor_has_a_place(name):
    """Dense Cholesky in the same order, without lucky zeros: nothing outside the supernodes, the same values inside."""
    matrix = definite(GRAPHS[name], 2)
    nodes = supernodes(matrix)
    assert sorted(nodes.order.tolist()) == list(range(matrix.shape[0]))
    exact = np.linalg.cholesky(matrix.toarray()[np.ix_(nodes.order, nodes.order)])
    place = np.zeros(exact.shape, dtype=bool)
    for s in range(nodes.columns.size):
        first, last = nodes.first[s : s + 2]
        place[first:last, first:last] = np.tri(last - first)
        place[np.ix_(nodes.rows[nodes.start[s] : nodes.start[s + 1]], np.arange(first, last))] = True
    assert not exact[~place].any()
    assert place.sum() == nodes.fill
    assert nodes.fill < 2 * np.count_nonzero(abs(exact) > 0) + 100
    panels = cholesky(nodes, matrix)
    at, start, rows = layout(nodes)
    for s in range(nodes.columns.size):
        c, below = nodes.columns[s], nodes.rows[nodes.start[s] : nodes.start[s + 1]]
        strips = panels.values[at[s + 1] - c * (start[s + 1] - start[s]) : at[s + 1]].reshape(-1, c, 8)
        right = strips.swapaxes(1, 2).reshape(-1, c)
        np.testing.assert_allclose(-right[: below.size], exact[below, nodes.first[s] : nodes.first[s + 1]], atol=1e-12)
        assert not right[below.size :].any()
        assert (rows[start[s] + below.size : start[s + 1]] == matrix.shape[0]).all()


@pytest.mark.parametrize("name", ["box", "parts"])
def test_updates_wait_on_two_stacks_without_overlap(name):
    """One by one in the order of a factorisation: a front's own place is free while its children's are still read."""
    nodes = supernodes(definite(GRAPHS[name], 3))
    at, heights = nodes.stacked
    size, live, most = (-(-nodes.below // 8) * 8) ** 2, [{}, {}], [0, 0]
    for s, children in enumerate(nodes.families):
        own = live[nodes.depth[s] % 2]
        assert at[s] == sum(own.values())
        own[s] = size[s]
        most[nodes.depth[s] % 2] = max(most[nodes.depth[s] % 2], at[s] + size[s])
        for child in children:
            del live[1 - nodes.depth[s] % 2][child]
    assert not any(sum(stack.values()) for stack in live)
    assert tuple(most) == heights
    assert nodes.waiting >= sum(heights) + max(nodes.columns) ** 2


def test_flops_and_fill_of_a_dense_matrix():
    nodes = supernodes(definite(GRAPHS["dense"]))
    assert nodes.fill == 40 * 41 // 2
    assert nodes.flops == pytest.approx(40**3 / 3)


@pytest.mark.parametrize("shape", [(25, 21, 19), (40, 30), (12, 11, 10)])
def test_a_separator_of_a_box_is_the_plane_across(shape):
    """No edge joins the sides, neither side is too heavy, and few or no points more than the smallest plane has."""
    graph = grid_graph(*shape)
    n, plane = graph.shape[0], int(np.prod(sorted(shape)[:-1]))
    whole = (graph.indptr.astype(np.int64), graph.indices.astype(np.int64), np.ones(graph.nnz), np.ones(n))
    for seed in range(3):
        part = bisected(whole, np.random.default_rng(seed))
        source = np.repeat(part, np.diff(graph.indptr))
        assert not ((source == 0) & (part[graph.indices] == 1)).any()
        assert max((part == 0).sum(), (part == 1).sum()) <= LARGER_SIDE * n
        assert (part == SEPARATOR).sum() <= 1.15 * plane


@pytest.mark.parametrize(
    ("pattern", "most"), [(grid_graph(15, 14, 13), 1.1), (grid_graph(60, 50), 1.25), (grid_graph(2000), 2.5)]
)
def test_fill_is_that_of_good_orderings(pattern, most):
    """Counted with the zeros that wide supernodes store, the other without."""
    matrix = definite(pattern, 3)
    assert analyze(matrix, backend="supernodal").estimate.fill <= most * analyze(matrix, backend="rslab").estimate.fill


def test_a_random_start_does_not_change_from_run_to_run():
    matrix = definite(GRAPHS["box"], 3)
    b = np.random.default_rng(0).standard_normal((matrix.shape[0], 5))
    one, two = (factorize(matrix, backend="supernodal").solve(b) for _ in range(2))
    np.testing.assert_array_equal(one, two)
    graph = GRAPHS["plane"]
    orders = [dissected(graph.indptr.astype(np.int64), graph.indices.astype(np.int64), np.ones(graph.shape[0])) for _ in range(2)]
    np.testing.assert_array_equal(*orders)


def test_rows_of_one_pattern_are_grouped():
    matrix = definite(grid_graph(6, 5), 3)
    group, members = alike(matrix)
    assert members.size == 30
    for rows in (np.flatnonzero(group == g) for g in range(30)):
        assert rows.size == 3
        assert len({tuple(matrix.indices[matrix.indptr[r] : matrix.indptr[r + 1]]) for r in rows}) == 1


def test_indefinite_matrices_go_to_a_backend_that_pivots_and_are_counted():
    matrix = definite(GRAPHS["plane"], 2)
    mass = sp.csr_array(sp.eye_array(matrix.shape[0]))
    values = np.linalg.eigvalsh(matrix.toarray())
    analysis = analyze(matrix, backend="supernodal")
    for below in (0, 1, 50):
        shift = 0.5 * (values[below - 1] + values[below]) if below else 0.5 * values[0]
        shifted = sp.csr_array(matrix - shift * mass)
        factor = analysis.factorize(shifted)
        assert (factor.backend == "supernodal") == (below == 0)
        assert factor.negative_pivots == below
        assert count_below(matrix, mass, shift, analysis) == below
        b = np.ones(matrix.shape[0])
        np.testing.assert_allclose(shifted @ factor.solve(b), b, atol=1e-9)


def test_other_patterns_values_and_shapes_of_matrices():
    matrix = definite(GRAPHS["plane"])
    analysis, b = analyze(matrix, backend="supernodal"), np.ones(matrix.shape[0])
    for other in (definite(GRAPHS["random"])[: b.size][:, : b.size], sp.eye_array(b.size, format="csr"), matrix * (1 + 0.1j)):
        factor = analysis.factorize(other)
        assert factor.backend != "supernodal"
        np.testing.assert_allclose(other @ factor.solve(b), b, atol=1e-10)
    unsorted = matrix.copy()
    for row in range(b.size):
        part = slice(*unsorted.indptr[row : row + 2])
        unsorted.indices[part], unsorted.data[part] = unsorted.indices[part][::-1].copy(), unsorted.data[part][::-1].copy()
    unsorted.has_sorted_indices = False
    factor = analysis.factorize(unsorted)
    assert factor.backend == "supernodal"
    np.testing.assert_allclose(matrix @ factor.solve(b), b, atol=1e-12)
    assert factor.solve(np.zeros((b.size, 0))).shape == (b.size, 0)
    scaled = analysis.factorize(sp.csr_array(1e-9 * matrix))
    np.testing.assert_allclose(matrix @ scaled.solve(b) * 1e-9, b, atol=1e-12)


def test_a_row_without_diagonal_is_left_to_others():
    matrix = sp.csr_array(np.array([[0.0, 2.0, 0.0], [2.0, 1.0, 1.0], [0.0, 1.0, 5.0]]))
    factor = factorize(matrix, backend="supernodal")
    assert factor.backend != "supernodal"
    np.testing.assert_allclose(matrix @ factor.solve(np.ones(3)), 1.0)


def test_a_pattern_that_is_not_symmetric_is_not_factored_wrongly():
    """Entries without a place in their front are found before anything is written there."""
    matrix = definite(GRAPHS["plane"])
    nodes = supernodes(sp.csr_array(sp.eye_array(matrix.shape[0])))
    assert cholesky(nodes, matrix) is None


def test_large_definite_matrices_take_it_by_default(monkeypatch):
    matrix = definite(GRAPHS["plane"])
    assert factorize(matrix).backend == "rslab"
    monkeypatch.setattr(factorization, "LARGE", 100)
    assert analyze(matrix, definite=True).factorize(matrix).backend == "supernodal"
    assert analyze(matrix, definite=True, threads=2).factorize(matrix).backend == "rslab"
    assert analyze(matrix).factorize(matrix).backend == "rslab"
    monkeypatch.setattr(supernodal_backend, "available", lambda: False)
    assert analyze(matrix, definite=True).factorize(matrix).backend == "rslab"
