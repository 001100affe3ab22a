"""Vertex separators of a graph by multilevel bisection: heavy-edge coarsening, growing, refinement after Fiduccia and Mattheyses.

Graphs are (xadj, adj) lists of neighbours without loops, with edge and vertex weights. Imported only where numba is installed.
Sources: Karypis and Kumar, SIAM J. Sci. Comput. 20 (1998); Hendrickson and Rothberg, SIAM J. Sci. Comput. 20 (1998).
"""

from __future__ import annotations

import numpy as np

from flexplant.numerics.compiled import compiled

LARGER_SIDE = 0.6  # of the weight, at most
PATIENCE = 300  # moves without improvement that end a pass
PASSES = 10
SEPARATOR = 2  # in a partition: sides are 0 and 1


@compiled
def matched(xadj, adj, edges, weights, order):
    """Pairs of vertices joined by heavy edges: the coarse vertex of each, and how many there are."""
    n = xadj.size - 1
    coarse, count = np.full(n, -1, np.int64), 0
    for v in order:
        if coarse[v] >= 0:
            continue
        mate, heaviest = v, -1.0
        for p in range(xadj[v], xadj[v + 1]):
            u = adj[p]
            if coarse[u] < 0 and edges[p] > heaviest * weights[u]:
                mate, heaviest = u, edges[p] / weights[u]
        coarse[v] = coarse[mate] = count
        count += 1
    return coarse, count


@compiled
def contracted(xadj, adj, edges, weights, coarse, count):
    """The graph of coarse vertices, parallel edges summed."""
    begin, members = np.zeros(count + 2, np.int64), np.empty(coarse.size, np.int64)
    for c in coarse:
        begin[c + 2] += 1
    begin = np.cumsum(begin)
    for v in range(coarse.size):
        members[begin[coarse[v] + 1]] = v
        begin[coarse[v] + 1] += 1
    start, new, sums, heavy = np.zeros(count + 1, np.int64), np.empty_like(adj), np.empty_like(edges), np.zeros(count)
    place, used = np.full(count, -1, np.int64), 0
    for c in range(count):
        for k in range(begin[c], begin[c + 1]):
            v = members[k]
            heavy[c] += weights[v]
            for p in range(xadj[v], xadj[v + 1]):
                u = coarse[adj[p]]
                if u == c:
                    continue
                if place[u] < start[c]:
                    place[u], new[used], sums[used] = used, u, edges[p]
                    used += 1
                else:
                    sums[place[u]] += edges[p]
        start[c + 1] = used
    return start, new[:used].copy(), sums[:used].copy(), heavy


@compiled
def grown(xadj, adj, weights, start):
    """A partition: half of the weight around `start`, breadth first, the rest, and the first half's rim as separator."""
    n, half, weight, head, tail, fresh = xadj.size - 1, 0.5 * weights.sum(), 0.0, 0, 0, start
    part, queue, seen = np.ones(n, np.int8), np.empty(n, np.int64), np.zeros(n, np.bool_)
    while weight < half:
        if head == tail:
            while seen[fresh]:
                fresh = (fresh + 1) % n
            queue[tail], seen[fresh] = fresh, True
            tail += 1
        v = queue[head]
        head += 1
        part[v], weight = 0, weight + weights[v]
        for u in adj[xadj[v] : xadj[v + 1]]:
            if not seen[u]:
                seen[u], queue[tail] = True, u
                tail += 1
    for v in range(n):
        if part[v] == 0 and (part[adj[xadj[v] : xadj[v + 1]]] == 1).any():
            part[v] = SEPARATOR
    return part


@compiled
def pushed(heap, size, gain, entry):
    """A binary heap (gains, entries) with one more; its size."""
    gains, entries = heap
    k = size
    while k > 0 and gains[(k - 1) // 2] < gain:
        gains[k], entries[k] = gains[(k - 1) // 2], entries[(k - 1) // 2]
        k = (k - 1) // 2
    gains[k], entries[k] = gain, entry
    return size + 1


@compiled
def popped(heap, size):
    """The heap's best gain and entry taken out, and its size."""
    gains, entries = heap
    top, best, size = gains[0], entries[0], size - 1
    gain, entry, k = gains[size], entries[size], 0
    while 2 * k + 1 < size:
        child = 2 * k + 1
        if child + 1 < size and gains[child + 1] > gains[child]:
            child += 1
        if gains[child] <= gain:
            break
        gains[k], entries[k] = gains[child], entries[child]
        k = child
    gains[k], entries[k] = gain, entry
    return top, best, size


@compiled
def gain_of(xadj, adj, weights, part, v, side):
    """How much lighter the separator gets when v leaves it for a side, and its neighbours on the other side join it."""
    gain = weights[v]
    for p in range(xadj[v], xadj[v + 1]):
        if part[adj[p]] == 1 - side:
            gain -= weights[adj[p]]
    return gain


@compiled
def one_pass(xadj, adj, weights, part, total, side):
    """Move the separator towards the other side, best vertices first, and undo the moves after the best state.

    Returns whether that is better. A front that only advances crosses a mesh; one that may turn back stays where it is.
    """
    n, limit = xadj.size - 1, LARGER_SIDE * total.sum()
    room = n + adj.size + 1
    gains, heap, size = np.zeros(n), (np.empty(room), np.empty(room, np.int64)), 0
    moves, old, made, kept, since = np.empty(2 * n, np.int64), np.empty(2 * n, np.int8), 0, 0, 0
    for v in range(n):
        if part[v] == SEPARATOR:
            gains[v] = gain_of(xadj, adj, weights, part, v, side)
            size = pushed(heap, size, gains[v], v)
    best = first = total[2] if max(total[0], total[1]) <= limit else np.inf
    even = start = abs(total[0] - total[1])
    while size > 0 and since < PATIENCE:
        gain, v, size = popped(heap, size)
        if part[v] != SEPARATOR or gain != gains[v]:
            continue
        if total[side] + weights[v] > limit and total[side] > total[1 - side]:
            break
        part[v], moves[made], old[made] = side, v, SEPARATOR
        total[2] -= weights[v]
        total[side] += weights[v]
        made, since = made + 1, since + 1
        for p in range(xadj[v], xadj[v + 1]):
            u = adj[p]
            if part[u] == 1 - side:
                part[u], moves[made], old[made] = SEPARATOR, u, 1 - side
                total[2] += weights[u]
                total[1 - side] -= weights[u]
                made += 1
                for q in range(xadj[u], xadj[u + 1]):
                    x = adj[q]
                    if part[x] == SEPARATOR and x != u:
                        gains[x] += weights[u]
                        size = pushed(heap, size, gains[x], x)
                gains[u] = gain_of(xadj, adj, weights, part, u, side)
                size = pushed(heap, size, gains[u], u)
        difference = abs(total[0] - total[1])
        if max(total[0], total[1]) <= limit and (total[2] < best or (total[2] == best and difference < even)):
            best, even, kept, since = total[2], difference, made, 0
    for k in range(made - 1, kept - 1, -1):
        total[part[moves[k]]] -= weights[moves[k]]
        total[old[k]] += weights[moves[k]]
        part[moves[k]] = old[k]
    return best < first or even < start


@compiled
def refined(xadj, adj, weights, part):
    """The weight of the separator after passes to either side in turn, which change `part` in place."""
    total = np.zeros(3)
    for v in range(part.size):
        total[part[v]] += weights[v]
    side, idle = 0 if total[0] < total[1] else 1, 0
    for _ in range(PASSES):
        idle = 0 if one_pass(xadj, adj, weights, part, total, side) else idle + 1
        if idle == 2:
            break
        side = 1 - side
    return total[2] if max(total[0], total[1]) <= LARGER_SIDE * total.sum() else np.inf
