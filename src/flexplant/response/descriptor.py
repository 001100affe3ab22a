"""Frequency response of descriptor plants: one sparse solution a frequency, its symbolic part done once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from flexplant.errors import InputError, SolverError
from flexplant.model.arrays import FloatArray, dense
from flexplant.numerics.sweep import PencilSweep
from flexplant.plant.state_space import Descriptor
from flexplant.response.lasting import refuse_lasting

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
SYMMETRIC = 1e-12  # asymmetry relative to the largest entry that is round-off
SHIFT = 1e-8  # in place of the multipliers' zero diagonal, of a matrix scaled to entries of one
REFINED = 3  # steps of refinement; each gains about eight digits of what SHIFT takes
BACKWARD = 1e-14  # backward error of a symmetric solution above which the unsymmetric one, with free pivoting, takes over


@dataclass(frozen=True, eq=False)
class SecondOrder:
    """M z'' + Z z' + K z = F u, y = P z + V z' + A z'' + D u, with M, Z, K symmetric: what most descriptors are made from."""

    mass: sp.csr_array
    damping: sp.csr_array
    stiffness: sp.csr_array
    force: FloatArray
    outputs: tuple[Any, Any, Any]


def second_order(system: Descriptor) -> SecondOrder | None:
    """The second-order form behind E = [[I, 0, 0], [0, M, 0], [0, Q, 0]], A = [[0, I, 0], [-K, -Z, 0], [0, 0, I]], or None.

    z' = v; M v' = -K z - Z v + F u; 0 = -Q v' + w for acceleration outputs w (see `plant.descriptor`).
    """
    E, A, B = sp.csr_array(system.E), sp.csr_array(system.A), dense(system.B)
    n = int(A.indices[0]) if A.shape[0] and A.indptr[1] == 1 else 0
    if not 0 < 2 * n <= A.shape[0]:
        return None
    z, v, w = slice(n), slice(n, 2 * n), slice(2 * n, None)
    one, extra = sp.eye_array(n, format="csr"), sp.eye_array(A.shape[0] - 2 * n, format="csr")
    kinematic = (
        _equal(E[z, z], one) and _equal(A[z, v], one) and not any(part.count_nonzero() for part in (E[z, n:], A[z, z], A[z, w]))
    )
    empty = (E[v, z], E[v, w], A[v, w], E[w, z], E[w, w], A[w, z], A[w, v])
    algebraic = _equal(A[w, w], extra) and not any(part.count_nonzero() for part in empty)
    if not kinematic or not algebraic or B[z].any() or B[w].any():
        return None
    mass, damping, stiffness = E[v, v], -A[v, v], -A[v, z]
    if not all(_equal(part, part.T) for part in (mass, damping, stiffness)):
        return None
    C = sp.csr_array(system.C)
    return SecondOrder(mass, damping, stiffness, B[v], (C[:, z], C[:, v], C[:, w] @ E[w, v]))


def _equal(a: Any, b: Any) -> bool:
    return not a.shape[0] or float(abs(a - b).max()) <= SYMMETRIC * max(float(abs(b).max()), 1e-300)


class DescriptorResponse:
    """Call with hz (nf,): (ny, nu, nf) C (s E - A)^-1 B + D, s = 2 pi i f.

    A second-order system is solved as K + s Z + s^2 M, complex-symmetric and of half the size, on one symbolic analysis, whether
    bordered by multipliers or not; anything else, and a frequency at which that loses digits, as s E - A by LU with the column
    order of the first one. Both are scaled, and refined until the residual says that they are solved.
    """

    def __init__(self, system: Descriptor) -> None:
        self.system, self._general = system, _General(system)
        self._second = second_order(system)
        self._symmetric = None if self._second is None else _Symmetric(self._second)

    def __call__(self, hz: FloatArray) -> ComplexArray:
        """InputError for a frequency at which the matrix is singular, to round-off: an undamped pole."""
        out, growth = self._grown(hz)
        refuse_lasting(lambda near: self._grown(near)[0], hz, out, growth, f"descriptor {self.system.name!r}")
        return out

    def _grown(self, hz: FloatArray) -> tuple[ComplexArray, FloatArray]:
        """The response, and how much larger each solution is than its right-hand side."""
        system = self.system
        out, growth = np.empty((len(system.outputs), len(system.inputs), hz.size), dtype=complex), np.zeros(hz.size)
        for k, f in enumerate(hz):
            through, growth[k] = self._one(float(f)) if system.n_states else (0.0, 0.0)
            out[:, :, k] = through + system.D
        return out, growth

    def _one(self, hz: float) -> tuple[Any, float]:
        s = 2j * np.pi * hz
        # at 0 Hz a free structure is singular to round-off, which only pivoting with a free choice of rows tells well
        solved = None if self._symmetric is None or hz == 0 else self._symmetric.solved(s)
        if solved is None or self._second is None:
            x, growth = self._general.solved(s, hz)
            return self.system.C @ x, growth
        position, velocity, acceleration = self._second.outputs
        z, growth = solved
        return position @ z + s * (velocity @ z) + s**2 * (acceleration @ z), growth


class _Symmetric:
    """(K + s Z + s^2 M) z = F by L D L^T, scaled by the same factors in rows and columns.

    Multipliers have no diagonal entry, which L D L^T with a fixed order cannot take: -SHIFT stands there in the factor, and
    refinement against the true matrix removes it.
    """

    def __init__(self, second: SecondOrder) -> None:
        size = abs(second.stiffness) + abs(second.mass) + abs(second.damping)
        self._scale = np.ones(size.shape[0])
        for _ in range(3):
            scaled = sp.diags_array(self._scale) @ size @ sp.diags_array(self._scale)
            self._scale /= np.sqrt(_largest(scaled, 1))
        scale = sp.diags_array(self._scale)
        self._parts = [sp.csr_array(scale @ part @ scale) for part in (second.stiffness, second.damping, second.mass)]
        self._sizes = [float(abs(part).max()) for part in self._parts]
        self._force = self._scale[:, None] * second.force
        multipliers = size.diagonal() == 0
        self._pencil = PencilSweep(*self._parts, sp.diags_array(np.where(multipliers, -SHIFT, 0.0), format="csr"))

    def solved(self, s: complex) -> tuple[Any, float] | None:
        """z (n, nu) and how it has grown, or None where refinement does not reach round-off."""
        K, Z, M = self._parts
        try:
            factor = self._pencil.factor(1.0, s, s**2, 1.0)
        except SolverError:
            return None
        x = factor.solve(self._force.astype(complex))
        for _ in range(REFINED):
            x = x + factor.solve(self._force - (K @ x + s * (Z @ x) + s**2 * (M @ x)))
        left = abs(self._force - (K @ x + s * (Z @ x) + s**2 * (M @ x))).max(axis=0)
        given, matrix = abs(self._force).max(axis=0), float(np.dot(self._sizes, [1.0, abs(s), abs(s) ** 2]))
        size = matrix * abs(x).max(axis=0) + given
        return (self._scale[:, None] * x, _grown(size, given)) if (left <= BACKWARD * size).all() else None


class _General:
    """(s E - A) x = B by sparse LU: scaled, refined, the columns ordered once for all frequencies."""

    def __init__(self, system: Descriptor) -> None:
        self._system, self._B = system, dense(system.B).astype(complex)
        self._order: Any = None

    def solved(self, s: complex, hz: float) -> tuple[Any, float]:
        """x (n, nu) and how it has grown; InputError where the matrix is singular."""
        system = self._system
        pencil = sp.csr_array(s * system.E - system.A)
        r, c = _scaling(pencil)
        scaled = sp.csc_array(sp.diags_array(r) @ pencil @ sp.diags_array(c))
        try:
            solve = self._factored(scaled)
        except RuntimeError:
            raise InputError(
                f"descriptor {system.name!r} is singular at {hz:.9g} Hz: an undamped pole (0 Hz: a rigid-body mode or a "
                "multiplier state); leave this frequency out"
            ) from None
        b = r[:, None] * self._B
        x = solve(b)
        x += solve(b - scaled @ x)
        return c[:, None] * x, _grown(abs(x).max(axis=0), abs(b).max(axis=0))

    def _factored(self, matrix: sp.csc_array) -> Any:
        """b -> x; the first call orders the columns."""
        if self._order is None:
            factor = splu(matrix)
            self._order = np.argsort(factor.perm_c)
            return factor.solve
        natural = splu(sp.csc_array(matrix[:, self._order]), permc_spec="NATURAL")

        def solve(b: Any) -> Any:
            x = np.empty_like(b)
            x[self._order] = natural.solve(b)
            return x

        return solve


def _grown(size: FloatArray, given: FloatArray) -> float:
    """The largest ratio over the right-hand sides that are not zero."""
    return float((size[given > 0] / given[given > 0]).max(initial=0.0))


def _scaling(matrix: sp.csr_array) -> tuple[FloatArray, FloatArray]:
    """Row and column factors that bring the largest entries near one (two sweeps)."""
    size = abs(matrix)
    r, c = np.ones(size.shape[0]), np.ones(size.shape[1])
    for _ in range(2):
        r /= np.sqrt(_largest(sp.diags_array(r) @ size @ sp.diags_array(c), 1))
        c /= np.sqrt(_largest(sp.diags_array(r) @ size @ sp.diags_array(c), 0))
    return r, c


def _largest(matrix: Any, axis: int) -> FloatArray:
    found = sp.csr_array(matrix).max(axis=axis).toarray().ravel()
    return np.where(found > 0, found, 1.0)
