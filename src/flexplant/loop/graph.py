"""The graph of a diagram: which blocks form feedback loops, in which order they run, where feedthrough closes on itself."""

from __future__ import annotations

from collections import deque
from graphlib import TopologicalSorter

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from flexplant.loop.wiring import NONE, Wiring
from flexplant.model.arrays import FloatArray, IntArray


def strongly_connected(graph: FloatArray) -> IntArray:
    """(n,) label of the strongly connected component of each node; graph[i, j] != 0 is an edge i -> j."""
    return np.asarray(connected_components(sp.csr_array(graph), directed=True, connection="strong")[1], dtype=np.int64)


def block_stages(wiring: Wiring, n_blocks: int) -> list[list[int]]:
    """Blocks in the order signals flow; blocks that feed one another come together in one stage."""
    edges = np.zeros((n_blocks, n_blocks))
    driven = np.flatnonzero(wiring.source != NONE)
    edges[wiring.output_block[wiring.source[driven]], wiring.input_block[driven]] = 1.0
    labels = strongly_connected(edges)
    before: dict[int, set[int]] = {int(k): set() for k in labels}
    for a, b in zip(*np.nonzero(edges), strict=True):
        if labels[a] != labels[b]:
            before[int(labels[b])].add(int(labels[a]))
    return [np.flatnonzero(labels == k).tolist() for k in TopologicalSorter(before).static_order()]


def algebraic_loops(wiring: Wiring, D: FloatArray) -> list[list[str]]:
    """Each closed path of direct feedthrough, as the ports it passes; D: (ny, nu) block-diagonal feedthrough."""
    ny, nu = D.shape
    edges = np.zeros((ny + nu, ny + nu))  # outputs first, then inputs
    driven = np.flatnonzero(wiring.source != NONE)
    edges[wiring.source[driven], ny + driven] = 1.0
    edges[ny:, :ny] = (D != 0.0).T
    labels = strongly_connected(edges)
    names = (*wiring.output_ports, *wiring.input_ports)
    members = [np.flatnonzero(labels == k) for k in range(int(labels.max(initial=-1)) + 1)]
    return [[names[i] for i in _shortest_cycle(edges, nodes)] for nodes in members if nodes.size > 1]


def _shortest_cycle(edges: FloatArray, nodes: IntArray) -> list[int]:
    """A shortest cycle through the first node of a strongly connected set, by breadth-first search."""
    start, allowed = int(nodes[0]), set(nodes.tolist())
    previous, queue = {start: NONE}, deque([start])
    while queue:
        here = queue.popleft()
        for after in np.flatnonzero(edges[here]).tolist():
            if after == start:
                return _path(previous, here)
            if after in allowed and after not in previous:
                previous[after] = here
                queue.append(after)
    return [int(k) for k in nodes]


def _path(previous: dict[int, int], end: int) -> list[int]:
    path = [end]
    while (before := previous[path[-1]]) != NONE:
        path.append(before)
    return path[::-1]
