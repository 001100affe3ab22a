"""Hurty/Craig-Bampton reduction, with optional residual (load-dependent Ritz) vectors."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import scipy.linalg as la

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, dense
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.damping import DampingRatio, with_modal_damping
from flexplant.model.dofs import DofSet
from flexplant.model.recovery import Recovery
from flexplant.numerics.eigen import dense_eigenpairs, sparse_eigenpairs
from flexplant.reduction.partition import Partition, project

DENSE_LIMIT = 1500  # interior DOF up to which all modes by a dense solution cost less than a second
INDEPENDENT = 1e-9  # part of a Ritz vector that is new, below which it adds round-off only


def craig_bampton(
    model: FiniteElementModel,
    boundary: DofSet | Iterable[tuple[int, int | str]],
    *,
    max_frequency_hz: float | None = None,
    n_modes: int | None = None,
    residual_vectors: int = 0,
    damping_ratio: DampingRatio | None = None,
    recover: Iterable[tuple[int, int | str]] = (),
) -> Component:
    """Reduce a finite-element model to HCB form, u = [I, 0; Psi, Phi] [b; q] (equations 2-4).

    Psi = -Kii^-1 Kib are constraint modes; Phi are fixed-interface modes up to `max_frequency_hz` or the first `n_modes`,
    and `residual_vectors` = k blocks of load-dependent Ritz vectors X1 = Kii^-1 (Mii Psi + Mib), X(k+1) = Kii^-1 Mii Xk,
    made orthogonal and diagonalised, so that Kbq = 0, Mqq = I and Kqq = diag(w^2) hold for all q.
    damping_ratio: modal damping of q (equation 4); without it a physical damping matrix of the model is projected.
    recover: DOF whose displacements become the recovery "displacement", labels "node.direction".
    Raises ModelError for DOF that the model does not have, SolverError where the held interior is a mechanism, InputError
    for impossible numbers. Sources: Craig and Bampton 1968; Wilson, Yuan and Dickens 1982; Craig and Hale 1988.
    """
    if max_frequency_hz is None and n_modes is None:
        raise InputError("craig_bampton: give max_frequency_hz or n_modes")
    if residual_vectors < 0 or (n_modes is not None and n_modes < 0):
        raise InputError(f"craig_bampton: n_modes {n_modes} and residual_vectors {residual_vectors} must not be negative")
    part = Partition.of(model, boundary)
    interior = _interior_modes(part, max_frequency_hz, n_modes)
    if residual_vectors and part.i.size:
        interior = _with_ritz_vectors(part, interior, residual_vectors)
    component = _component(part, interior, list(recover))
    return component if damping_ratio is None else with_modal_damping(component, damping_ratio)


def _interior_modes(part: Partition, max_frequency_hz: float | None, n_modes: int | None) -> FloatArray:
    """(n_i, n_q) mass-normalised fixed-interface modes."""
    n = part.i.size
    if n == 0 or n_modes == 0:
        return np.zeros((n, 0))
    part.factor  # noqa: B018  a mechanism is named before the eigensolver meets it
    none = np.zeros((n, 0))
    limit = None if max_frequency_hz is None else (2 * np.pi * max_frequency_hz) ** 2
    if n <= DENSE_LIMIT or (n_modes or 0) > n // 3:
        found = dense_eigenpairs(part.kii, part.mii, none)
    else:
        found = sparse_eigenpairs(part.kii, part.mii, none, n_modes=n_modes, max_omega2=limit)
    if n_modes is not None and n_modes > found.omega2.size:
        raise InputError(f"craig_bampton: {n_modes} modes asked, the held model {part.model.name!r} has {found.omega2.size}")
    keep = slice(0, n_modes) if limit is None else np.flatnonzero(found.omega2 <= limit)[:n_modes]
    return found.vectors[:, keep]


def _with_ritz_vectors(part: Partition, modes: FloatArray, blocks: int) -> FloatArray:
    """Modes and Ritz vectors, diagonalised together so that K and M are diagonal on their span."""
    basis = modes
    block = dense(part.mii @ part.constraint_modes) + dense(part.block("mass", part.i, part.b))
    for _ in range(blocks):
        block = part.factor.solve(block)
        new = _orthonormal_against(block, basis, part)
        basis = np.hstack([basis, new])
        block = part.mii @ new
    k = project(part.kii, basis)
    m = project(part.mii, basis)
    _, rotation = la.eigh(k, m)
    return np.asarray(basis @ rotation)


def _orthonormal_against(block: FloatArray, basis: FloatArray, part: Partition) -> FloatArray:
    """Mass-orthonormal vectors of `block` outside `basis`; what is not new is dropped. Twice is enough (Kahan, Parlett)."""
    size = np.sqrt(np.einsum("ij,ij->j", block, part.mii @ block))
    live = size > 0
    block = block[:, live] / size[live]
    for _ in range(2):
        block = block - basis @ (basis.T @ (part.mii @ block))
    values, vectors = la.eigh(project(part.mii, block))
    new = values > INDEPENDENT**2
    block = block @ (vectors[:, new] / np.sqrt(values[new]))
    block = block - basis @ (basis.T @ (part.mii @ block))
    values, vectors = la.eigh(project(part.mii, block))
    return np.asarray(block @ (vectors / np.sqrt(values)))


def _component(part: Partition, interior: FloatArray, recover: list[tuple[int, int | str]]) -> Component:
    model, n_b = part.model, part.b.size
    basis = part.full_basis(interior)
    mass, stiffness = project(model.mass, basis), project(model.stiffness, basis)
    stiffness[:n_b, n_b:] = stiffness[n_b:, :n_b] = 0.0  # zero by the equation of the constraint modes; round-off only
    stiffness[n_b:, n_b:] = np.diag(np.diagonal(stiffness)[n_b:])
    mass[n_b:, n_b:] = np.eye(interior.shape[1])
    recovery = {}
    if recover:
        dofs = DofSet.of(recover)
        rows = basis[model.dofs.rows(dofs.pairs, owner=f"model {model.name!r}")]
        recovery["displacement"] = Recovery("displacement", [f"{n}.{d}" for n, d in dofs.pairs], displacement=rows)
    return Component(
        name=model.name,
        boundary=part.boundary,
        mass=mass,
        stiffness=stiffness,
        damping=None if model.damping is None else project(model.damping, basis),
        nodes=model.nodes,
        recovery=recovery,
        source={**model.source, "reduction": "Hurty/Craig-Bampton"},
        units=model.units,
    )
