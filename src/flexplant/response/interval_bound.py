"""Largest value of a gain over all frequencies, bracketed by interval bounds: branch and bound instead of a frequency grid.

On an interval [a, b] of the frequency variable t a twice differentiable matrix function G differs from the straight line through
its end values by at most (b - a)^2 / 8 sup |G''|, and the norm of a straight line is largest at an end (it is convex), so

    sup sigma_max(G) <= max(sigma_max(G(a)), sigma_max(G(b))) + (b - a)^2 / 8 sup |G''|.

Intervals whose bound exceeds the largest value seen are split. Functions that differ by constants (S, T = I - S and S - I / 2 of
a loop) share the bound and its intervals. The bound is quadratic in the length, so a peak is closed in on
in a number of steps that grows with the logarithm of its sharpness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from flexplant.model.arrays import FloatArray, IntArray

PIECES = 8  # into which an interval is split at most at a time
BUDGET = 2_000_000  # intervals after which the search stops with the bracket it has
SHORTEST = 4e-16  # relative length at which an interval cannot be split
ROUNDS, AMONG = 7, 17  # of closing in on the top of a peak: eight times nearer in each, which leaves round-off of 1e-4


class Axis(Protocol):
    """A part of the frequency axis in a variable t, and a matrix function on it."""

    @property
    def points(self) -> FloatArray:
        """Ascending t that cover the axis, at the places where peaks are expected."""

    def gains(self, t: FloatArray) -> FloatArray:
        """(nt,) largest singular value; (k, nt) of several functions that differ by constants, and so bend alike."""

    def curvatures(self, a: FloatArray, b: FloatArray) -> tuple[FloatArray, IntArray]:
        """(nt,) bound of the norm of the second derivative over each interval (inf: none), and the pole that matters most."""

    def between(self, a: FloatArray, b: FloatArray, fraction: FloatArray, pole: IntArray) -> FloatArray:
        """(nt,) points at a fraction of each interval, denser towards the pole."""


@dataclass(frozen=True)
class Bracket:
    """lower = gain at t of axis number `axis`; no gain anywhere exceeds upper. intervals: how many were bounded."""

    lower: float
    upper: float
    axis: int
    t: float
    intervals: int = 0


def towards(a: FloatArray, b: FloatArray, fraction: FloatArray, place: FloatArray, width: FloatArray) -> FloatArray:
    """Points equally spaced in asinh((t - place) / width): in proportion to the distance from a pole, width off the axis."""
    low, high = np.arcsinh((a - place) / width), np.arcsinh((b - place) / width)
    return np.asarray(place + width * np.sinh(low + fraction * (high - low)))


def bracket(axes: Sequence[Axis], tolerance: float, budget: int = BUDGET) -> list[Bracket]:
    """The peak over all axes of each gain to a relative tolerance; round-off of the gains is not part of the brackets."""
    starts = [(axis.points, np.atleast_2d(axis.gains(axis.points))) for axis in axes]
    found = [Bracket(0.0, 0.0, 0, 0.0)] * starts[0][1].shape[0]
    for k, (t, values) in enumerate(starts):
        found = [_higher(known, k, t, row) for known, row in zip(found, values, strict=True)]
    found = [replace(known, upper=known.lower) for known in found]
    for k, (axis, (t, values)) in enumerate(zip(axes, starts, strict=True)):
        found = _closed_in(axis, k, np.vstack([t[:-1], t[1:], values[:, :-1], values[:, 1:]]), found, tolerance, budget)
    return found


def polished(axes: Sequence[Axis], found: Sequence[Bracket]) -> list[Bracket]:
    """The lower bounds raised to the tops of the peaks that they lie on."""
    return [_topped(axes[one.axis], one, k) for k, one in enumerate(found)]


def _topped(axis: Axis, found: Bracket, row: int) -> Bracket:
    """Closing in from points on both sides that are lower by 1e-4: between the neighbours of the highest of a few points."""
    widths = found.t * 2.0 ** np.arange(-46.0, 0.0)
    sides = np.atleast_2d(axis.gains(np.r_[found.t - widths, found.t + widths]))[row].reshape(2, -1).max(axis=0)
    lower = np.flatnonzero(sides < (1 - 1e-4) * found.lower)
    if not lower.size:
        return found
    low, high, best = found.t - widths[lower[0]], found.t + widths[lower[0]], found
    for _ in range(ROUNDS):
        t = np.linspace(low, high, AMONG)
        values = np.atleast_2d(axis.gains(t))[row]
        top = int(values.argmax())
        if values[top] > best.lower:
            best = replace(best, lower=float(values[top]), t=float(t[top]))
        low, high = float(t[max(top - 1, 0)]), float(t[min(top + 1, AMONG - 1)])
    return replace(best, upper=max(found.upper, best.lower))


def _higher(known: Bracket, axis: int, t: FloatArray, values: FloatArray) -> Bracket:
    if not values.size or values.max() <= known.lower * (1 + 1e-13):
        return known
    return Bracket(float(values.max()), max(known.upper, float(values.max())), axis, float(t[values.argmax()]), known.intervals)


def _closed_in(axis: Axis, number: int, parts: FloatArray, found: list[Bracket], tolerance: float, budget: int) -> list[Bracket]:
    """The brackets widened by one axis; parts (2 + 2 k, n): a, b and the k gains at a, then at b."""
    upper, count, size = np.array([known.upper for known in found]), found[0].intervals, len(found)
    while parts.size:
        a, b, ends = parts[0], parts[1], np.maximum(parts[2 : 2 + size], parts[2 + size :])
        curvature, pole = axis.curvatures(a, b)
        excess = (b - a) ** 2 / 8 * curvature
        count += a.size
        level = np.array([[known.lower * (1 + tolerance)] for known in found])
        unsettled = (ends + excess > level).any(axis=0) & (b - a > SHORTEST * b) & (count <= budget)
        upper = np.maximum(upper, (ends + excess)[:, ~unsettled].max(axis=1, initial=0.0))
        wanted = np.sqrt(excess / np.maximum((level - ends).min(axis=0), 1e-300))[unsettled]
        pieces = np.clip(np.ceil(wanted), 2, PIECES).astype(int)
        parts, t, values = _split(axis, parts[:, unsettled], pieces, pole[unsettled])
        found = [_higher(known, number, t, row) for known, row in zip(found, values, strict=True)]
    tops = zip(found, upper, strict=True)
    return [Bracket(one.lower, max(float(top), one.lower), one.axis, one.t, count) for one, top in tops]


def _split(axis: Axis, parts: FloatArray, pieces: IntArray, pole: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Each interval in its number of pieces, in the form of `parts`, and the new points with their gains."""
    size = (parts.shape[0] - 2) // 2
    if not pieces.size:
        return np.zeros((2 + 2 * size, 0)), np.zeros(0), np.zeros((size, 0))
    owner = np.repeat(np.arange(pieces.size), pieces + 1)
    first = np.cumsum(pieces + 1) - (pieces + 1)
    step = np.arange(owner.size) - first[owner]
    a, b = parts[0], parts[1]
    t = np.clip(axis.between(a[owner], b[owner], step / pieces[owner], pole[owner]), a[owner], b[owner])
    gain = np.empty((size, t.size))
    last = first + pieces
    t[first], t[last], gain[:, first], gain[:, last] = a, b, parts[2 : 2 + size], parts[2 + size :]
    inner = np.ones(t.size, dtype=bool)
    inner[first] = inner[last] = False
    gain[:, inner] = np.atleast_2d(axis.gains(t[inner]))
    left = np.ones(t.size, dtype=bool)
    left[last] = False
    left = np.flatnonzero(left)
    left = left[t[left + 1] > t[left]]
    return np.vstack([t[left], t[left + 1], gain[:, left], gain[:, left + 1]]), t[inner], gain[:, inner]
