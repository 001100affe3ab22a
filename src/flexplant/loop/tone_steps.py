"""The compiled end of `ToneSweep`: from modal sums to outputs, eight frequencies at a time.

Imported only where numba is installed.
"""

from __future__ import annotations

from flexplant.numerics.compiled import compiled
from flexplant.numerics.lane_math import filled, inverse, minus, parts, store_parts
from flexplant.numerics.lanes import WIDTH, add, load, store, times, zero

PAIR = 2 * WIDTH  # reals of eight complex numbers


@compiled
def _accumulated(weight, place, values, first, sums):
    """sums + weight[place] values[first], complex numbers: weight as pairs of reals, values as eight real and eight imaginary."""
    a, b = filled(weight[place]), filled(weight[place + 1])
    x, y = load(values, first), load(values, first + WIDTH)
    return add(a, x, minus(sums[0], times(b, y))), add(a, y, add(b, x, sums[1]))


@compiled
def rows_of(sums, row, turn, fast, omega, k, at, rows):
    """rows (R, 2, WIDTH): what each row reads of group k at eight frequencies; see `outputs`."""
    groups, count = omega.shape
    w = load(omega, k * count + at)
    for r in range(rows.size // PAIR):
        store(rows, r * PAIR, zero())
        store(rows, r * PAIR + WIDTH, zero())
    for c in range(row.size):
        x, y = parts(sums, 2 * ((c * groups + k) * count + at))
        if fast[c]:
            x, y = times(x, w), times(y, w)
        a, b, place = filled(turn[2 * c]), filled(turn[2 * c + 1]), row[c] * PAIR
        store(rows, place, add(a, x, minus(load(rows, place), times(b, y))))
        store(rows, place + WIDTH, add(a, y, add(b, x, load(rows, place + WIDTH))))


@compiled
def outputs(sums, row, turn, fast, omega, into, drive, poles, out_of, read, direct, out, rows, modal):
    """out[z] = direct[z] + sum_r read[z, r] y_r + sum_p out_of[z, p] (drive[p] + sum_r into[p, r] y_r) / (i w - p), all complex.

    sums (C, K, nf) add to row[c] of y, times turn[c], and times w where fast[c]. omega (K, nf), nf at least WIDTH; drive (P, K),
    direct (nz, K), out (nz, K, nf). rows, modal: scratch, (R, 2, WIDTH) and (P, 2, WIDTH). Complex numbers are pairs of reals.
    """
    groups, count = omega.shape
    for k in range(groups):
        for block in range(0, count, WIDTH):
            at = min(block, count - WIDTH)
            rows_of(sums, row, turn, fast, omega, k, at, rows)
            w, seen = load(omega, k * count + at), rows.size // PAIR
            for p in range(poles.size // 2):
                place = 2 * (p * groups + k)
                x, y = filled(drive[place]), filled(drive[place + 1])
                for r in range(seen):
                    x, y = _accumulated(into, 2 * (p * seen + r), rows, r * PAIR, (x, y))
                a, b = filled(-poles[2 * p]), minus(w, filled(poles[2 * p + 1]))
                size = inverse(add(a, a, times(b, b)))
                store(modal, p * PAIR, times(size, add(x, a, times(y, b))))
                store(modal, p * PAIR + WIDTH, times(size, minus(times(y, a), times(x, b))))
            for z in range(direct.size // (2 * groups)):
                place = 2 * (z * groups + k)
                x, y = filled(direct[place]), filled(direct[place + 1])
                for r in range(seen):
                    x, y = _accumulated(read, 2 * (z * seen + r), rows, r * PAIR, (x, y))
                for p in range(poles.size // 2):
                    x, y = _accumulated(out_of, z * poles.size + 2 * p, modal, p * PAIR, (x, y))
                store_parts(out, 2 * ((z * groups + k) * count + at), x, y)
