"""Modal plants for the interval bounds of `interval_bound`: gains by modal sums, curvatures by the distance of every pole.

A mode is N(t) / ((t - z1)(t - z2)) times a constant row, t = w below and t = 1 / w above a frequency, z1 and z2 the places of its
poles in t. Over an interval each factor is bounded by its distance d1, d2 from the pole, so |(N H)''| is at most:

    |N| H2 + 2 |N'| H1 + |N''| H0,   H0 = 1 / (d1 d2),  H1 = H0 (1/d1 + 1/d2),  H2 = 2 H0 (1/d1^2 + 1/(d1 d2) + 1/d2^2).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flexplant.model.arrays import FloatArray, IntArray
from flexplant.numerics.compiled import Kernel
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import output_rows
from flexplant.response.interval_bound import towards
from flexplant.response.modal_sum import ModalResponse
from flexplant.response.singular import largest_singular_values

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
CHUNK = 1 << 20  # entries of the tables that numpy takes at a time
TOGETHER = 16  # intervals that share the bound of what is far from them,
AWAY = 4.0  # farther than this times their length together


def _curvature_loops(a, b, place, first, second, constant, rate, high, bound, pole):  # type: ignore[no-untyped-def]
    """bound (nt,) and the largest contributor pole (nt,); place, first, second: |Re z|, |Im z1|, |Im z2| of each mode in t.

    The bounds of modes far from TOGETHER neighbouring intervals hold for all of these.
    """
    largest = np.empty(TOGETHER)
    for start in range(0, a.size, TOGETHER):
        stop = min(start + TOGETHER, a.size)
        low, top = a[start:stop].min(), b[start:stop].max()
        far, farthest = 0.0, -1.0
        largest[:], bound[start:stop], nearby = -1.0, 0.0, 0
        for i in range(place.size):
            gap = max(low - place[i], place[i] - top, 0.0)
            alone = gap < AWAY * (top - low) or stop == start + 1
            for k in range(start, stop if alone else start + 1):
                begin, t = (a[k], b[k]) if alone else (low, top)
                gap = max(begin - place[i], place[i] - t, 0.0)
                reach, p, r = begin + place[i], constant[i], rate[i]
                u = 1 / np.sqrt(gap * gap + first[i] * first[i])
                v = 1 / np.sqrt(reach * reach + second[i] * second[i])
                if high:
                    n0, n1, n2 = t * np.sqrt(p * p * t * t + r * r), np.sqrt(4 * p * p * t * t + r * r), 2 * p
                else:
                    n0, n1, n2 = np.sqrt(p * p + r * r * t * t), r, 0.0
                term = u * v * (2 * n0 * (u * u + u * v + v * v) + 2 * n1 * (u + v) + n2)
                if alone:
                    bound[k] += term
                    if term > largest[k - start]:
                        largest[k - start], pole[k] = term, i
                else:
                    far += term
                    if term > farthest:
                        farthest, nearby = term, i
        for k in range(start, stop):
            bound[k] += far
            if farthest > largest[k - start]:
                pole[k] = nearby


def _curvature_numpy(
    a: FloatArray,
    b: FloatArray,
    place: FloatArray,
    first: FloatArray,
    second: FloatArray,
    constant: FloatArray,
    rate: FloatArray,
    high: bool,
    bound: FloatArray,
    pole: IntArray,
) -> None:
    rows = max(CHUNK // max(place.size, 1), 1)
    for start in range(0, a.size, rows):
        at = slice(start, start + rows)
        low, t = a[at, None], b[at, None]
        u = 1 / np.hypot(np.maximum(np.maximum(low - place, place - t), 0.0), first)
        v = 1 / np.hypot(low + place, second)
        n0, n1, n2 = np.hypot(constant, rate * t), rate, np.zeros_like(rate)
        if high:
            n0, n1, n2 = t * np.hypot(constant * t, rate), np.hypot(2 * constant * t, rate), 2 * constant
        term = u * v * (2 * n0 * (u * u + u * v + v * v) + 2 * n1 * (u + v) + n2)
        bound[at], pole[at] = term.sum(axis=1), term.argmax(axis=1)


curvature = Kernel(_curvature_loops, _curvature_numpy)


def _entry_loops(a, b, place, first, second, position, velocity, high, out):  # type: ignore[no-untyped-def]
    """out (nt, ne): bounds of every entry; those of modes far from TOGETHER neighbouring intervals hold for all of these."""
    far = np.empty(out.shape[1])
    for start in range(0, a.size, TOGETHER):
        stop = min(start + TOGETHER, a.size)
        low, top = a[start:stop].min(), b[start:stop].max()
        far[:] = 0.0
        for i in range(place.size):
            gap = max(low - place[i], place[i] - top, 0.0)
            alone = gap < AWAY * (top - low) or stop == start + 1
            for k in range(start, stop if alone else start + 1):
                begin, t = (a[k], b[k]) if alone else (low, top)
                gap = max(begin - place[i], place[i] - t, 0.0)
                u = 1 / np.sqrt(gap * gap + first[i] * first[i])
                v = 1 / np.sqrt((begin + place[i]) ** 2 + second[i] * second[i])
                h0, h1, h2 = u * v, u * v * (u + v), 2 * u * v * (u * u + u * v + v * v)
                still = t * t * h2 + 4 * t * h1 + 2 * h0 if high else h2
                moving = t * h2 + 2 * h1
                for e in range(position.shape[1]):
                    term = still * position[i, e]
                    if velocity.shape[1]:
                        term += moving * velocity[i, e]
                    if alone:
                        out[k, e] += term
                    else:
                        far[e] += term
        for k in range(start, stop):
            for e in range(far.size):
                out[k, e] += far[e]


def _entry_numpy(
    a: FloatArray,
    b: FloatArray,
    place: FloatArray,
    first: FloatArray,
    second: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    high: bool,
    out: FloatArray,
) -> None:
    """The same with every mode's bound for every interval by itself."""
    rows = max(CHUNK // max(place.size, 1), 1)
    for start in range(0, a.size, rows):
        at = slice(start, start + rows)
        begin, t = a[at, None], b[at, None]
        gap = np.maximum(np.maximum(begin - place, place - t), 0.0)
        u, v = 1 / np.hypot(gap, first), 1 / np.hypot(begin + place, second)
        h0, h1, h2 = u * v, u * v * (u + v), 2 * u * v * (u * u + u * v + v * v)
        out[at] += (t**2 * h2 + 4 * t * h1 + 2 * h0 if high else h2) @ position
        if velocity.shape[1]:
            out[at] += (t * h2 + 2 * h1) @ velocity


entry_curvature = Kernel(_entry_loops, _entry_numpy)


@dataclass(frozen=True, eq=False)
class ModalAxis:
    """One part of the axis of a plant whose modes are all flexible and damped: t = w in [0, edge], or t = 1 / w in [0, 1 / edge].

    The edge lies above every resonance.
    """

    plant: ModalPlant
    edge: float
    high: bool

    def __post_init__(self) -> None:
        plant, omega, zeta = self.plant, self.plant.omega, self.plant.zeta
        position, velocity, direct = output_rows(plant)
        root = np.sqrt(abs((zeta - 1) * (zeta + 1)))
        swinging = zeta < 1
        forced = np.linalg.norm(plant.shape_in, axis=1)
        # in 1 / w the poles lie at i / p, and 1 / omega^2 goes into the numerators
        scale = 1 / omega**2 if self.high else np.ones_like(omega)
        tables = {
            "place": np.where(swinging, root, 0.0) * omega * scale,
            "first": np.where(swinging, zeta, 1 / (zeta + root)) * omega * scale,
            "second": np.where(swinging, zeta, zeta + root) * omega * scale,
            "constant": np.linalg.norm(position, axis=0) * forced * scale,
            "rate": np.linalg.norm(velocity, axis=0) * forced * scale,
            "at_infinity": direct,
        }
        object.__setattr__(self, "_tables", {name: np.ascontiguousarray(table) for name, table in tables.items()})

    _tables: dict[str, FloatArray] = field(init=False, repr=False)

    @property
    def points(self) -> FloatArray:
        """The ends of the axis; below the edge also every resonance and the place of every pole."""
        if self.high:
            return np.array([0.0, 1 / self.edge])
        omega, zeta = self.plant.omega, self.plant.zeta
        peaks = omega * np.sqrt(np.maximum(1 - 2 * zeta**2, 0.0))
        return np.unique(np.r_[0.0, peaks, self._tables["place"], self.edge])

    def responses(self, t: FloatArray) -> ComplexArray:
        """(ny, nu, nt) the plant at t."""
        out = np.empty((len(self.plant.outputs), len(self.plant.inputs), t.size), dtype=complex)
        finite = t > 0 if self.high else np.ones(t.size, dtype=bool)
        if finite.any():
            omega = 1 / t[finite] if self.high else t
            out[:, :, finite] = self._response(omega)
        out[:, :, ~finite] = self._tables["at_infinity"][:, :, None]
        return out

    @cached_property
    def _response(self) -> ModalResponse:
        return ModalResponse(self.plant)

    def gains(self, t: FloatArray) -> FloatArray:
        """(nt,) largest singular value."""
        return largest_singular_values(self.responses(t))

    def curvatures(self, a: FloatArray, b: FloatArray) -> tuple[FloatArray, IntArray]:
        """Sum over the modes of the bounds of their second derivatives, and the mode that adds most."""
        bound, pole = np.zeros(a.size), np.zeros(a.size, dtype=np.int64)
        t = self._tables
        curvature(a, b, t["place"], t["first"], t["second"], t["constant"], t["rate"], self.high, bound, pole)
        return bound, pole

    @property
    def pole_places(self) -> tuple[FloatArray, FloatArray]:
        """(n,) place of each mode's pole along the axis, and its distance from the axis."""
        return self._tables["place"], self._tables["first"]

    def entry_curvatures(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """(nt, ny, nu) bounds of every entry's second derivative over each interval."""
        t, out = self._tables, np.zeros((a.size, len(self.plant.outputs) * len(self.plant.inputs)))
        entry_curvature(a, b, t["place"], t["first"], t["second"], *self._residues, self.high, out)
        return out.reshape(a.size, len(self.plant.outputs), -1)

    @cached_property
    def _residues(self) -> tuple[FloatArray, FloatArray]:
        """(modes, ny nu) sizes of the entries of every mode: of position rows, and of velocity rows (no entries without them)."""
        scale = 1 / self.plant.omega**2 if self.high else np.ones(self.plant.n_modes)
        forced = (abs(self.plant.shape_in) * scale[:, None])[:, None, :]
        position, velocity, _ = output_rows(self.plant)
        both = [(abs(rows.T)[:, :, None] * forced).reshape(self.plant.n_modes, -1) for rows in (position, velocity)]
        return both[0], both[1] if velocity.any() else both[1][:, :0]

    def between(self, a: FloatArray, b: FloatArray, fraction: FloatArray, pole: IntArray) -> FloatArray:
        """Denser towards the mode's pole."""
        return towards(a, b, fraction, self._tables["place"][pole], self._tables["first"][pole])
