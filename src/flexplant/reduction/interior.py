"""Interior vectors of a component: fixed-interface modes, residual (load-dependent Ritz) vectors, and what they leave out."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, dense
from flexplant.model.dofs import DofSet
from flexplant.numerics.eigen import Wanted, dense_lowest, shift_invert
from flexplant.numerics.eigen_held import held_modes
from flexplant.numerics.eigen_small import is_dense
from flexplant.numerics.lanczos import BASIS_BYTES, Progress
from flexplant.numerics.sturm import gap_below_last
from flexplant.reduction.partition import Partition, project, symmetric

BASIS_SHARE = 0.25  # of a given memory limit, for the Lanczos basis
DAMPED = 60  # interior DOF at dampers, up to which each damper gets vectors of its own
INDEPENDENT = 1e-9  # part of a Ritz vector that is new, below which it adds round-off only


@dataclass(frozen=True, eq=False)
class Interior:
    """Mass-orthonormal interior vectors Q = [Phi, X]: modes Phi (n_i, n_m) and Ritz vectors X (n_i, n_r), in `blocks` blocks.

    omega2: (n_m,). complete: w^2 below which no fixed-interface mode is missing; proved: by a Sturm count. residuals: of
    each mode. loads: (n_i, k) forces that get Ritz vectors besides the boundary's. newest: how many last columns of X have not
    been followed up; older, older_drive: what earlier blocks left out (see `pending`).
    """

    part: Partition
    modes: FloatArray
    omega2: FloatArray
    complete: float
    proved: bool
    loads: FloatArray
    ritz: FloatArray
    blocks: int = 0
    newest: int = 0
    older: FloatArray | None = None
    older_drive: FloatArray | None = None
    residuals: tuple[float, ...] = ()

    @cached_property
    def raw(self) -> FloatArray:
        """Q, (n_i, n_q), before its Ritz part is diagonalised."""
        return np.hstack([self.modes, self.ritz]) if self.ritz.shape[1] else self.modes

    @cached_property
    def rotation(self) -> tuple[FloatArray, FloatArray]:
        """(w^2, R) of the Ritz part: X R has a diagonal stiffness; the modes are diagonal, and orthogonal to X, already."""
        values, vectors = la.eigh(project(self.part.kii, self.ritz)) if self.ritz.size else (np.zeros(0), np.zeros((0, 0)))
        return np.asarray(values), np.asarray(vectors)

    @cached_property
    def order(self) -> list[int]:
        """Places of modes and Ritz vectors by ascending frequency."""
        return [int(i) for i in np.argsort(np.r_[self.omega2, self.rotation[0]], kind="stable")]

    @property
    def diagonal(self) -> FloatArray:
        """(n_q,) w^2 of the q coordinates."""
        return np.asarray(np.r_[self.omega2, self.rotation[0]][self.order])

    @cached_property
    def vectors(self) -> FloatArray:
        """(n_i, n_q) with Q^T Mii Q = I and Q^T Kii Q = diag(w^2)."""
        return np.hstack([self.modes, self.ritz @ self.rotation[1]])[:, self.order] if self.ritz.shape[1] else self.modes

    @cached_property
    def pending(self) -> tuple[FloatArray, FloatArray]:
        """Vectors V (n_i, m) outside Q, and their drive D (m, n_b + n_r): Q lacks w^2 V D [b; x] of the answer to a motion.

        First V is Kii^-1 [S, F] without its part in Q, driven by the boundary; each block X_k adds Kii^-1 Mii X_k.
        """
        part, n_b, n_r = self.part, self.part.b.size, self.ritz.shape[1]
        if not self.blocks:
            answers = part.factor.solve(np.hstack([part.inertia_load, self.loads]))
            return without(answers, self.raw, part), np.eye(answers.shape[1], n_b)
        answers = without(part.factor.solve(part.mii @ self.ritz[:, n_r - self.newest :]), self.raw, part)
        drive = np.eye(self.newest, n_b + n_r, n_b + n_r - self.newest)
        if self.older is None or self.older_drive is None:
            return answers, drive
        return np.hstack([self.older, answers]), np.vstack([self.older_drive, drive])

    def extended(self, directions: FloatArray | None = None) -> Interior:
        """With the pending vectors (or the combinations V C, `directions` C (m, k)) as one more block."""
        v, drive = self.pending
        block = orthonormal(v if directions is None else v @ directions, self.raw, self.part)
        left = None if directions is None else without(v, block, self.part)
        return replace(
            self,
            ritz=np.hstack([self.ritz, block]),
            blocks=self.blocks + 1,
            newest=block.shape[1],
            older=left,
            older_drive=None if left is None else np.pad(drive, ((0, 0), (0, block.shape[1]))),
        )

    @cached_property
    def drive(self) -> FloatArray:
        """(m, n_b + n_q): `pending`'s drive in terms of the component's coordinates [b; q]."""
        n_b, rows = self.part.b.size, self.pending[1]
        none = np.zeros((rows.shape[0], self.modes.shape[1]))
        if not self.ritz.shape[1]:
            return np.hstack([rows[:, :n_b], none])
        modal = np.hstack([none, rows[:, n_b:] @ self.rotation[1]])[:, self.order]
        return np.hstack([rows[:, :n_b], modal])

    @cached_property
    def error_rows(self) -> FloatArray:
        """L (k, n_b + n_q): the part of the interior's answer to inertia that Q lacks has the energy |w^2 L p|^2.

        A Galerkin solution leaves an answer that is K-orthogonal to Q, so the energy of V is taken without its part in Q.
        """
        v, _ = self.pending
        force = self.part.kii @ v
        energy = v.T @ force
        if self.ritz.shape[1]:
            values, rotation = self.rotation
            shared = (rotation.T @ (self.ritz.T @ force)) / np.sqrt(values)[:, None]
            energy -= shared.T @ shared
        return _root(symmetric(energy)) @ self.drive


def _root(matrix: FloatArray) -> FloatArray:
    """U with U^T U = A of a semidefinite matrix; rows of round-off left out."""
    if not matrix.size:
        return np.zeros((0, matrix.shape[0]))
    values, vectors = np.linalg.eigh(matrix)
    keep = values > 0
    return np.asarray(np.sqrt(values[keep])[:, None] * vectors[:, keep].T)


def without(block: FloatArray, basis: FloatArray, part: Partition) -> FloatArray:
    """The block without its part in a mass-orthonormal basis. Twice is enough (Kahan, Parlett)."""
    for _ in range(2):
        block = block - basis @ (basis.T @ (part.mii @ block))
    return block


def orthonormal(block: FloatArray, basis: FloatArray, part: Partition) -> FloatArray:
    """Mass-orthonormal vectors of `block`, which is outside `basis` already; what is not new is dropped."""
    size = np.sqrt(np.maximum(np.einsum("ij,ij->j", block, part.mii @ block), 0.0))
    live = size > 0
    block = block[:, live] / size[live]
    for limit in (INDEPENDENT**2, 0.5):
        values, vectors = la.eigh(project(part.mii, block))
        new = values > limit
        block = without(block @ (vectors[:, new] / np.sqrt(values[new])), basis, part)
    values, vectors = la.eigh(project(part.mii, block))
    return np.asarray(block @ (vectors / np.sqrt(values)))


def fixed_interface(
    part: Partition,
    *,
    max_frequency_hz: float | None,
    n_modes: int | None,
    loads: FloatArray,
    progress: Progress | None,
    verify_count: bool | None = None,
) -> Interior:
    """The modes of the held model up to a frequency, or the first n, or fewer where both are given."""
    limit = None if max_frequency_hz is None else (2 * np.pi * max_frequency_hz) ** 2
    n, none = part.i.size, np.zeros((part.i.size, 0))
    if n_modes is not None and n_modes > n:
        raise InputError(f"craig_bampton: {n_modes} modes asked, the held model {part.model.name!r} has only {n} DOF")
    if n == 0 or n_modes == 0:
        return Interior(part, none, np.zeros(0), np.inf if n == 0 else 0.0, False, loads, none)
    factor = part.factor  # a mechanism is named before the eigensolver meets it
    if (n_modes or 0) > n // 3 or is_dense(n, n_modes or 0):
        return _all_dense(part, limit, n_modes, loads)
    pencil = part.pencil
    count = None if limit is None else pencil.count_below(limit)
    if is_dense(n, count or 0):
        return _all_dense(part, limit, n_modes, loads)
    room = BASIS_BYTES if part.memory_limit is None else min(BASIS_BYTES, BASIS_SHARE * part.memory_limit)
    wanted = Wanted(n_modes, limit, count)
    found = held_modes(factor, pencil, wanted, memory_limit=room, verify_count=verify_count, progress=progress)
    if found is None:
        found = shift_invert(factor, pencil, wanted, memory_limit=room, verify_count=verify_count, progress=progress)
    omega2 = _enough(part, found.omega2, limit, n_modes)
    every = limit is not None and (n_modes is None or omega2.size < n_modes or count == n_modes)
    complete = float(limit or 0.0) if every else gap_below_last(omega2) if found.proved else float(omega2[-1])
    return Interior(part, found.vectors, omega2, complete, found.proved, loads, none, residuals=_listed(found.residuals))


def _listed(residuals: FloatArray) -> tuple[float, ...]:
    return tuple(residuals.tolist())


def _all_dense(part: Partition, limit: float | None, n_modes: int | None, loads: FloatArray) -> Interior:
    found, following = dense_lowest(part.factor, part.kii, part.mii, limit, n_modes)
    omega2 = _enough(part, found.omega2, limit, n_modes)
    none, rest = np.zeros((part.i.size, 0)), _listed(found.residuals)
    return Interior(part, found.vectors, omega2, following, True, loads, none, residuals=rest)


def _enough(part: Partition, omega2: FloatArray, limit: float | None, n_modes: int | None) -> FloatArray:
    if n_modes is not None and limit is None and omega2.size < n_modes:
        raise InputError(f"craig_bampton: {n_modes} modes asked, the held model {part.model.name!r} has {omega2.size}")
    return omega2


def load_columns(part: Partition, loads: DofSet | Iterable[tuple[int, int | str]]) -> FloatArray:
    """(n_i, k) unit forces at the given DOF; those at the boundary need no vectors and are left out."""
    dofs = DofSet.of(loads)
    if not len(dofs):
        return np.zeros((part.i.size, 0))
    rows = part.model.dofs.rows(dofs.pairs, owner=f"model {part.model.name!r}")
    inside = rows[np.isin(rows, part.i)]
    columns = np.zeros((part.i.size, inside.size))
    columns[np.searchsorted(part.i, inside), np.arange(inside.size)] = 1.0
    return columns


def damper_columns(part: Partition) -> FloatArray:
    """(n_i, k) directions of the forces of discrete dampers inside the model, for Ritz vectors like those of loads.

    The range of the interior columns of Z, where few DOF have any; damping spread over the model (proportional) needs none.
    """
    if part.model.damping is None:
        return np.zeros((part.i.size, 0))
    damping = sp.csr_array(part.model.damping)[part.i]
    held = np.flatnonzero(np.diff(damping.indptr))
    if not 0 < held.size <= min(DAMPED, part.i.size // 4):
        return np.zeros((part.i.size, 0))
    values, vectors = la.eigh(dense(damping[held][:, part.i[held]]))
    kept = vectors[:, values > INDEPENDENT * values[-1]]
    columns = np.zeros((part.i.size, kept.shape[1]))
    columns[held] = kept
    return columns


def coupling(interior: Interior) -> FloatArray:
    """Mqb = Q^T S, (n_q, n_b)."""
    return np.asarray(interior.vectors.T @ interior.part.inertia_load)
