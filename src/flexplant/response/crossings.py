"""Where loop gains known only by evaluation cross one and the negative real axis: a grid refined where they turn, then roots.

For loops too large for the eigenvalue pencils of `level`. A crossing is found where the refined grid shows a change of sign, and
is then exact to round-off; where a loop turns back just before a crossing, its turning point is followed to see whether it
passes. What can be missed: two crossings between neighbouring points whose middle shows no bend, far from a turning point.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

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
TURNING = 0.2  # nearness to a crossing at which a turning point is followed: four times what an interval may bend
SETTLED = 1e-9  # relative length of an interval in which a parabola is flat to round-off
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
GAIN, PHASE = 0, 1  # kinds of crossings
NEIGHBOURS = 2e-15  # relative length of an interval that is not divided further
MOST_STEPS = 200
REAL = 1e-6  # largest imaginary part, relative, of a crossing of the real axis; a pole between two points has more


def refined_grid(response: Loops, hz: FloatArray, judged: int | None = None) -> tuple[FloatArray, ComplexArray]:
    """(nf,) ascending Hz and (r, nf) values: intervals of `hz` are divided until every row is nearly straight within each.

    judged: how many rows, from the first, decide; all by default.
    """
    values, rows = response(hz), slice(judged)
    a, b, va, vb = hz[:-1], hz[1:], values[rows, :-1], values[rows, 1:]
    found = [(hz, values)]
    size = hz.size
    while a.size and size + a.size <= MOST_POINTS:
        middle = a + SHARE * (b - a)
        every = response(middle)
        found.append((middle, every))
        vm = every[rows]
        size += middle.size
        bent = (abs(vm - va - SHARE * (vb - va)) > BEND * abs(vm)).any(axis=0) & (b - a > SHORTEST * b)
        a, b = np.r_[a[bent], middle[bent]], np.r_[middle[bent], b[bent]]
        va, vb = np.hstack([va[:, bent], vm[:, bent]]), np.hstack([vm[:, bent], vb[:, bent]])
    points = np.concatenate([part for part, _ in found])
    order = np.argsort(points)
    return points[order], np.concatenate([part for _, part in found], axis=1)[:, order]


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


class Crossings(NamedTuple):
    """Ascending Hz where |L| = 1, and where L is real and negative, of one loop, and its values there."""

    unit_hz: FloatArray
    at_unit: ComplexArray
    phase_hz: FloatArray
    at_phase: ComplexArray


def crossings(loops: Loops, hz: FloatArray, values: ComplexArray) -> list[Crossings]:
    """All crossings of each loop, from its values (r, nf) on a grid: gains and phases are closed in on together."""
    sides = np.stack([_measured(values, np.full(values.shape, kind)) for kind in (GAIN, PHASE)])
    kind, row, start = np.nonzero(np.sign(sides[:, :, :-1]) * np.sign(sides[:, :, 1:]) < 0)
    brackets = np.stack([hz[start], hz[start + 1], sides[kind, row, start], sides[kind, row, start + 1]])
    own, of, turned = _beyond_turning_points(loops, hz, sides, values)
    kind, row, brackets = np.r_[kind, own], np.r_[row, of], np.hstack([brackets, turned])
    touching = np.nonzero(sides == 0)
    roots = _closed_in(loops, kind, row, (brackets[0], brackets[1]), (brackets[2], brackets[3]))
    kind, row, roots = (np.r_[x, y] for x, y in zip((kind, row, roots), (*touching[:2], hz[touching[2]]), strict=True))
    at = loops(roots)[row, np.arange(roots.size)] if roots.size else np.zeros(0, dtype=complex)
    keep = (kind == GAIN) | ((at.real < 0) & (abs(at.imag) <= REAL * abs(at)))
    found = []
    for r in range(len(values)):
        mine = [np.flatnonzero(keep & (row == r) & (kind == which)) for which in (GAIN, PHASE)]
        mine = [which[np.argsort(roots[which])] for which in mine]
        found.append(Crossings(roots[mine[0]], at[mine[0]], roots[mine[1]], at[mine[1]]))
    return found


def _beyond_turning_points(
    loops: Loops, hz: FloatArray, sides: FloatArray, values: ComplexArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Kind, row and brackets (4, nb), as (x1, x2, f1, f2), of crossings about extrema that pass zero between grid points.

    Where the measure turns back before zero at a grid point, closer than `TURNING` (of |L| for the real axis, where that is
    negative), golden section follows it between the two neighbours, all at once, until it is beyond zero or cannot get there.
    """
    size = abs(sides)
    close = size < TURNING * np.stack([np.ones(values.shape), np.where(values.real < 0, abs(values), 0.0)])
    least = (size[:, :, 1:-1] <= size[:, :, :-2]) & (size[:, :, 1:-1] <= size[:, :, 2:])
    sign = np.sign(sides)
    one_side = (sign[:, :, 1:-1] == sign[:, :, :-2]) & (sign[:, :, 1:-1] == sign[:, :, 2:])
    kind, row, at = np.nonzero(least & one_side & close[:, :, 1:-1])
    side = sign[kind, row, at + 1]

    def beyond(x: FloatArray, which: IntArray) -> FloatArray:
        return np.asarray(side[which] * _measured(loops(x)[row[which], np.arange(x.size)], kind[which]))

    ends = hz[at], hz[at + 2], size[kind, row, at], size[kind, row, at + 2]
    x, f = _lowest(beyond, *ends)
    hit = np.flatnonzero(f < 0)
    left, right = (
        np.stack(part)[:, hit] for part in ((ends[0], x, side * ends[2], side * f), (x, ends[1], side * f, side * ends[3]))
    )
    return np.tile(kind[hit], 2), np.tile(row[hit], 2), np.hstack([left, right])


def _lowest(
    function: Callable[[FloatArray, IntArray], FloatArray], a: FloatArray, b: FloatArray, fa: FloatArray, fb: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(x, value) of a local minimum within each [a, b], or of a point below zero, or of one above a minimum that stays positive.

    Golden section of all at once. The minimum of a parabola lies less than 1.5 (max(fa, fb) - f) below the lowest value f seen.
    """
    open_, found, lowest = np.arange(a.size), a.copy(), fa.copy()
    x1, x2 = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
    f1, f2 = (function(x, open_) if open_.size else x for x in (x1, x2))
    while open_.size:
        f = np.minimum(f1, f2)
        found[open_], lowest[open_] = np.where(f1 <= f2, x1, x2), f
        on = (f >= 0) & (2 * (np.maximum(fa, fb) - f) > f) & (b - a > SETTLED * b)
        open_ = open_[on]
        a, b, fa, fb, x1, x2, f1, f2 = (array[on] for array in (a, b, fa, fb, x1, x2, f1, f2))
        left = f1 <= f2
        a, fa, b, fb = np.where(left, a, x1), np.where(left, fa, f1), np.where(left, x2, b), np.where(left, f2, fb)
        x = np.where(left, b - GOLDEN * (b - a), a + GOLDEN * (b - a))
        f = function(x, open_) if open_.size else x
        x1, x2, f1, f2 = np.where(left, x, x2), np.where(left, x1, x), np.where(left, f, f2), np.where(left, f1, f)
    return found, lowest


def _measured(values: ComplexArray, kind: IntArray) -> FloatArray:
    """log |L| or the imaginary part: what changes its sign at a crossing."""
    return np.asarray(np.where(kind == GAIN, np.log(np.maximum(abs(values), 1e-300)), values.imag))


def _closed_in(
    loops: Loops, kind: IntArray, row: IntArray, ends: tuple[FloatArray, FloatArray], sides: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """All roots at once, to neighbouring floating-point numbers: inverse quadratic interpolation where it is safe, or bisection.

    Source: Chandrupatla 1997. Only the roots that are still open are evaluated.
    """
    roots, open_ = np.empty(kind.size), np.arange(kind.size)
    x1, x2, f1, f2 = *ends, *sides
    share = np.full(kind.size, 0.5)
    for _ in range(MOST_STEPS):
        best = np.where(abs(f1) < abs(f2), x1, x2)
        done = (abs(x2 - x1) <= NEIGHBOURS * abs(best)) | (f1 == 0) | (f2 == 0)
        roots[open_[done]] = best[done]
        if done.all():
            return roots
        open_, share = open_[~done], share[~done]
        x1, x2, f1, f2 = (array[~done] for array in (x1, x2, f1, f2))
        x = x1 + share * (x2 - x1)
        f = _measured(loops(x)[row[open_], np.arange(open_.size)], kind[open_])
        same = np.sign(f) == np.sign(f1)
        x3, f3 = np.where(same, x1, x2), np.where(same, f1, f2)
        x2, f2 = np.where(same, x2, x1), np.where(same, f2, f1)
        x1, f1 = x, f
        share = _next_share((x1, x2, x3), (f1, f2, f3))
    roots[open_] = np.where(abs(f1) < abs(f2), x1, x2)
    return roots


def _next_share(x: tuple[FloatArray, ...], f: tuple[FloatArray, ...]) -> FloatArray:
    """Where to divide [x1, x2], from x1: at the inverse parabola's root if it is monotonic there, in the middle otherwise."""
    (x1, x2, x3), (f1, f2, f3) = x, f
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        xi, phi, alpha = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2), (x3 - x1) / (x2 - x1)
        safe = (1 - np.sqrt(np.maximum(1 - xi, 0.0)) < phi) & (phi < np.sqrt(np.maximum(xi, 0.0)))
        root = f1 / (f1 - f2) * f3 / (f3 - f2) - alpha * f1 / (f3 - f1) * f2 / (f2 - f3)
        least = np.minimum(0.5 * NEIGHBOURS * abs(x1) / abs(x2 - x1), 0.5)
    return np.asarray(np.clip(np.where(safe & np.isfinite(root), root, 0.5), least, 1 - least))
