"""Symbolic Cholesky factorisation: elimination tree, supernodes and their rows, on the graph of rows with equal patterns.

Imported only where numba is installed. Sources: Liu, SIAM J. Matrix Anal. Appl. 11 (1990); Davis, Direct Methods (2006).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.model.arrays import IntArray
from flexplant.numerics.compiled import compiled
from flexplant.numerics.factorization.dissection import dissected
from flexplant.numerics.factorization.panel_lanes import STRIP

SEED = 20190811
# A supernode joins its parent while it is narrow, or while the zeros stored because of that stay few.
NARROW, MIDDLE, WIDE = 8, 48, 128
FEW_ZEROS, FEWER_ZEROS, FEWEST_ZEROS = 0.3, 0.1, 0.03


@dataclass(frozen=True, eq=False)
class Supernodes:
    """Columns first[s] to first[s + 1] of the permuted matrix share the rows[start[s] : start[s + 1]] below them.

    order (n,): row of the given matrix that comes at each place. parent: -1 for a root.
    """

    order: IntArray
    first: IntArray
    start: IntArray
    rows: IntArray
    parent: IntArray

    @property
    def columns(self) -> IntArray:
        """How many each has."""
        return np.diff(self.first)

    @property
    def below(self) -> IntArray:
        """How many rows each has below."""
        return np.diff(self.start)

    @property
    def fill(self) -> int:
        """Entries of the factor."""
        c, r = self.columns, self.below
        return int((c * (c + 1) // 2 + c * r).sum())

    @property
    def flops(self) -> float:
        """Of a factorisation."""
        c, r = self.columns.astype(float), self.below.astype(float)
        return float((c**3 / 3 + c**2 * r + c * r**2).sum())

    @cached_property
    def families(self) -> list[list[int]]:
        """The children of each."""
        found: list[list[int]] = [[] for _ in range(self.parent.size)]
        for s, parent in enumerate(self.parent.tolist()):
            if parent >= 0:
                found[parent].append(s)
        return found

    @cached_property
    def depth(self) -> IntArray:
        """Supernodes above each."""
        depth = np.zeros(self.parent.size, dtype=np.int64)
        for s in range(self.parent.size - 2, -1, -1):
            depth[s] = depth[self.parent[s]] + 1 if self.parent[s] >= 0 else 0
        return depth

    @cached_property
    def stacked(self) -> tuple[IntArray, tuple[int, int]]:
        """Where the update of each goes on one of two stacks, of even and odd depth, and how high the stacks grow.

        Children, on the other stack, are taken off when their parent's update is complete. Updates are squares in eights.
        """
        update, inner, at, most = in_strips(self.below) ** 2, self.parent >= 0, np.zeros_like(self.parent), [0, 0]
        for odd in range(2):
            mine = np.where(self.depth % 2 == odd, update, 0)
            taken = np.zeros_like(mine)
            np.add.at(taken, self.parent[inner], mine[inner])
            before = np.r_[0, np.cumsum(mine - taken)[:-1]]
            at, most[odd] = np.where(self.depth % 2 == odd, before, at), int((before + mine).max(initial=0))
        return at, (most[0], most[1])

    @property
    def waiting(self) -> int:
        """The most values of fronts and updates that a factorisation holds at once."""
        c = self.columns
        return int(np.max(c**2) + np.max(c * in_strips(self.below))) + sum(self.stacked[1])


def in_strips(rows: IntArray) -> IntArray:
    """Rows filled up to a multiple of eight."""
    return np.asarray(-(-rows // STRIP) * STRIP)


def supernodes(matrix: Any) -> Supernodes:
    """Order and analyse a sparse symmetric matrix in CSR form, sorted, with its diagonal stored."""
    group, members = alike(matrix)
    xadj, adj = quotient(matrix, group, members)
    weights = np.bincount(group)
    place = dissected(xadj, adj, weights.astype(float))
    for _ in range(2):  # children before parents; then, as their columns are known, the tallest child last
        graph = renumbered(xadj, adj, place)
        parent = tree(*graph)
        place = place[postorder(parent, heights(*graph, parent, weights[place]))]
    graph, weights = renumbered(xadj, adj, place), weights[place]
    parent = tree(*graph)
    first = amalgamated(parent, heights(*graph, parent, weights), weights)
    return _expanded(group, place, weights, first, structure(first, *graph))


def alike(matrix: Any) -> tuple[IntArray, IntArray]:
    """(n,) group of each row, rows of one pattern together, and one row of each group. Two hashes of 64 bits tell patterns."""
    keys = np.random.default_rng(SEED).integers(2**63, size=(2, matrix.shape[0]), dtype=np.uint64)
    one, other = (np.add.reduceat(key[matrix.indices], matrix.indptr[:-1]) for key in keys)
    _, members, group = np.unique(one, return_index=True, return_inverse=True)
    if (other[members][group] != other).any():  # patterns that share a hash: nothing is grouped then
        members = group = np.arange(matrix.shape[0])
    return group, members


def quotient(matrix: Any, group: IntArray, members: IntArray) -> tuple[IntArray, IntArray]:
    """The graph of groups without loops."""
    size = np.diff(matrix.indptr)[members].astype(np.int64)
    begin = np.r_[0, np.cumsum(size)]
    to = group[matrix.indices[np.repeat(matrix.indptr[members] - begin[:-1], size) + np.arange(begin[-1])]]
    source = np.repeat(np.arange(members.size), size)
    apart = source != to
    edges = (np.ones(np.count_nonzero(apart), dtype=np.int8), (source[apart], to[apart]))
    graph = sp.csr_array(edges, shape=(members.size, members.size))
    return graph.indptr.astype(np.int64), graph.indices.astype(np.int64)


def renumbered(xadj: IntArray, adj: IntArray, place: IntArray) -> tuple[IntArray, IntArray]:
    """The graph in a new order; vertex place[k] becomes k."""
    new = np.empty(place.size, dtype=np.int64)
    new[place] = np.arange(place.size)
    size = np.diff(xadj)[place]
    start = np.r_[0, np.cumsum(size)]
    picked = np.repeat(xadj[place] - start[:-1], size) + np.arange(start[-1])
    return start, new[adj[picked]]


def _expanded(
    group: IntArray, place: IntArray, weights: IntArray, first: IntArray, below: tuple[IntArray, IntArray, IntArray]
) -> Supernodes:
    """From groups of rows to rows."""
    start, rows, parent = below
    begin, rank = np.r_[0, np.cumsum(weights)], np.empty(place.size, dtype=np.int64)
    rank[place] = np.arange(place.size)
    order, size = np.argsort(rank[group], kind="stable"), weights[rows]
    total = np.r_[0, np.cumsum(size)]
    every = np.repeat(begin[rows] - total[:-1], size) + np.arange(total[-1])
    return Supernodes(order, begin[first], total[start], every, parent)


@compiled
def tree(xadj, adj):
    """Parent of each vertex in the elimination tree, -1 for a root."""
    n = xadj.size - 1
    parent, ancestor = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    for j in range(n):
        for p in range(xadj[j], xadj[j + 1]):
            i = adj[p]
            while i != -1 and i < j:
                higher = ancestor[i]
                ancestor[i] = j
                if higher == -1:
                    parent[i] = j
                i = higher
    return parent


@compiled
def heights(xadj, adj, parent, weights):
    """Rows of each column of the factor, in a group with its own: the paths to each row in the tree, walked once."""
    n = parent.size
    height, mark = weights.copy(), np.full(n, -1, np.int64)
    for i in range(n):
        mark[i] = i
        for p in range(xadj[i], xadj[i + 1]):
            j = adj[p]
            while j < i and mark[j] != i:
                mark[j] = i
                height[j] += weights[i]
                j = parent[j]
    return height


@compiled
def postorder(parent, height):
    """Children before their parent, the tallest last."""
    n = parent.size
    head, after, post, stack = np.full(n, -1, np.int64), np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    for v in np.argsort(-height, kind="mergesort"):
        if parent[v] >= 0:
            after[v], head[parent[v]] = head[parent[v]], v
    done = 0
    for root in range(n):
        if parent[root] != -1:
            continue
        top, stack[0] = 0, root
        while top >= 0:
            v = stack[top]
            if head[v] == -1:
                post[done] = v
                done, top = done + 1, top - 1
            else:
                top += 1
                stack[top], head[v] = head[v], after[head[v]]
    return post


@compiled
def worth_it(width, zeros, size):
    """Whether a merged supernode of so many columns may hold so many zeros among its values."""
    if width <= NARROW:
        return True
    return zeros < (FEW_ZEROS if width <= MIDDLE else FEWER_ZEROS if width <= WIDE else FEWEST_ZEROS) * size


@compiled
def amalgamated(parent, height, weights):
    """First vertex of each supernode, and the number of vertices; a supernode's child that ends just before it may join it."""
    n = parent.size
    begin, width, zeros, count = np.empty(n + 1, np.int64), np.empty(n, np.int64), np.zeros(n), 0
    for j in range(n):
        start, columns, empty = j, weights[j], 0.0
        while count > 0 and parent[start - 1] >= start and parent[start - 1] <= j:
            child = begin[count - 1]
            under = height[j] - weights[j]
            added = float(width[count - 1]) * (columns + under - (height[start - 1] - weights[start - 1]))
            both = width[count - 1] + columns
            total = zeros[count - 1] + empty + added
            if added > 0 and not worth_it(both, total, 0.5 * both * (both + 1) + both * under):
                break
            start, columns, empty, count = child, both, total, count - 1
        begin[count], width[count], zeros[count] = start, columns, empty
        count += 1
    begin[count] = n
    return begin[: count + 1].copy()


@compiled
def structure(first, xadj, adj):
    """Vertices below each supernode, sorted: where they begin, the vertices, and the supernode's parent (-1 for a root)."""
    count, n = first.size - 1, first[-1]
    owner, mark = np.repeat(np.arange(count), first[1:] - first[:-1]), np.full(n, -1, np.int64)
    head, after, parent = np.full(count, -1, np.int64), np.full(count, -1, np.int64), np.full(count, -1, np.int64)
    start, rows, used = np.zeros(count + 1, np.int64), np.empty(8 * n, np.int64), 0
    for s in range(count):
        last, begin = first[s + 1], used
        if used + n - last > rows.size:
            rows = np.concatenate((rows, np.empty(rows.size + n, np.int64)))
        for p in range(xadj[first[s]], xadj[last]):
            if adj[p] >= last and mark[adj[p]] != s:
                mark[adj[p]], rows[used] = s, adj[p]
                used += 1
        child = head[s]
        while child != -1:
            for p in range(start[child], start[child + 1]):
                if rows[p] >= last and mark[rows[p]] != s:
                    mark[rows[p]], rows[used] = s, rows[p]
                    used += 1
            child = after[child]
        rows[begin:used].sort()
        start[s + 1] = used
        if used > begin:
            parent[s] = owner[rows[begin]]
            after[s], head[parent[s]] = head[parent[s]], s
    return start, rows[:used].copy(), parent
