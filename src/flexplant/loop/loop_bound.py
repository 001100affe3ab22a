"""Closed loops for the interval bounds of `response.interval_bound`, and their stability by a winding number, without a grid.

With M(t) v = E, z = Y(t) v (see `bordered`), an interval [a, b] of length L with middle m, and entrywise bounds M2, Y2 of the
second derivatives over it, N(t) = M(m)^-1 M(t) = I + Q obeys, by its straight line and its remainder,
D = |M(m)^-1 (M(b) - M(a))|,

    |Q| <= P = D / 2 + L^2 W / 4,   |N'| <= N1 = D / L + L W / 2,   |N''| <= W = |M(m)^-1| M2.

Where the spectral radius of P is below one no pole lies on the interval, and with X = (I - P)^-1 and v(m) = M(m)^-1 E

    |v| <= V0 = X |v(m)|,   |v'| <= V1 = X N1 V0,   |v''| <= V2 = X (W V0 + 2 N1 V1),   |z''| <= |R| (Y2 V0 + 2 Y1 V1 + Y0 V2).

Entrywise bounds do not depend on the units of the channels. |log det N| <= -log det(I - P): where that is below pi the phase of
det M between a and b is known, and the sum over the whole axis counts the poles in the right half plane.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flexplant.loop.bordered import Bordered, ComplexArray
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.response.interval_bound import towards
from flexplant.response.modal_bound import ModalAxis
from flexplant.response.singular import largest_singular_values

CHUNK = 1 << 22  # matrix entries handled at a time


class Neighbourhood(NamedTuple):
    """The module's quantities on many intervals; Y and M (3, nt, ...) at both ends and the middle."""

    Y: ComplexArray
    M: ComplexArray
    Y2: FloatArray
    inverse: ComplexArray
    D: FloatArray
    W: FloatArray
    P: FloatArray
    X: FloatArray
    clear: npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class LoopAxis:
    """One part of the axis of a bordered loop: t = w in [0, edge], or t = 1 / w in [0, 1 / edge].

    Above the edge the rows of x are divided by s and those of q by s^2 with s^2 q as the unknown, so that M is finite at t = 0.
    """

    loop: Bordered
    edge: float
    high: bool
    plants: tuple[ModalAxis, ...] = field(init=False)

    def __post_init__(self) -> None:
        axes = tuple(ModalAxis(plant, self.edge, self.high) for plant in self.loop.plants)
        object.__setattr__(self, "plants", axes)

    @property
    def points(self) -> FloatArray:
        """The ends of the axis; below the edge also the resonances of the plants and of the blocks by themselves."""
        if self.high:
            return np.array([0.0, 1 / self.edge])
        poles = np.linalg.eigvals(self.loop.A) if self.loop.A.size else np.zeros(0)
        every = np.concatenate(
            [[0.0, self.edge], abs(poles), self.loop.omega, *(p.points for p in self.plants if p.plant.n_modes)]
        )
        return np.unique(every[every <= self.edge])

    @property
    def _chunk(self) -> int:
        return max(CHUNK // max(self.loop.size, 1) ** 2, 1)

    def outputs(self, t: FloatArray) -> ComplexArray:
        """(nt, ny, m) Y: all block outputs from the unknowns."""
        loop, (nu, nx) = self.loop, (self.loop.S.shape[0], self.loop.A.shape[0])
        Y = np.zeros((t.size, loop.S.shape[1], loop.size), dtype=complex)
        Y[:, :, :nu], Y[:, :, nu : nu + nx] = loop.D, loop.C
        for axis, (rows, columns) in zip(self.plants, loop.ports, strict=True):
            Y[:, rows, columns] = np.moveaxis(axis.responses(t), -1, 0)
        s = (1j * t)[:, None, None]
        inverse = -s  # 1 / s where t = 1 / w
        Y[:, :, nu + nx :] = (
            loop.c0 * inverse**2 + loop.c1 * inverse + loop.c2 if self.high else loop.c0 + s * loop.c1 + s**2 * loop.c2
        )
        return Y

    def matrix(self, t: FloatArray, Y: ComplexArray) -> ComplexArray:
        """(nt, m, m) M."""
        loop, (nu, nx) = self.loop, (self.loop.S.shape[0], self.loop.A.shape[0])
        M = np.zeros((t.size, loop.size, loop.size), dtype=complex)
        s = (1j * t)[:, None, None]
        states, square = np.eye(nx), loop.omega**2
        M[:, :nu] = -(loop.S @ Y)
        M[:, :nu, :nu] += np.eye(nu)
        factor = s if self.high else -1  # -1 / s = i t
        M[:, nu : nu + nx, :nu], M[:, nu : nu + nx, nu : nu + nx] = factor * loop.B, factor * loop.A
        M[:, nu : nu + nx, nu : nu + nx] += states if self.high else s * states
        M[:, nu + nx :, :nu] = -loop.b
        q = np.arange(nu + nx, loop.size)
        M[:, q, q] = 1 - t[:, None] ** 2 * square if self.high else square - t[:, None] ** 2
        return M

    def responses(self, t: FloatArray) -> ComplexArray:
        """(nz, nw, nt) from outside to outside."""
        return np.asarray(self.through(t) + self.loop.F[:, :, None])

    def through(self, t: FloatArray) -> ComplexArray:
        """(nz, nw, nt) the part of `responses` that goes through the blocks."""
        parts = []
        entry = np.vstack([self.loop.E, np.zeros((self.loop.size - self.loop.E.shape[0], self.loop.E.shape[1]))])
        for start in range(0, t.size, self._chunk):
            part = t[start : start + self._chunk]
            Y = self.outputs(part)
            v = np.linalg.solve(self.matrix(part, Y), np.broadcast_to(entry.astype(complex), (part.size, *entry.shape)))
            parts.append(self.loop.R @ (Y @ v))
        return np.asarray(np.moveaxis(np.concatenate(parts), 0, -1))

    @property
    def n_gains(self) -> int:
        """How many gains `gains` returns."""
        return 1

    def gains(self, t: FloatArray) -> FloatArray:
        """(nt,) largest singular value."""
        return largest_singular_values(self.responses(t))

    def second(self, a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Entrywise bounds over each interval of |M''| (nt, m, m) and |Y''| (nt, ny, m)."""
        loop, first = self.loop, self.loop.S.shape[0] + self.loop.A.shape[0]
        Y2 = np.zeros((a.size, loop.S.shape[1], loop.size))
        for axis, (rows, columns) in zip(self.plants, loop.ports, strict=True):
            Y2[:, rows, columns] = axis.entry_curvatures(a, b)
        Y2[:, :, first:] = 2 * abs(loop.c0 if self.high else loop.c2)
        M2 = np.zeros((a.size, loop.size, loop.size))
        M2[:, : loop.S.shape[0]] = abs(loop.S) @ Y2
        q = np.arange(first, loop.size)
        M2[:, q, q] = 2 * (loop.omega**2 if self.high else np.ones(loop.omega.size))
        return M2, Y2

    def curvatures(self, a: FloatArray, b: FloatArray) -> tuple[FloatArray, IntArray]:
        """Bound of the second derivative of the closed loop, inf where a pole may lie on the interval."""
        bound = np.empty(a.size)
        for start in range(0, a.size, self._chunk):
            at = slice(start, start + self._chunk)
            bound[at] = self._curvature(a[at], b[at])
        return bound, self.nearest(a, b)

    def _curvature(self, a: FloatArray, b: FloatArray) -> FloatArray:
        loop, near, length = self.loop, self._near(a, b), (b - a)[:, None, None]
        entry = np.zeros((loop.size, loop.E.shape[1]))
        entry[: loop.E.shape[0]] = loop.E
        N1 = near.D / length + 0.5 * length * near.W
        V0 = near.X @ abs(near.inverse @ entry)
        V1 = near.X @ (N1 @ V0)
        V2 = near.X @ (near.W @ V0 + 2 * (N1 @ V1))
        Y1 = abs(near.Y[2] - near.Y[0]) / length + 0.5 * length * near.Y2
        Y0 = np.maximum(abs(near.Y[0]), abs(near.Y[2])) + length**2 / 8 * near.Y2
        second = abs(loop.R) @ (near.Y2 @ V0 + 2 * (Y1 @ V1) + Y0 @ V2)
        return np.where(near.clear, np.sqrt((second**2).sum(axis=(1, 2))), np.inf)

    def _near(self, a: FloatArray, b: FloatArray) -> Neighbourhood:
        points, index = np.unique(np.r_[a, 0.5 * (a + b), b], return_inverse=True)
        every = self.outputs(points)
        index = index.reshape(3, -1)
        Y, M = every[index], self.matrix(points, every)[index]
        M2, Y2 = self.second(a, b)
        inverse, regular = _inverses(M[1])
        D, W = abs(inverse @ (M[2] - M[0])), abs(inverse) @ M2
        length = (b - a)[:, None, None]
        P = np.where(regular[:, None, None], D / 2 + length**2 / 4 * W, 2 * np.eye(self.loop.size))
        P = np.minimum(P, 1e100)
        X = np.linalg.inv(np.eye(self.loop.size) - P)
        clear = regular & (X >= 0).all(axis=(1, 2))
        return Neighbourhood(Y, M, Y2, inverse, D, W, P, np.where(clear[:, None, None], X, 0.0), clear)

    def nearest(self, a: FloatArray, b: FloatArray) -> IntArray:
        """The damped mode that bends most, over all plants in order."""
        best, found, first = np.full(a.size, -1.0), np.zeros(a.size, dtype=np.int64), 0
        for axis in self.plants:
            if axis.plant.n_modes:
                bound, pole = axis.curvatures(a, b)
                found = np.where(bound > best, first + pole, found)
                best = np.maximum(best, bound)
            first += axis.plant.n_modes
        return found

    def between(self, a: FloatArray, b: FloatArray, fraction: FloatArray, pole: IntArray) -> FloatArray:
        """Denser towards the damped mode that matters most; equally spaced where there is none."""
        tables = [axis.pole_places for axis in self.plants]
        place, width = (np.concatenate([np.zeros(0), *(table[k] for table in tables)]) for k in (0, 1))
        if not place.size:
            return a + fraction * (b - a)
        return towards(a, b, fraction, place[pole], width[pole])

    def phases(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """(nt,) change of the phase of det M from a to b; NaN where it cannot be told yet."""
        parts = [self._phase(a[k : k + self._chunk], b[k : k + self._chunk]) for k in range(0, a.size, self._chunk)]
        return np.concatenate([np.zeros(0), *parts])

    def _phase(self, a: FloatArray, b: FloatArray) -> FloatArray:
        near = self._near(a, b)
        at_a, at_m, at_b = np.linalg.slogdet(near.M)[0]
        sign, size = np.linalg.slogdet(np.eye(self.loop.size) - near.P)
        known = near.clear & (sign > 0) & (size > -np.pi)
        turn = np.angle(at_m * at_a.conj()) + np.angle(at_b * at_m.conj())
        return np.where(known, turn, np.nan)


def _inverses(matrices: ComplexArray) -> tuple[ComplexArray, npt.NDArray[np.bool_]]:
    """The inverses, and which matrices have one (the others give zeros)."""
    try:
        return np.asarray(np.linalg.inv(matrices), dtype=complex), np.ones(len(matrices), dtype=bool)
    except np.linalg.LinAlgError:
        regular = np.asarray(np.isfinite(np.linalg.slogdet(matrices)[1]))
        safe = np.where(regular[:, None, None], matrices, np.eye(matrices.shape[1]))
        return np.asarray(np.where(regular[:, None, None], np.linalg.inv(safe), 0.0)), regular
