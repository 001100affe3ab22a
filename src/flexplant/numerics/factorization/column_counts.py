"""What a Cholesky factor will hold, without computing it: entries of each column of L from the pattern of A and an order.

In the elimination tree (Liu 1990) row i of L is the subtree whose leaves are among the neighbours of i. So each column's count is
a sum over its subtree of +1 for each row that has its first leaf there and -1 where two branches of a row meet: time nearly
proportional to the entries of A. Source: Gilbert, Ng and Peyton 1994.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.model.arrays import IntArray
from flexplant.numerics.compiled import Kernel
from flexplant.numerics.factorization.protocol import Estimate


def column_counts(matrix: Any, order: IntArray) -> IntArray:
    """(n,) entries of the columns of L of P A P^T = L L^T, diagonal included; order: P's rows. A (n, n) symmetric, sparse."""
    return tree_and_counts(matrix, order)[1]


def tree_and_counts(matrix: Any, order: IntArray) -> tuple[IntArray, IntArray]:
    """Parents in the elimination tree (n,), -1 of a root, and `column_counts`."""
    n = matrix.shape[0]
    pattern = sp.csr_array((np.ones(matrix.nnz, dtype=np.int8), matrix.indices, matrix.indptr), shape=matrix.shape)
    lower = sp.tril(pattern[order][:, order], -1, format="csr")
    upper = sp.csr_array(lower.T)
    parent, post = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    counts = np.empty(n, dtype=np.int64)
    TREE(lower.indptr.astype(np.int64), lower.indices.astype(np.int64), parent)
    POSTORDER(parent, post)
    COUNTS(upper.indptr.astype(np.int64), upper.indices.astype(np.int64), parent, post, counts)
    return parent, counts


def cholesky_estimate(counts: IntArray, stored: float, entry_bytes: int) -> Estimate:
    """Cost of a factorisation of these columns, (n,), that keeps `stored` entries of `entry_bytes`, index included; flops are
    those of L alone. At the peak the largest front is there besides."""
    size = counts.astype(float)
    held, front = int(entry_bytes * stored), 8 * int(size.max(initial=0.0)) ** 2
    return Estimate(int(stored), held, held + front, float(np.sum(size**2)))


def relaxed_entries(parent: IntArray, counts: IntArray, rule: tuple[tuple[int, float], ...]) -> int:
    """Entries that a supernodal code stores which merges small supernodes with their parents, zeros included.

    parent, counts: of an order whose tree is in postorder. rule: (columns, share of zeros) pairs: a merged supernode of at most
    so many columns may hold that share; the last pair's columns are without bound, the first's share is. Merging a columns of r
    rows into a parent of s rows adds a (a + s - r) zeros.
    """
    n = counts.size
    children = np.bincount(parent[parent >= 0], minlength=n)
    joined = np.zeros(n, dtype=bool)
    joined[1:] = (parent[:-1] == np.arange(1, n)) & (counts[:-1] == counts[1:] + 1) & (children[1:] == 1)
    starts = np.flatnonzero(~joined)
    ends = np.append(starts[1:], n)
    above = np.where(parent[ends - 1] >= 0, np.searchsorted(starts, parent[ends - 1], side="right") - 1, -1).tolist()
    width, rows, zeros, top = (ends - starts).tolist(), counts[starts].tolist(), [0] * starts.size, list(range(starts.size))
    for s in range(starts.size - 2, -1, -1):
        home = above[s]
        while home != -1 and top[home] != home:
            home = top[home]
        if home != s + 1:
            continue
        total = width[s] + width[home]
        new = width[s] * (width[s] + rows[home] - rows[s])
        share = (new + zeros[home]) / (total * (total + 1) / 2 + total * (rows[home] - width[home]))
        if new == 0 or any(total <= columns and share < most for columns, most in rule):
            top[home], zeros[s], rows[s], width[s] = s, new + zeros[home], width[s] + rows[home], total
    kept = [s for s, head in enumerate(top) if head == s]
    return sum(width[s] * (width[s] + 1) // 2 + width[s] * (rows[s] - width[s]) for s in kept)


def _tree(starts: Any, columns: Any, parent: Any) -> None:
    """Parents in the elimination tree (-1 of a root), from the rows of the strict lower triangle."""
    n = len(parent)
    ancestor = [-1] * n
    for i in range(n):
        parent[i] = -1
        for at in range(starts[i], starts[i + 1]):
            j = columns[at]
            while j != -1 and j < i:
                above = ancestor[j]
                ancestor[j] = i
                if above == -1:
                    parent[j] = i
                j = above


def _postorder(parent: Any, post: Any) -> None:
    """Nodes, children before parents and each subtree in one piece."""
    n = len(parent)
    child, sibling = [-1] * n, [-1] * n
    for j in range(n - 1, -1, -1):
        if parent[j] != -1:
            sibling[j] = child[parent[j]]
            child[parent[j]] = j
    k = 0
    for root in range(n):
        if parent[root] != -1:
            continue
        node = root
        while node != -1:
            while child[node] != -1:
                below = child[node]
                child[node] = sibling[below]
                node = below
            post[k] = node
            k += 1
            node = parent[node] if node != root else -1


def _counts(starts: Any, rows: Any, parent: Any, post: Any, counts: Any) -> None:
    """See the module; starts, rows: columns of the strict lower triangle."""
    n = len(parent)
    first, furthest, previous = [-1] * n, [-1] * n, [-1] * n
    for k in range(n):
        j = post[k]
        counts[j] = 1 if first[j] == -1 else 0
        while j != -1 and first[j] == -1:
            first[j] = k
            j = parent[j]
    ancestor = list(range(n))
    for k in range(n):
        j = post[k]
        if parent[j] != -1:
            counts[parent[j]] -= 1
        for at in range(starts[j], starts[j + 1]):
            i = rows[at]
            if first[j] <= furthest[i]:
                continue
            furthest[i] = first[j]
            counts[j] += 1
            if previous[i] != -1:
                meet = previous[i]
                while ancestor[meet] != meet:
                    ancestor[meet] = ancestor[ancestor[meet]]
                    meet = ancestor[meet]
                counts[meet] -= 1
            previous[i] = j
        if parent[j] != -1:
            ancestor[j] = parent[j]
    for k in range(n):
        j = post[k]
        if parent[j] != -1:
            counts[parent[j]] += counts[j]


def _with_lists(loops: Callable[..., None]) -> Callable[..., None]:
    """The same loops over lists, which Python indexes faster than arrays; the last argument is the result."""

    def run(*arguments: Any) -> None:
        lists = [a.tolist() for a in arguments]
        loops(*lists)
        arguments[-1][:] = lists[-1]

    return run


TREE = Kernel(_tree, _with_lists(_tree))
POSTORDER = Kernel(_postorder, _with_lists(_postorder))
COUNTS = Kernel(_counts, _with_lists(_counts))
