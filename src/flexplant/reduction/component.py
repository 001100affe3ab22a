"""From interior vectors to a component in standard HCB form."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, Matrix
from flexplant.model.component import FiniteElementModel
from flexplant.model.damping import DampingRatio, given_ratios
from flexplant.model.dofs import DofSet
from flexplant.model.recovery import Recovery
from flexplant.model.recovery_units import displacement_units
from flexplant.reduction.free import ROUND_OFF
from flexplant.reduction.interior import Interior, coupling
from flexplant.reduction.partition import Partition, project
from flexplant.reduction.reduced import ReducedComponent, ReductionReport, Storage


def checked_extras(
    model: FiniteElementModel,
    recover: DofSet | Iterable[tuple[int, int | str]],
    keep_basis: Storage,
    damping_ratio: DampingRatio | None = None,
) -> DofSet:
    """`recover` as DOF of the model; ModelError or InputError for what a component cannot be given, before work is done."""
    dofs = DofSet.of(recover)
    model.dofs.rows(dofs.pairs, owner=f"model {model.name!r}")
    if not isinstance(keep_basis, bool) and not callable(keep_basis):
        raise InputError(f"keep_basis must be True, False or a function from a shape to an array, got {keep_basis!r:.60}")
    if damping_ratio is not None:
        given_ratios(damping_ratio)
    return dofs


def hcb_component(
    interior: Interior,
    report: ReductionReport,
    *,
    error_rows: FloatArray | None = None,
    structural_damping: Matrix | None = None,
    recover: DofSet | Iterable[tuple[int, int | str]] = (),
    loads: DofSet | Iterable[tuple[int, int | str]] = (),
    keep_basis: Storage = False,
) -> ReducedComponent:
    """M = [[Mbb, Mbq], [Mqb, I]], K = [[Kbb, 0], [0, w^2]] (equations 2, 3) on u = [I, 0; Psi, Q] [b; q].

    Kbq = Psi^T Kii Q + Kbi Q = 0 by the equation of the constraint modes. Damping matrices are projected. loads: DOF whose
    rows of T are kept as `interior_rows`, for forces and displacements; those of the boundary and scalar ones are left out.
    """
    part = interior.part
    model, n_b, n_q = part.model, part.b.size, interior.raw.shape[1]
    part.solve_no_more()
    mass, stiffness = np.eye(n_b + n_q), np.zeros((n_b + n_q, n_b + n_q))
    mass[:n_b, :n_b], stiffness[:n_b, :n_b] = part.condensed("mass"), _boundary_stiffness(part)
    mass[n_b:, :n_b] = coupling(interior)
    mass[:n_b, n_b:] = mass[n_b:, :n_b].T
    stiffness[n_b:, n_b:] = np.diag(interior.diagonal)
    damped = [model.damping, structural_damping]
    basis = _stored(part, interior, keep_basis)
    whole = part.full_basis(interior.vectors) if basis is None and any(d is not None for d in damped) else basis
    projected = [None if d is None or whole is None else project(d, whole) for d in damped]
    named = DofSet.of([(n, d) for n, d in DofSet.of(loads).pairs if d and (n, d) not in part.boundary])
    return ReducedComponent(
        name=model.name,
        boundary=part.boundary,
        mass=mass,
        stiffness=stiffness,
        damping=projected[0],
        structural_damping=projected[1],
        interior=named,
        interior_rows=_rows(part, interior, named) if len(named) else None,
        nodes=model.nodes,
        recovery=_recovery(part, interior, DofSet.of(recover)),
        source={**model.source, "reduction": str(report)},
        units=model.units,
        reduced_units=model.units,
        report=report,
        model_dofs=model.dofs,
        basis=basis,
        error_rows=error_rows,
    )


def _boundary_stiffness(part: Partition) -> FloatArray:
    """The condensed stiffness; zero where all of it is round-off of the terms that cancelled, behind a statically determinate
    interface, for then a mere rigid body is left, and nothing to tell it by."""
    stiffness = part.condensed("stiffness")
    if (np.diagonal(stiffness) > ROUND_OFF * part.most_cancelling).any():
        return stiffness
    size = np.sqrt(part.cancelling)
    return np.zeros_like(stiffness) if (abs(stiffness) <= ROUND_OFF * np.outer(size, size)).all() else stiffness


def _stored(part: Partition, interior: Interior, keep_basis: Storage) -> FloatArray | None:
    if keep_basis is False:
        return None
    shape = (len(part.model.dofs), part.b.size + interior.raw.shape[1])
    memory = keep_basis(shape) if callable(keep_basis) else None
    if memory is not None and np.shape(memory) != shape:
        raise InputError(
            f"keep_basis: the function gave {type(memory).__name__} {np.shape(memory)}, but an array {shape} is needed"
        )
    return part.full_basis(interior.vectors, memory)


def _recovery(part: Partition, interior: Interior, dofs: DofSet) -> dict[str, Recovery]:
    if not len(dofs):
        return {}
    labels = [f"{n}.{d}" for n, d in dofs.pairs]
    units = displacement_units("displacement", labels, part.model.units)
    return {"displacement": Recovery("displacement", labels, displacement=_rows(part, interior, dofs), units=units)}


def _rows(part: Partition, interior: Interior, dofs: DofSet) -> FloatArray:
    """(k, n_b + n_q) rows of T at some of the model's DOF."""
    model, n_b = part.model, part.b.size
    wanted = model.dofs.rows(dofs.pairs, owner=f"model {model.name!r}")
    rows = np.zeros((wanted.size, n_b + interior.raw.shape[1]))
    held, free = np.flatnonzero(np.isin(wanted, part.b)), np.flatnonzero(np.isin(wanted, part.i))
    place = {int(row): k for k, row in enumerate(part.b)}
    rows[held, [place[int(row)] for row in wanted[held]]] = 1.0
    at = np.searchsorted(part.i, wanted[free])
    rows[free, :n_b], rows[free, n_b:] = part.constraint_modes[at], interior.vectors[at]
    return rows


def basis_bytes(model: FiniteElementModel, n: int) -> int:
    """Memory of a full basis (n_model, n)."""
    return 8 * len(model.dofs) * n
