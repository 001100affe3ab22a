"""Static answers and modes of the free model from the one factor of its held interior."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.linalg as la

from flexplant.errors import SolverError
from flexplant.model.arrays import FloatArray
from flexplant.model.geometry import rigid_body_vectors
from flexplant.numerics.eigen import orthonormalize
from flexplant.reduction.mechanism import RIGID_FIT
from flexplant.reduction.partition import Partition

RIGID = 1e-9  # of a unit diagonal: condensed stiffness below it is that of a rigid-body motion
ROUND_OFF = 100 * float(np.finfo(float).eps)  # of the terms that cancel in the condensation; 2 eps are seen
ROUNDED = 1e-10  # of these terms: the most that matrices written with few digits may take from a rigid-body motion
NOISE = 10.0  # times the lowest negative eigenvalue: what they leave to the others


@dataclass(frozen=True, eq=False)
class FreeSolve:
    """Answers K x = f of the model with free boundary, through Kii and the condensed boundary stiffness.

        (Kbb + Kbi Psi) u_b = f_b + Psi^T f_i,   u_i = Kii^-1 f_i + Psi u_b

    Rows in the order boundary, interior. Where the structure floats, f must be in equilibrium and x carries no particular
    rigid-body motion.
    """

    part: Partition

    @cached_property
    def _boundary(self) -> tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        """Scale, eigenvalues and eigenvectors of the condensed stiffness with a unit diagonal, and which of them are elastic.

        Behind a statically determinate interface the condensed stiffness is nothing but round-off, and no scale for itself. So
        no diagonal is taken for less than the round-off of the terms that cancelled in it, over RIGID.
        """
        condensed = self.part.condensed("stiffness")
        cancelling = self.part.cancelling
        diagonal = np.maximum(np.diagonal(condensed), ROUND_OFF / RIGID * cancelling)
        size = np.sqrt(np.maximum(diagonal, np.finfo(float).tiny))
        values, vectors = la.eigh(condensed / np.outer(size, size))
        elastic = values > (RIGID if values[0] >= -RIGID else -NOISE * values[0])
        if values[0] < -RIGID:
            rounded = values[0] >= -ROUNDED * (cancelling * (vectors[:, 0] / size) ** 2).sum()
            if not (rounded and self._moves_rigidly(vectors[:, ~elastic], size)):
                raise self._indefinite(float(values[0]))
        return size, values, vectors, elastic

    def _moves_rigidly(self, motion: FloatArray, size: FloatArray) -> bool:
        """Whether these (n_b, k) boundary motions, times size, are geometric rigid-body motions, so that their stiffness is the
        rounding of the matrices. False where positions are unknown."""
        part = self.part
        if part.model.nodes is None or not (part.boundary.direction > 0).all():
            return False
        center = part.model.nodes.positions.mean(axis=0)
        geometric = la.orth(size[:, None] * rigid_body_vectors(part.model.nodes, part.boundary, about=center), rcond=RIGID)
        return bool(np.linalg.norm(motion - geometric @ (geometric.T @ motion), axis=0).max() < RIGID_FIT)

    def _indefinite(self, lowest: float) -> SolverError:
        hint = "; positions of its nodes would tell" if self.part.model.nodes is None else ""
        return SolverError(
            f"model {self.part.model.name!r}: the stiffness is indefinite ({lowest:.2g} of a unit diagonal), or its numbers are "
            f"rounded so far that rigid-body motion cannot be told from it{hint}; correct it, or write it with all digits"
        )

    @cached_property
    def rigid(self) -> FloatArray:
        """(n, r) mass-orthonormal rigid-body motions: [I; Psi] times the null space of the condensed stiffness."""
        size, _, vectors, elastic = self._boundary
        boundary = vectors[:, ~elastic] / size[:, None]
        return orthonormalize(np.vstack([boundary, self.part.constraint_modes @ boundary]), self.mass)

    @cached_property
    def mass(self) -> object:
        """The model's mass in the order boundary, interior."""
        order = np.r_[self.part.b, self.part.i]
        return self.part.block("mass", order, order)

    def solve(self, force: FloatArray) -> FloatArray:
        """x (n, k) for forces f (n, k) in equilibrium."""
        part, n_b = self.part, self.part.b.size
        size, values, vectors, elastic = self._boundary
        inverse = (vectors[:, elastic] / values[elastic]) @ vectors[:, elastic].T / np.outer(size, size)
        u_b = inverse @ (force[:n_b] + part.constraint_modes.T @ force[n_b:])
        return np.vstack([u_b, part.factor.solve(force[n_b:]) + part.constraint_modes @ u_b])
