"""Nested dissection: an order of elimination that keeps a sparse factor small.

Imported only where numba is installed. Sources: George, SIAM J. Numer. Anal. 10 (1973); Karypis and Kumar 1998.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexplant.numerics.compiled import compiled
from flexplant.numerics.factorization.separators import SEPARATOR, contracted, grown, matched, refined

COARSEST = 100  # vertices
SHRINK = 0.92  # of the vertices that must remain for coarsening to be worth its while, at most
LEVELS = 3  # of coarsening, before they part
TRIES = 2  # of bisections of the coarse graph
STARTS = 2  # growths on the coarsest
LEAF = 60  # vertices, ordered by minimum degree
SEED = 20190811


class Levels:
    """A graph and its coarser forms, each with the map to the next."""

    def __init__(self, graph: Any, random: Any, coarsest: int, most: int) -> None:
        self.graphs, self.maps, self.random = [graph], [], random
        while self.size > coarsest and len(self.maps) < most:
            xadj, adj, edges, weights = self.graphs[-1]
            order = random.permutation(xadj.size - 1)
            order = order[np.argsort(np.diff(xadj)[order], kind="stable")]
            coarse, count = matched(xadj, adj, edges, weights, order)
            if count > SHRINK * order.size:
                break
            self.maps.append(coarse)
            self.graphs.append(contracted(xadj, adj, edges, weights, coarse, count))

    @property
    def size(self) -> int:
        """Vertices of the coarsest."""
        return int(self.graphs[-1][0].size - 1)

    def raised(self, part: Any) -> tuple[float, Any]:
        """The weight of the separator, and a partition of the finest graph from one of the coarsest, refined on the way."""
        cost = np.inf
        for graph, coarse in zip(self.graphs[-2::-1], self.maps[::-1], strict=True):
            part = part[coarse]
            cost = refined(graph[0], graph[1], graph[3], part)
        return cost, part


def bisected(graph: Any, random: Any) -> Any:
    """(n,) sides 0 and 1, and the separator."""
    fine = Levels(graph, random, 8 * COARSEST, LEVELS)
    best, chosen = np.inf, None
    for _ in range(TRIES if fine.size > 2 * COARSEST else 1):
        cost, part = _candidate(fine.graphs[-1], random)
        if chosen is None or cost < best:
            best, chosen = cost, part
    return fine.raised(chosen)[1]


def _candidate(graph: Any, random: Any) -> tuple[float, Any]:
    levels = Levels(graph, random, COARSEST, 99)
    xadj, adj, _, weights = levels.graphs[-1]
    best, chosen = np.inf, None
    for start in random.integers(levels.size, size=STARTS):
        part = grown(xadj, adj, weights, start)
        cost = refined(xadj, adj, weights, part)
        if chosen is None or cost < best:
            best, chosen = cost, part
    return levels.raised(chosen) if levels.maps else (best, chosen)


@compiled
def part_of(xadj, adj, weights, vertices, local):
    """The graph among some vertices; local (n,) is -1 and stays so."""
    m = vertices.size
    for k in range(m):
        local[vertices[k]] = k
    start, most = np.zeros(m + 1, np.int64), 0
    for v in vertices:
        most += xadj[v + 1] - xadj[v]
    new, used = np.empty(most, np.int64), 0
    for k in range(m):
        for u in adj[xadj[vertices[k]] : xadj[vertices[k] + 1]]:
            if local[u] >= 0:
                new[used] = local[u]
                used += 1
        start[k + 1] = used
    local[vertices] = -1
    return start, new[:used].copy(), np.ones(used), weights[vertices]


@compiled
def least_degree(xadj, adj, weights, vertices, local):
    """The vertices in order of minimum degree; their neighbours outside count, but stay. local (n,) is -1 and stays so."""
    m, total = vertices.size, vertices.size
    for k in range(m):
        local[vertices[k]] = k
    for v in vertices:
        for u in adj[xadj[v] : xadj[v + 1]]:
            if local[u] < 0:
                local[u] = total
                total += 1
    near, weight, degree = np.zeros((total, total), np.bool_), np.empty(total), np.zeros(total)
    for k in range(m):
        for u in adj[xadj[vertices[k]] : xadj[vertices[k] + 1]]:
            near[k, local[u]] = near[local[u], k] = True
            weight[local[u]] = weights[u]
        weight[k] = weights[vertices[k]]
    for v in vertices:
        local[v] = -1
        local[adj[xadj[v] : xadj[v + 1]]] = -1
    for k in range(m):
        degree[k] = weight[near[k]].sum()
    out = np.empty(m, np.int64)
    for step in range(m):
        best = np.argmin(degree[:m])
        out[step], degree[best] = vertices[best], np.inf
        rest = np.flatnonzero(near[best])
        near[:, best] = False
        for i in rest:
            degree[i] -= weight[best]
            for j in rest:
                if i != j and not near[i, j]:
                    near[i, j] = True
                    degree[i] += weight[j]
    return out


def dissected(xadj: Any, adj: Any, weights: Any) -> Any:
    """(n,) vertices in order of elimination, of a graph (xadj, adj) without loops, with weights (n,). Deterministic."""
    random, n = np.random.default_rng(SEED), xadj.size - 1
    order, local, pending = np.empty(n, np.int64), np.full(n, -1, np.int64), [(0, np.arange(n))]
    while pending:
        begin, vertices = pending.pop()
        end = begin + vertices.size
        sides = [vertices] if vertices.size <= LEAF else _sides(xadj, adj, weights, vertices, local, random)
        if len(sides) == 1:
            order[begin:end] = least_degree(xadj, adj, weights, vertices, local)
            continue
        order[end - sides[2].size : end] = sides[2]
        pending += [(begin, sides[0]), (begin + sides[0].size, sides[1])]
    return order


def _sides(xadj: Any, adj: Any, weights: Any, vertices: Any, local: Any, random: Any) -> list[Any]:
    part = bisected(part_of(xadj, adj, weights, vertices, local), random)
    sides = [vertices[part == side] for side in (0, 1, SEPARATOR)]
    return sides if sides[0].size and sides[1].size else [vertices]
