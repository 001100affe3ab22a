"""Modal plants for the interval bounds of `interval_bound`: gains by modal sums, curvatures by the distance of every pole.

A mode is N(t) / ((t - z1)(t - z2)) times a constant row, t = w below and t = 1 / w above a frequency, z1 and z2 the places of its
poles in t. Over an interval each factor is bounded by its distance d1, d2 from the pole, so |(N H)''| is at most:

    |N| H2 + 2 |N'| H1 + |N''| H0,   H0 = 1 / (d1 d2),  H1 = H0 (1/d1 + 1/d2),  H2 = 2 H0 (1/d1^2 + 1/(d1 d2) + 1/d2^2).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flexplant.model.arrays import FloatArray, IntArray
from flexplant.numerics.compiled import Kernel
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import output_rows
from flexplant.response.interval_bound import towards
from flexplant.response.modal_sum import modal_response
from flexplant.response.singular import largest_singular_values

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
CHUNK = 1 << 20  # entries of the tables that numpy takes at a time


def _curvature_loops(a, b, place, first, second, constant, rate, high, bound, pole):  # type: ignore[no-untyped-def]
    """bound (nt,) and the largest contributor pole (nt,); place, first, second: |Re z|, |Im z1|, |Im z2| of each mode in t."""
    for k in range(a.size):
        total, largest = 0.0, -1.0
        for i in range(place.size):
            gap = max(a[k] - place[i], place[i] - b[k], 0.0)
            far = a[k] + place[i]
            u = 1 / np.sqrt(gap * gap + first[i] * first[i])
            v = 1 / np.sqrt(far * far + second[i] * second[i])
            p, r, t = constant[i], rate[i], b[k]
            if high:
                n0, n1, n2 = t * np.sqrt(p * p * t * t + r * r), np.sqrt(4 * p * p * t * t + r * r), 2 * p
            else:
                n0, n1, n2 = np.sqrt(p * p + r * r * t * t), r, 0.0
            term = u * v * (2 * n0 * (u * u + u * v + v * v) + 2 * n1 * (u + v) + n2)
            total += term
            if term > largest:
                largest = term
                pole[k] = i
        bound[k] = total


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
            out[:, :, finite] = modal_response(self.plant, omega / (2 * np.pi))
        out[:, :, ~finite] = self._tables["at_infinity"][:, :, None]
        return out

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
        out = np.zeros((a.size, len(self.plant.outputs) * len(self.plant.inputs)))
        rows = max(CHUNK // max(self.plant.n_modes, 1), 1)
        for start in range(0, a.size, rows):
            at = slice(start, start + rows)
            for residues, bound in self._entry_tables(a[at], b[at]):
                out[at] += bound @ residues
        return out.reshape(a.size, len(self.plant.outputs), -1)

    def _entry_tables(self, a: FloatArray, b: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """(modes, ny nu) residues, and the bounds (nt, modes) that multiply them: of position rows, then of velocity rows."""
        tables, t = self._tables, b[:, None]
        gap = np.maximum(np.maximum(a[:, None] - tables["place"], tables["place"] - t), 0.0)
        u, v = 1 / np.hypot(gap, tables["first"]), 1 / np.hypot(a[:, None] + tables["place"], tables["second"])
        H0, H1, H2 = u * v, u * v * (u + v), 2 * u * v * (u * u + u * v + v * v)
        scale = 1 / self.plant.omega**2 if self.high else np.ones(self.plant.n_modes)
        for power, rows in enumerate(output_rows(self.plant)[:2]):
            if not rows.any():
                continue
            residues = abs(rows.T)[:, :, None] * (abs(self.plant.shape_in) * scale[:, None])[:, None, :]
            order = 2 - power if self.high else power  # the numerator is t^order
            bound = t**order * H2 + (2 * order) * t ** max(order - 1, 0) * H1 + 2.0 * (order == 2) * H0
            yield residues.reshape(residues.shape[0], -1), bound

    def between(self, a: FloatArray, b: FloatArray, fraction: FloatArray, pole: IntArray) -> FloatArray:
        """Denser towards the mode's pole."""
        return towards(a, b, fraction, self._tables["place"][pole], self._tables["first"][pole])
