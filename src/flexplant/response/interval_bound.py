"""Largest value of a gain over all frequencies, bracketed by interval bounds: branch and bound instead of a frequency grid.

On an interval [a, b] of the frequency variable t a twice differentiable matrix function G differs from the straight line through
its end values by at most (b - a)^2 / 8 sup |G''|, and the norm of a straight line is largest at an end (it is convex), so

    sup sigma_max(G) <= max(sigma_max(G(a)), sigma_max(G(b))) + (b - a)^2 / 8 sup |G''|.

Intervals whose bound exceeds the largest value seen are split. The bound is quadratic in the length, so a peak is closed in on
in a number of steps that grows with the logarithm of its sharpness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.optimize import minimize_scalar

from flexplant.model.arrays import FloatArray, IntArray

PIECES = 8  # into which an interval is split at most at a time
BUDGET = 2_000_000  # intervals after which the search stops with the bracket it has
SHORTEST = 4e-16  # relative length at which an interval cannot be split


class Axis(Protocol):
    """A part of the frequency axis in a variable t, and a matrix function on it."""

    @property
    def points(self) -> FloatArray:
        """Ascending t that cover the axis, at the places where peaks are expected."""

    def gains(self, t: FloatArray) -> FloatArray:
        """(nt,) largest singular value."""

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


def bracket(axes: Sequence[Axis], known: Bracket, tolerance: float, budget: int = BUDGET) -> Bracket:
    """The peak over all axes to a relative tolerance, from a `known` value; round-off of the gains is not part of the bracket."""
    starts = [(axis.points, axis.gains(axis.points)) for axis in axes]
    for k, (t, values) in enumerate(starts):
        known = _higher(known, k, t, values)
    found = Bracket(known.lower, known.lower, known.axis, known.t)
    for k, (axis, (t, values)) in enumerate(zip(axes, starts, strict=True)):
        found = _closed_in(axis, k, np.stack([t[:-1], t[1:], values[:-1], values[1:]]), found, tolerance, budget)
    return found


def polished(axes: Sequence[Axis], found: Bracket) -> Bracket:
    """The lower bound raised to the top of the peak that it lies on: between points on both sides that are lower by 1e-4."""
    axis, t = axes[found.axis], found.t
    widths = t * 2.0 ** np.arange(-46.0, 0.0)
    sides = np.maximum(axis.gains(t - widths), axis.gains(t + widths))
    lower = np.flatnonzero(sides < (1 - 1e-4) * found.lower)
    if not lower.size:
        return found
    width = float(widths[lower[0]])
    top = minimize_scalar(
        lambda x: -axis.gains(np.array([x]))[0], bounds=(t - width, t + width), method="bounded", options={"xatol": 1e-7 * width}
    )
    higher = _higher(found, found.axis, np.array([float(top.x)]), np.array([-float(top.fun)]))
    return replace(higher, upper=max(found.upper, higher.lower))


def _higher(known: Bracket, axis: int, t: FloatArray, values: FloatArray) -> Bracket:
    if not values.size or values.max() <= known.lower * (1 + 1e-13):
        return known
    return Bracket(float(values.max()), max(known.upper, float(values.max())), axis, float(t[values.argmax()]), known.intervals)


def _closed_in(axis: Axis, number: int, parts: FloatArray, found: Bracket, tolerance: float, budget: int) -> Bracket:
    """The bracket widened by one axis; parts (4, n): a, b and the gains there."""
    upper, count = found.upper, found.intervals
    while parts.size:
        a, b, ends = parts[0], parts[1], np.maximum(parts[2], parts[3])
        curvature, pole = axis.curvatures(a, b)
        excess = (b - a) ** 2 / 8 * curvature
        count += a.size
        level = found.lower * (1 + tolerance)
        unsettled = (ends + excess > level) & (b - a > SHORTEST * b) & (count <= budget)
        upper = max(upper, float((ends + excess)[~unsettled].max(initial=0.0)))
        wanted = np.sqrt(excess / np.maximum(level - ends, 1e-300))[unsettled]
        pieces = np.clip(np.ceil(wanted), 2, PIECES).astype(int)
        parts, t, values = _split(axis, parts[:, unsettled], pieces, pole[unsettled])
        found = _higher(found, number, t, values)
    return Bracket(found.lower, max(upper, found.lower), found.axis, found.t, count)


def _split(axis: Axis, parts: FloatArray, pieces: IntArray, pole: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Each interval in its number of pieces, (4, n), and the new points with their gains."""
    if not pieces.size:
        return np.zeros((4, 0)), np.zeros(0), np.zeros(0)
    owner = np.repeat(np.arange(pieces.size), pieces + 1)
    first = np.cumsum(pieces + 1) - (pieces + 1)
    step = np.arange(owner.size) - first[owner]
    a, b = parts[0], parts[1]
    t = np.clip(axis.between(a[owner], b[owner], step / pieces[owner], pole[owner]), a[owner], b[owner])
    gain = np.empty(t.size)
    last = first + pieces
    t[first], t[last], gain[first], gain[last] = parts
    inner = np.ones(t.size, dtype=bool)
    inner[first] = inner[last] = False
    gain[inner] = axis.gains(t[inner])
    left = np.ones(t.size, dtype=bool)
    left[last] = False
    left = np.flatnonzero(left)
    left = left[t[left + 1] > t[left]]
    return np.stack([t[left], t[left + 1], gain[left], gain[left + 1]]), t[inner], gain[inner]
