"""The loops of `blocks`: eight columns of a basis against sixteen of a block, in vector registers.

Imported only where numba is installed. Entry (i, k) of a basis is at i row + k column, so that either order in memory will do.
"""

from __future__ import annotations

from flexplant.numerics.compiled import compiled, inlined
from flexplant.numerics.lanes import WIDTH
from flexplant.numerics.strip_lanes import ahead, inner, outer, put, taken

PAIR = 2 * WIDTH
ROWS = 512  # of the block that stay near while the basis passes by
SOON = 8 * WIDTH  # rows ahead that are asked for


@inlined
def asked(basis, at, column):
    """Ask for the lines of eight columns some rows ahead."""
    for k in range(WIDTH):
        ahead(basis, at + k * column)


@inlined
def some_shares(basis, row, column, k, first, last, block, wide, shift, out, m):
    """Eight rows of V^T W from some rows of both."""
    sums = taken(out, k * wide + shift, wide, m)
    for start in range(first, last, WIDTH):
        asked(basis, (start + SOON) * row + k * column, column)
        for i in range(start, min(start + WIDTH, last)):
            sums = outer(basis, i * row + k * column, column, block, i * wide + shift, sums)
    put(out, k * wide + shift, wide, sums)


@inlined
def some_less(basis, row, column, k, first, last, share, wide, shift, block, m):
    """Some rows of W + V C, of eight columns of V."""
    held = taken(share, k * wide + shift, wide, m)
    for start in range(first, last, WIDTH):
        asked(basis, (start + SOON) * row + k * column, column)
        for i in range(start, min(start + WIDTH, last)):
            inner(basis, i * row + k * column, column, block, i * wide + shift, held)


@compiled
def shares(basis, row, column, count, block, wide, out):
    """Add V^T W to out (count, wide); V (n, count), W (n, wide) by rows; count and wide are multiples of eight."""
    n, pairs = block.size // wide, wide // PAIR * PAIR
    for first in range(0, n, ROWS):
        last = min(first + ROWS, n)
        for k in range(0, count, WIDTH):
            for shift in range(0, pairs, PAIR):
                some_shares(basis, row, column, k, first, last, block, wide, shift, out, 2)
            if pairs < wide:
                some_shares(basis, row, column, k, first, last, block, wide, pairs, out, 1)


@compiled
def combined(basis, row, column, count, share, wide, block):
    """Add V C to the block W (n, wide) by rows; V (n, count), C (count, wide); count and wide are multiples of eight."""
    n, pairs = block.size // wide, wide // PAIR * PAIR
    for first in range(0, n, ROWS):
        last = min(first + ROWS, n)
        for k in range(0, count, WIDTH):
            for shift in range(0, pairs, PAIR):
                some_less(basis, row, column, k, first, last, share, wide, shift, block, 2)
            if pairs < wide:
                some_less(basis, row, column, k, first, last, share, wide, pairs, block, 1)
