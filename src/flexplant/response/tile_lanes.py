"""`receptances` and `polynomials` of `tiles` eight frequencies at a time, as the compiler takes them; three such groups a strip.

Imported only where numba is installed.
"""

from __future__ import annotations

from numba.extending import overload

from flexplant.numerics.lane_math import filled, inverses, minus
from flexplant.numerics.lanes import WIDTH, add, load, store, times
from flexplant.response import tiles
from flexplant.response.tiles import STRIP

SECOND, THIRD = WIDTH, 2 * WIDTH


@overload(tiles.receptances)
def _receptances(modal, damping, first, last, center, offset, start, table, place):
    return receptances


@overload(tiles.polynomials)
def _polynomials(omega, start, center, half, basis, place):
    return polynomials


def receptances(modal, damping, first, last, center, offset, start, table, place):
    """`tiles.receptances`; the three groups share a division."""
    a, b, c = load(offset, start), load(offset, start + SECOND), load(offset, start + THIRD)
    middle = filled(-center)
    at_a, at_b, at_c = minus(a, middle), minus(b, middle), minus(c, middle)
    for i in range(first, last):
        below, above, rate = filled(modal[i] - center), filled(-modal[i] - center), filled(-damping[i])
        x = times(minus(below, a), minus(a, above))
        y = times(minus(below, b), minus(b, above))
        z = times(minus(below, c), minus(c, above))
        u, v, w = times(rate, at_a), times(rate, at_b), times(rate, at_c)
        p, q, r = inverses(add(x, x, times(u, u)), add(y, y, times(v, v)), add(z, z, times(w, w)))
        at = place + (i - first) * 2 * STRIP
        store(table, at, times(x, p))
        store(table, at + SECOND, times(y, q))
        store(table, at + THIRD, times(z, r))
        store(table, at + STRIP, times(u, p))
        store(table, at + STRIP + SECOND, times(v, q))
        store(table, at + STRIP + THIRD, times(w, r))


def polynomials(omega, start, center, half, basis, place):
    """`tiles.polynomials`, the recurrence kept in registers."""
    for s in range(0, STRIP, WIDTH):
        before, last = filled(1.0), times(minus(load(omega, start + s), filled(center)), filled(1 / half))
        twice = add(filled(1.0), last, last)
        store(basis, place + s, before)
        store(basis, place + STRIP + s, last)
        for k in range(place + 2 * STRIP + s, place + STRIP * STRIP, STRIP):
            before, last = last, minus(times(twice, last), before)
            store(basis, k, last)
