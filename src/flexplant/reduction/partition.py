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
from flexplant.numerics.completion import completed
from flexplant.numerics.eigen import Pencil
from flexplant.numerics.factorization import Analysis, Factor, analyze, factorize, refuse_above
from flexplant.numerics.products import product
from flexplant.reduction.mechanism import described

GROUPED = 20_000  # unknowns from which an ordering by nodes repays the pattern it needs
SMALL, FEW_FLOPS = 3000, 1e9  # unknowns and flops up to which a banded factor takes less time than a sparse one
SHARE = 0.25  # of a given memory limit, that the banded factor may take
SINGULAR = 1e13  # growth of a solve beyond which the interior stiffness is singular to working precision
SEED = 20190811


@dataclass(frozen=True, eq=False)
class Partition:
    """A model split into boundary (b) and interior (i) DOF; blocks are sparse, factor is of Kii."""

    model: FiniteElementModel
    boundary: DofSet
    b: IntArray
    i: IntArray
    threads: int | None = None
    memory_limit: float | None = None
    backend: str | None = None

    @classmethod
    def of(
        cls,
        model: FiniteElementModel,
        boundary: DofSet | Iterable[tuple[int, int | str]],
        *,
        threads: int | None = None,
        memory_limit: float | None = None,
        backend: str | None = None,
    ) -> Partition:
        """Split at `boundary`; ModelError names missing DOF and those listed twice."""
        dofs = DofSet.of(boundary)
        if not len(dofs):
            raise ModelError(f"model {model.name!r}: the boundary is empty; list the interface (node, direction) pairs")
        b = model.dofs.rows(dofs.pairs, owner=f"model {model.name!r}")
        inside = np.ones(len(model.dofs), dtype=bool)
        inside[b] = False
        return cls(model, dofs, b, np.flatnonzero(inside), threads, memory_limit, backend)

    def block(self, kind: str, rows: IntArray, columns: IntArray) -> sp.csr_array:
        """Sparse block of "mass" or "stiffness"."""
        return sp.csr_array(sp.csr_array(getattr(self.model, kind))[rows][:, columns])

    def _split(self, kind: str) -> tuple[sp.csr_array, Any, Any]:
        """Blocks ii, ib and bb of "mass" or "stiffness": of a small model without stored zeros, and all but the first dense."""
        if len(self.model.dofs) <= SMALL:
            return _cut(sp.csr_array(getattr(self.model, kind)), self.i, self.b)
        order, n_i = np.r_[self.i, self.b], self.i.size
        whole = self.block(kind, order, order)
        whole.sort_indices()
        return whole[:n_i, :n_i], whole[:n_i, n_i:], whole[n_i:, n_i:]

    @cached_property
    def stiffness(self) -> tuple[sp.csr_array, Any, Any]:
        """Kii, Kib, Kbb; Kii without stored zeros, so that its pattern is that of every K - s M, but with full blocks."""
        kii, kib, kbb = self._split("stiffness")
        kii.eliminate_zeros()
        return completed(kii, self.model.dofs.node[self.i]) if self.i.size >= GROUPED else kii, kib, kbb

    @cached_property
    def mass(self) -> tuple[sp.csr_array, Any, Any]:
        """Mii, Mib, Mbb."""
        return self._split("mass")

    @property
    def kii(self) -> sp.csr_array:
        """Interior stiffness."""
        return self.stiffness[0]

    @property
    def mii(self) -> sp.csr_array:
        """Interior mass."""
        return self.mass[0]

    @cached_property
    def inertia_load(self) -> FloatArray:
        """S = Mii Psi + Mib, (n_i, n_b): interior inertia forces of unit boundary accelerations."""
        return product(self.mii, self.constraint_modes) + dense(self.mass[1])

    @cached_property
    def analysis(self) -> Analysis:
        """Symbolic analysis of Kii; SolverError where its factor and the constraint modes do not fit in memory."""
        analysis = self._small() or analyze(self.kii, backend=self.backend, threads=self.threads, definite=True)
        refuse_above(analysis.estimate, self.memory_limit, besides=16.0 * self.i.size * self.b.size)
        return analysis

    def _small(self) -> Analysis | None:
        """The banded analysis where no backend was asked for, and a small matrix takes little time and memory by it."""
        if self.backend is not None or self.i.size > SMALL:
            return None
        refuse_above(None, self.memory_limit)  # a limit that is no number
        analysis = analyze(self.kii, backend="banded", threads=self.threads)
        estimate = analysis.estimate
        if estimate is None or estimate.flops > FEW_FLOPS:
            return None
        return analysis if self.memory_limit is None or estimate.peak_bytes <= SHARE * self.memory_limit else None

    @property
    def pencil(self) -> Pencil:
        """The held model's eigenproblem."""
        return Pencil(self.kii, self.mii, self.analysis)

    @cached_property
    def factor(self) -> Factor:
        """Factor of Kii; SolverError names the DOF of a mechanism, or says that Kii is indefinite."""
        analysis = self.analysis
        try:
            factor = analysis.factorize(self.kii)
        except SolverError:
            raise self._mechanism(None) from None
        probe = np.random.default_rng(SEED).standard_normal(self.i.size)
        answer = factor.solve(probe)
        stiffest = abs(self.kii.diagonal()).max()
        if not np.isfinite(answer).all() or np.linalg.norm(answer) * stiffest > SINGULAR * np.linalg.norm(probe):
            raise self._mechanism(answer)
        if factor.negative_pivots:
            raise SolverError(
                f"model {self.model.name!r}: with the boundary held the interior stiffness has {factor.negative_pivots} negative "
                "eigenvalues, so the structure buckles (prestress?); correct the stiffness, or hold it at more boundary DOF"
            )
        return factor

    def _mechanism(self, motion: FloatArray | None) -> SolverError:
        if motion is None or not np.isfinite(motion).all():
            shifted = factorize(self.kii + 1e-9 * abs(self.kii.diagonal()).max() * sp.eye_array(self.i.size))
            motion = np.random.default_rng(SEED).standard_normal(self.i.size)
            for _ in range(3):
                motion = shifted.solve(motion)
                motion /= np.linalg.norm(motion)
        return SolverError(
            f"model {self.model.name!r}: with the boundary held the interior still moves without stiffness, "
            f"{described(self.model, self.i, motion)}; add boundary DOF that hold it, or remove the mechanism"
        )

    @cached_property
    def constraint_modes(self) -> FloatArray:
        """Psi = -Kii^-1 Kib, (n_i, n_b): interior motion for unit boundary displacements."""
        if not self.i.size:
            return np.zeros((0, self.b.size))
        answer = np.asarray(self.factor.solve(dense(self.stiffness[1])))
        return np.asarray(np.negative(answer, out=answer))

    def solve_no_more(self) -> None:
        """Free the factor, most of the memory held, once the constraint modes are there; asked for again it is made anew."""
        if self.constraint_modes.size:
            self.__dict__.pop("factor", None)

    def full_basis(self, interior: FloatArray, out: FloatArray | None = None) -> FloatArray:
        """(n, n_b + n_q) basis T = [I, 0; Psi, Phi] in the model's row order, written to `out` where that is given."""
        n_b, n_q = self.b.size, interior.shape[1]
        basis = np.zeros((len(self.model.dofs), n_b + n_q)) if out is None else out
        basis[self.b, :n_b], basis[self.b, n_b:] = np.eye(n_b), 0.0
        basis[self.i, :n_b] = self.constraint_modes
        basis[self.i, n_b:] = interior
        return basis

    def condensed(self, kind: str) -> FloatArray:
        """(n_b, n_b) "mass" or "stiffness" projected on [I; Psi]: Abb + Abi Psi + Psi^T (Aib + Aii Psi)."""
        psi, (_, aib, abb) = self.constraint_modes, self.mass if kind == "mass" else self.stiffness
        inner = self.inertia_load if kind == "mass" else product(self.kii, psi) + dense(aib)
        return symmetric(dense(abb) + aib.T @ psi + psi.T @ inner)

    @property
    def cancelling(self) -> FloatArray:
        """(n_b,) diagonal of |T|^T |K| |T|, T = [I; Psi]: the sum of the terms that the condensed stiffness is the rest of."""
        (kii, kib, kbb), psi = self.stiffness, abs(self.constraint_modes)
        return np.asarray(abs(kbb.diagonal()) + (psi * (abs(kii) @ psi + 2 * dense(abs(kib)))).sum(axis=0))

    @property
    def most_cancelling(self) -> FloatArray:
        """(n_b,) no less than `cancelling` of a semidefinite stiffness, without a product: there |K_ij|^2 <= K_ii K_jj."""
        kii, _, kbb = self.stiffness
        own, inside = np.sqrt(abs(kbb.diagonal())), np.sqrt(abs(kii.diagonal()))
        return np.asarray((own + inside @ abs(self.constraint_modes)) ** 2)


def _cut(matrix: sp.csr_array, i: IntArray, b: IntArray) -> tuple[sp.csr_array, FloatArray, FloatArray]:
    """Blocks ii (without zeros), ib and bb of a symmetric matrix, in a fraction of the time that the general indexing of small
    sparse matrices takes."""
    place, starts = np.empty(matrix.shape[0], dtype=np.int32), matrix.indptr
    place[i], place[b] = np.arange(i.size), -1 - np.arange(b.size)
    row, column = np.repeat(place, np.diff(starts)), place[matrix.indices]
    kept = np.flatnonzero((row >= 0) & (column >= 0) & (matrix.data != 0))
    ends = np.searchsorted(kept, np.r_[starts[0], starts[1:][i]]).astype(np.int32)
    own = sp.csr_array((matrix.data[kept], column[kept], ends), shape=(i.size, i.size))
    of_b = np.flatnonzero(row < 0)
    beside = np.zeros((b.size, matrix.shape[0]))  # columns: the interior, then the boundary in reverse
    beside[-1 - row[of_b], column[of_b]] = matrix.data[of_b]
    return own, np.ascontiguousarray(beside[:, : i.size].T), beside[:, -1 : -1 - b.size : -1]


def symmetric(matrix: FloatArray) -> FloatArray:
    """The symmetric part, which removes round-off."""
    return np.asarray(0.5 * (matrix + matrix.T))


def project(matrix: Any, basis: FloatArray) -> FloatArray:
    """T^T A T, exactly symmetric."""
    return symmetric(basis.T @ (matrix @ basis))
