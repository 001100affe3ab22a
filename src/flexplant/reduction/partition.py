"""Interior and boundary parts of a model, and the statically exact constraint modes between them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.errors import ModelError, SolverError
from flexplant.model.arrays import FloatArray, IntArray, dense
from flexplant.model.component import FiniteElementModel
from flexplant.model.dofs import DofSet
from flexplant.numerics.factorization import Factor, factorize

SINGULAR = 1e13  # growth of a solve beyond which the interior stiffness is singular to working precision
SEED = 20190811


@dataclass(frozen=True, eq=False)
class Partition:
    """A model split into boundary (b) and interior (i) DOF; blocks are sparse, factor is of Kii."""

    model: FiniteElementModel
    boundary: DofSet
    b: IntArray
    i: IntArray

    @classmethod
    def of(cls, model: FiniteElementModel, boundary: DofSet | Iterable[tuple[int, int | str]]) -> Partition:
        """Split at `boundary`; ModelError names missing DOF and those listed twice."""
        dofs = DofSet.of(boundary)
        if not len(dofs):
            raise ModelError(f"model {model.name!r}: the boundary is empty; list the interface (node, direction) pairs")
        b = model.dofs.rows(dofs.pairs, owner=f"model {model.name!r}")
        return cls(model, dofs, b, np.setdiff1d(np.arange(len(model.dofs)), b))

    def block(self, kind: str, rows: IntArray, columns: IntArray) -> sp.csr_array:
        """Sparse block of "mass" or "stiffness"."""
        return sp.csr_array(sp.csr_array(getattr(self.model, kind))[rows][:, columns])

    @cached_property
    def kii(self) -> sp.csr_array:
        """Interior stiffness."""
        return self.block("stiffness", self.i, self.i)

    @cached_property
    def mii(self) -> sp.csr_array:
        """Interior mass."""
        return self.block("mass", self.i, self.i)

    @cached_property
    def factor(self) -> Factor:
        """Factor of Kii; SolverError names the DOF of a mechanism."""
        try:
            factor = factorize(self.kii)
        except SolverError:
            raise self._mechanism(None) from None
        probe = np.random.default_rng(SEED).standard_normal(self.i.size)
        answer = factor.solve(probe)
        stiffest = abs(self.kii.diagonal()).max()
        if not np.isfinite(answer).all() or np.linalg.norm(answer) * stiffest > SINGULAR * np.linalg.norm(probe):
            raise self._mechanism(answer)
        return factor

    def _mechanism(self, motion: FloatArray | None) -> SolverError:
        if motion is None or not np.isfinite(motion).all():
            shifted = factorize(self.kii + 1e-9 * abs(self.kii.diagonal()).max() * sp.eye_array(self.i.size))
            motion = np.random.default_rng(SEED).standard_normal(self.i.size)
            for _ in range(3):
                motion = shifted.solve(motion)
                motion /= np.linalg.norm(motion)
        moving = [self.model.dofs.pairs[self.i[k]] for k in np.argsort(-abs(motion))[:6]]
        return SolverError(
            f"model {self.model.name!r}: with the boundary held the interior still moves without stiffness, mostly at DOF "
            f"{', '.join(f'{n}-{d}' for n, d in moving)}; add boundary DOF that hold it, or remove the mechanism"
        )

    @cached_property
    def constraint_modes(self) -> FloatArray:
        """Psi = -Kii^-1 Kib, (n_i, n_b): interior motion for unit boundary displacements."""
        if not self.i.size:
            return np.zeros((0, self.b.size))
        return -np.asarray(self.factor.solve(dense(self.block("stiffness", self.i, self.b))))

    def full_basis(self, interior: FloatArray) -> FloatArray:
        """(n, n_b + n_q) basis [I, 0; Psi, Phi] in the model's row order."""
        n_b, n_q = self.b.size, interior.shape[1]
        basis = np.zeros((len(self.model.dofs), n_b + n_q))
        basis[self.b, np.arange(n_b)] = 1.0
        basis[self.i, :n_b] = self.constraint_modes
        basis[np.ix_(self.i, np.arange(n_b, n_b + n_q))] = interior
        return basis


def project(matrix: Any, basis: FloatArray) -> FloatArray:
    """T^T A T, exactly symmetric."""
    product = basis.T @ (matrix @ basis)
    return np.asarray(0.5 * (product + product.T))
