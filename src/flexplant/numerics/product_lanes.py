"""The loops of `products`, eight columns in a vector register. Imported only where numba is installed."""

from __future__ import annotations

from flexplant.numerics.compiled import compiled
from flexplant.numerics.lanes import WIDTH, add, load, spread, store, zero

PAIR = 2 * WIDTH


@compiled
def multiply(indptr, indices, data, x, wide, out):
    """out (m, wide) = A x (n, wide), both by rows, of a matrix in CSR form; wide is a multiple of eight."""
    pairs = wide // PAIR * PAIR
    for i in range(indptr.size - 1):
        first, last, to = indptr[i], indptr[i + 1], i * wide
        for shift in range(0, pairs, PAIR):
            a, b = zero(), zero()
            for p in range(first, last):
                at, value = indices[p] * wide + shift, spread(data, p)
                a, b = add(value, load(x, at), a), add(value, load(x, at + WIDTH), b)
            store(out, to + shift, a)
            store(out, to + shift + WIDTH, b)
        if pairs < wide:
            a = zero()
            for p in range(first, last):
                a = add(spread(data, p), load(x, indices[p] * wide + pairs), a)
            store(out, to + pairs, a)
