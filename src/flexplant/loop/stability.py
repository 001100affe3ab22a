"""Closed-loop stability of large diagrams: poles in the right half plane counted by the winding of det M, and found by Newton."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexplant.loop.bordered import Bordered, ComplexArray, direct_of
from flexplant.loop.loop_bound import LoopAxis
from flexplant.model.arrays import FloatArray
from flexplant.plant.state_space import output_rows

SHORTEST = 1e-13  # length relative to the axis at which an interval is taken to hold a pole on the axis
SUSPECTS = 12  # starting points of the search for an unstable pole


@dataclass(frozen=True)
class Stability:
    """n_unstable: poles with positive real part. pole: one of them, or the one on the axis, rad/s; None where none is known.

    on_axis: True where a pole lies on the imaginary axis to round-off; n_unstable is then not known (-1).
    """

    n_unstable: int
    pole: complex | None
    on_axis: bool = False

    @property
    def stable(self) -> bool:
        """True where every pole has a negative real part."""
        return self.n_unstable == 0 and not self.on_axis

    @property
    def explanation(self) -> str:
        """What is unstable, in words; "" for a stable loop."""
        if self.on_axis and self.pole is not None:
            return f"a closed-loop pole on the imaginary axis at {self.pole.imag / (2 * np.pi):.6g} Hz"
        if not self.n_unstable:
            return ""
        poles = "pole" if self.n_unstable == 1 else "poles"
        found = "" if self.pole is None else f", one of them at {self.pole:.6g} rad/s"
        return f"the closed loop is unstable: {self.n_unstable} {poles} in the right half plane{found}"


def stability(axes: tuple[LoopAxis, LoopAxis]) -> Stability:
    """The number of unstable poles of a loop, from its two axes.

    Counter-clockwise round the right half plane the phase of det M turns by `order` half turns on the arc, less twice what it
    turns from 0 to infinity along the axis. The damped modes bring no poles there, so these turns are the zeros of det M.
    """
    total, falls = 0.0, []
    for axis in axes:
        t = axis.points
        a, b = t[:-1], t[1:]
        while a.size:
            turn = axis.phases(a, b)
            known = ~np.isnan(turn)
            signed = -turn[known] if axis.high else turn[known]  # t = 1 / w runs backwards
            total += float(signed.sum())
            falls.append(np.stack([signed, _omega(axis, 0.5 * (a[known] + b[known]))]))
            a, b = a[~known], b[~known]
            if a.size and (b - a).min() < SHORTEST * t[-1]:
                k = int((b - a).argmin())
                at = 0.0 if not axis.high and not a[k] else float(_omega(axis, b)[k])
                return Stability(-1, complex(0.0, at), on_axis=True)
            a, b = _quartered(axis, a, b)
    count = round((axes[0].loop.order * np.pi - 2 * total) / (2 * np.pi))
    return Stability(count, _unstable_pole(axes[0].loop, np.hstack(falls)) if count else None)


def _omega(axis: LoopAxis, t: FloatArray) -> FloatArray:
    return np.asarray(1 / t if axis.high else t)


def _quartered(axis: LoopAxis, a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    step = np.tile(np.linspace(0, 1, 5), a.size)
    cuts = axis.between(np.repeat(a, 5), np.repeat(b, 5), step, np.repeat(axis.nearest(a, b), 5)).reshape(-1, 5)
    cuts[:, 0], cuts[:, -1] = a, b
    a, b = cuts[:, :-1].ravel(), cuts[:, 1:].ravel()
    return a[b > a], b[b > a]


def _unstable_pole(loop: Bordered, falls: FloatArray) -> complex | None:
    """Newton on log det M from where the phase falls most; None where no start leads to a pole on the right."""
    for omega in falls[1, np.argsort(falls[0])[:SUSPECTS]]:
        s = complex(0.01 * omega, omega)
        for _ in range(60):
            step = _newton(loop, s)
            s = s - step
            if not np.isfinite(s) or s.real < -abs(s):
                break
            if abs(step) <= 1e-10 * abs(s):
                if s.real > 0:
                    return complex(s.real, abs(s.imag) if abs(s.imag) > 1e-9 * s.real else 0.0)
                break
    return None


def _newton(loop: Bordered, s: complex) -> complex:
    """det M / (det M)' = 1 / trace(M^-1 M'), M' by central differences."""
    h = 1e-6 * abs(s)
    change = (_matrix(loop, s + h) - _matrix(loop, s - h)) / (2 * h)
    try:
        rate = complex(np.trace(np.linalg.solve(_matrix(loop, s), change)))
    except np.linalg.LinAlgError:
        return 0j
    return 1 / rate if rate else complex(np.nan)


def _matrix(loop: Bordered, s: complex) -> ComplexArray:
    """(m, m) M at any complex s."""
    nu, nx = loop.S.shape[0], loop.A.shape[0]
    Y = np.zeros((loop.S.shape[1], loop.size), dtype=complex)
    Y[:, :nu], Y[:, nu : nu + nx] = loop.D, loop.C
    Y[:, nu + nx :] = loop.c0 + s * loop.c1 + s**2 * loop.c2
    for plant, (rows, columns) in zip(loop.plants, loop.ports, strict=True):
        position, velocity, _ = output_rows(plant)
        receptance = 1 / (s**2 + 2 * plant.zeta * plant.omega * s + plant.omega**2)
        Y[rows, columns] = ((position + s * velocity) * receptance) @ plant.shape_in + direct_of(plant)
    M = np.zeros((loop.size, loop.size), dtype=complex)
    M[:nu] = -(loop.S @ Y)
    M[:nu, :nu] += np.eye(nu)
    M[nu : nu + nx, :nu], M[nu : nu + nx, nu : nu + nx] = -loop.B, s * np.eye(nx) - loop.A
    M[nu + nx :, :nu] = -loop.b
    M[nu + nx :, nu + nx :] = np.diag(s**2 + loop.omega**2)
    return M
