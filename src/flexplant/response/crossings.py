"""Where loop gains known only by evaluation cross one and the negative real axis: a grid refined where they turn, then roots.

For loops too large for the eigenvalue pencils of `level`. A crossing is found where the refined grid shows a change of sign, and
is then exact to round-off. What can be missed: two crossings between neighbouring points whose middle shows no bend.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flexplant.model.arrays import FloatArray, IntArray

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
Loops: TypeAlias = Callable[[FloatArray], ComplexArray]  # (nf,) Hz -> (r, nf)
BEND = 0.05  # of the value, by which the middle of an interval may differ from a straight line
SHORTEST = 1e-9  # relative distance of neighbours that are not divided further
MOST_POINTS = 400_000
MOST_DECADES = 15
FLAT = 0.05  # decades of gain in a decade of frequency, below which a loop has settled
SHARE = 0.48  # of an interval, where it is divided: not the middle, where an undamped mode may lie between two points
REAL = 1e-6  # largest imaginary part, relative, of a crossing of the real axis; a pole between two points has more


def refined_grid(loops: Loops, hz: FloatArray) -> tuple[FloatArray, ComplexArray]:
    """(nf,) ascending Hz and (r, nf) values: intervals of `hz` are divided until every loop is nearly straight within each."""
    values = loops(hz)
    a, b, va, vb = hz[:-1], hz[1:], values[:, :-1], values[:, 1:]
    found = [(hz, values)]
    size = hz.size
    while a.size and size + a.size <= MOST_POINTS:
        middle = a + SHARE * (b - a)
        vm = loops(middle)
        found.append((middle, vm))
        size += middle.size
        bent = (abs(vm - va - SHARE * (vb - va)) > BEND * abs(vm)).any(axis=0) & (b - a > SHORTEST * b)
        a, b = np.r_[a[bent], middle[bent]], np.r_[middle[bent], b[bent]]
        va, vb = np.hstack([va[:, bent], vm[:, bent]]), np.hstack([vm[:, bent], vb[:, bent]])
    every = np.concatenate([part for part, _ in found])
    order = np.argsort(every)
    return every[order], np.concatenate([part for _, part in found], axis=1)[:, order]


def widened(loops: Loops, low: float, high: float, *, upwards: bool = True) -> tuple[float, float]:
    """The range extended by decades until no loop heads for a gain of one beyond it, by its slope at the end."""
    for _ in range(MOST_DECADES):
        if not _heads_for_one(_sizes(loops, low, low / 10)):
            break
        low /= 10
    for _ in range(MOST_DECADES if upwards else 0):
        if not _heads_for_one(_sizes(loops, high, high * 10)):
            break
        high *= 10
    return low, high


def _sizes(loops: Loops, here: float, beyond: float) -> FloatArray:
    return np.asarray(np.hstack([abs(loops(np.array([hz]))) for hz in (here, beyond)]), dtype=float)


def _heads_for_one(sizes: FloatArray) -> bool:
    """True where a loop of sizes (r, 2), the second farther out, is on its way to one and has not passed it at the first."""
    here, slope = np.log10(np.maximum(sizes[:, 0], 1e-300)), np.diff(np.log10(np.maximum(sizes, 1e-300)), axis=1)[:, 0]
    return bool(((abs(slope) > FLAT) & (here * slope < 0)).any())


def gain_crossings(loops: Loops, hz: FloatArray, values: ComplexArray) -> list[FloatArray]:
    """For each loop the ascending Hz where |L| = 1."""
    return _roots(loops, lambda v: np.log(np.maximum(abs(v), 1e-300)), hz, values)


def phase_crossings(loops: Loops, hz: FloatArray, values: ComplexArray) -> list[FloatArray]:
    """For each loop the ascending Hz where L is real and negative."""
    found = _roots(loops, lambda v: v.imag, hz, values)
    return [at[_negative(loops(at)[k])] if at.size else at for k, at in enumerate(found)]


def _negative(values: ComplexArray) -> npt.NDArray[np.bool_]:
    return np.asarray((values.real < 0) & (abs(values.imag) <= REAL * abs(values)))


def _roots(loops: Loops, measure: Callable[[ComplexArray], FloatArray], hz: FloatArray, values: ComplexArray) -> list[FloatArray]:
    sides = measure(values)
    rows, starts = np.nonzero(np.sign(sides[:, :-1]) * np.sign(sides[:, 1:]) < 0)
    touching, at = np.nonzero(sides == 0)
    roots = _closed_in(loops, measure, rows, hz[starts], hz[starts + 1], sides[rows, starts], sides[rows, starts + 1])
    return [np.sort(np.r_[roots[rows == k], hz[at[touching == k]]]) for k in range(len(values))]


def _closed_in(
    loops: Loops,
    measure: Callable[[ComplexArray], FloatArray],
    rows: IntArray,
    a: FloatArray,
    b: FloatArray,
    fa: FloatArray,
    fb: FloatArray,
) -> FloatArray:
    """All roots at once: a secant through both ends and a bisection in turn, to neighbouring floating-point numbers."""
    a, b, fa, fb = a.copy(), b.copy(), fa.copy(), fb.copy()
    for step in range(120):
        open_ = np.flatnonzero((b - a > 2e-15 * b) & (fa != 0) & (fb != 0))
        if not open_.size:
            break
        low, high = a[open_], b[open_]
        share = 0.5 if step % 3 == 2 else np.clip(fa[open_] / (fa[open_] - fb[open_]), 1e-3, 1 - 1e-3)
        t = low + share * (high - low)
        f = measure(loops(t))[rows[open_], np.arange(open_.size)]
        left = np.sign(f) == np.sign(fa[open_])
        a[open_], fa[open_] = np.where(left, t, low), np.where(left, f, fa[open_])
        b[open_], fb[open_] = np.where(left, high, t), np.where(left, fb[open_], f)
    return np.asarray(np.where(abs(fa) < abs(fb), a, b))
