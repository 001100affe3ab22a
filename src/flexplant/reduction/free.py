"""Static answers and modes of the free model from the one factor of its held interior."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la

from flexplant.errors import SolverError
from flexplant.model.arrays import FloatArray
from flexplant.numerics.eigen import orthonormalize
from flexplant.reduction.partition import Partition

RIGID = 1e-9  # of a unit diagonal: condensed stiffness below it is round-off of a rigid-body motion


@dataclass(frozen=True, eq=False)
class FreeSolve:
    """Answers K x = f of the model with free boundary, through Kii and the condensed boundary stiffness.

        (Kbb + Kbi Psi) u_b = f_b + Psi^T f_i,   u_i = Kii^-1 f_i + Psi u_b

    Rows in the order boundary, interior. Where the structure floats, f must be in equilibrium and x carries no particular
    rigid-body motion.
    """

    part: Partition

    @cached_property
    def _boundary(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Scale, eigenvalues and eigenvectors of the condensed stiffness with a unit diagonal."""
        condensed = self.part.condensed("stiffness")
        size = np.sqrt(np.maximum(np.diagonal(condensed), np.finfo(float).tiny))
        reference = np.sqrt(np.maximum(self.part.stiffness[2].diagonal(), 0.0))
        size = np.maximum(size, 1e-3 * reference)
        values, vectors = la.eigh(condensed / np.outer(size, size))
        if values[0] < -RIGID:
            raise SolverError(f"model {self.part.model.name!r}: the stiffness is indefinite ({values[0]:.2g} of a unit diagonal)")
        return size, values, vectors

    @cached_property
    def rigid(self) -> FloatArray:
        """(n, r) mass-orthonormal rigid-body motions: [I; Psi] times the null space of the condensed stiffness."""
        size, values, vectors = self._boundary
        boundary = vectors[:, values <= RIGID] / size[:, None]
        return orthonormalize(np.vstack([boundary, self.part.constraint_modes @ boundary]), self.mass)

    @cached_property
    def mass(self) -> object:
        """The model's mass in the order boundary, interior."""
        order = np.r_[self.part.b, self.part.i]
        return self.part.block("mass", order, order)

    def solve(self, force: FloatArray) -> FloatArray:
        """x (n, k) for forces f (n, k) in equilibrium."""
        part, n_b = self.part, self.part.b.size
        size, values, vectors = self._boundary
        elastic = values > RIGID
        inverse = (vectors[:, elastic] / values[elastic]) @ vectors[:, elastic].T / np.outer(size, size)
        u_b = inverse @ (force[:n_b] + part.constraint_modes.T @ force[n_b:])
        return np.vstack([u_b, part.factor.solve(force[n_b:]) + part.constraint_modes @ u_b])
