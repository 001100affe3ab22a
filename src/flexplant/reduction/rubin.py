"""Rubin reduction: free-interface modes with residual flexibility."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la

from flexplant.errors import InputError, expect, expect_count, expect_function
from flexplant.model.arrays import FloatArray, checked_switch, is_number
from flexplant.model.component import FiniteElementModel
from flexplant.model.damping import DampingRatio, with_modal_damping
from flexplant.model.dofs import DofSet
from flexplant.numerics.eigen import residuals
from flexplant.numerics.lanczos import Progress, lanczos
from flexplant.reduction.component import basis_bytes, checked_extras, hcb_component
from flexplant.reduction.free import FreeSolve
from flexplant.reduction.interior import Interior, load_columns, orthonormal, without
from flexplant.reduction.partition import Partition
from flexplant.reduction.reduced import ReducedComponent, ReductionReport, Storage

FIRST_GUESS = 20


def rubin(
    model: FiniteElementModel,
    boundary: DofSet | Iterable[tuple[int, int | str]],
    *,
    max_frequency_hz: float | None = None,
    n_modes: int | None = None,
    damping_ratio: DampingRatio | None = None,
    loads: DofSet | Iterable[tuple[int, int | str]] = (),
    recover: DofSet | Iterable[tuple[int, int | str]] = (),
    keep_basis: Storage = False,
    error_estimate: bool = True,
    progress: Progress | None = None,
    threads: int | None = None,
    memory_limit: float | None = None,
    backend: str | None = None,
) -> ReducedComponent:
    """Reduce with elastic free-interface modes up to `max_frequency_hz` (or the first n), and residual flexibility.

    Rubin's basis, u = R a + Phi eta + G_res f_b, spans the same space as the constraint modes [I; Psi], the free modes Phi and
    the inertia-relief answers Kii^-1 S R_b to rigid-body acceleration. So the component is given in standard HCB form: the
    interior vectors Phi_i - Psi Phi_b and Kii^-1 S R_b, made orthogonal and diagonalised. All modes of the free component
    are exact, and so are statics, also of forces at the interior DOF `loads`. n_modes counts elastic modes. `estimate_error`
    holds below the last free mode. Other arguments and errors as for `craig_bampton`.
    Sources: Rubin 1975; MacNeal 1971; Craig and Chang 1977.
    """
    expect(model, FiniteElementModel, "rubin", "read_model gives one from a file")
    if max_frequency_hz is None and n_modes is None:
        raise InputError("rubin: give max_frequency_hz or n_modes")
    if max_frequency_hz is not None and not (is_number(max_frequency_hz) and 0 < max_frequency_hz < np.inf):
        raise InputError(f"rubin: max_frequency_hz must be positive and finite, got {max_frequency_hz!r:.60}")
    if n_modes is not None:
        expect_count(n_modes, "rubin: n_modes")
    if n_modes is not None and n_modes > len(model.dofs):
        raise InputError(f"rubin: n_modes {n_modes} must lie between 0 and the {len(model.dofs)} DOF of model {model.name!r}")
    checked_switch(error_estimate, "rubin: error_estimate")
    expect_function(progress, "rubin: progress", "stage, share")
    recover = checked_extras(model, recover, keep_basis, damping_ratio)
    part = Partition.of(model, boundary, threads=threads, memory_limit=memory_limit, backend=backend)
    loads = DofSet.of(loads)
    interior, report = (
        _reduced(part, load_columns(part, loads), max_frequency_hz, n_modes, error_estimate, progress)
        if part.i.size
        else _whole(part)
    )
    component = hcb_component(
        interior,
        report,
        error_rows=None if interior.missing is None else interior.error_rows,
        recover=recover,
        loads=loads,
        keep_basis=keep_basis,
    )
    return component if damping_ratio is None else with_modal_damping(component, damping_ratio)  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class FreeInterior(Interior):
    """Rubin's vectors; missing: V (n_i, m) and drive D (m, n_b + n_r), what they lack of the answer w^2 V D [b; x]."""

    missing: tuple[FloatArray, FloatArray] | None = None

    @cached_property
    def pending(self) -> tuple[FloatArray, FloatArray]:
        """See `Interior.pending`. The rest is stiff: whatever is K-orthogonal to the basis lies above the free modes kept."""
        assert self.missing is not None
        return self.missing


def _whole(part: Partition) -> tuple[FreeInterior, ReductionReport]:
    """Without interior DOF the boundary is the whole model, all of whose modes are there already."""
    none = np.zeros((0, 0))
    report = ReductionReport(
        method="Rubin", n_modes=0, complete_below_hz=np.inf, basis_bytes=basis_bytes(part.model, part.b.size)
    )
    return FreeInterior(part, none, np.zeros(0), np.inf, False, none, none), report


def _reduced(
    part: Partition,
    loads: FloatArray,
    max_frequency_hz: float | None,
    n_modes: int | None,
    error_estimate: bool,
    progress: Progress | None,
) -> tuple[FreeInterior, ReductionReport]:
    """Rubin's vectors, and what they hold. loads: unit forces (n_i, k)."""
    free = FreeSolve(part)
    shapes, omega2, complete = _free_modes(free, max_frequency_hz, n_modes, progress)
    n_b, psi, order = part.b.size, part.constraint_modes, np.r_[part.b, part.i]
    none = np.zeros((part.i.size, 0))
    relief = part.factor.solve(part.inertia_load @ free.rigid[:n_b]) if free.rigid.shape[1] else none
    other = np.hstack([relief, part.factor.solve(loads)])
    held = shapes[n_b:] - psi @ shapes[:n_b]
    first = orthonormal(without(held, none, part), none, part)
    rest = orthonormal(without(other, first, part), first, part)
    vectors = np.hstack([first, rest])
    missing = _missing(part, first, rest, (held, shapes[:n_b])) if error_estimate else None
    report = ReductionReport(
        method="Rubin",
        n_modes=shapes.shape[1],
        n_residual=vectors.shape[1] - shapes.shape[1],
        complete_below_hz=float(np.sqrt(complete)) / (2 * np.pi),
        residuals=tuple(residuals(part.block("stiffness", order, order), free.mass, omega2, shapes).tolist()),
        max_frequency_hz=max_frequency_hz,
        basis_bytes=basis_bytes(part.model, n_b + vectors.shape[1]),
    )
    return FreeInterior(part, none, np.zeros(0), complete, False, none, vectors, blocks=1, missing=missing), report


def _missing(
    part: Partition, first: FloatArray, rest: FloatArray, modes: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """V and D from one block of solutions: Kii^-1 Mii x = x / w^2 - Kii^-1 S phi_b for the held part x of a free mode phi.

    modes: x (n_i, m) and phi_b (n_b, m), which span `first`; rest: vectors of which no such law is known.
    """
    held, boundary = modes
    n_b = boundary.shape[0]
    v = without(part.factor.solve(np.hstack([part.inertia_load, part.mii @ rest])), np.hstack([first, rest]), part)
    combination = la.pinv(first.T @ (part.mii @ held))  # (m, n_first): first = held combination
    driven = la.block_diag(-boundary @ combination, np.eye(rest.shape[1]))
    return v, np.hstack([np.eye(n_b + rest.shape[1], n_b), driven])


def _free_modes(
    free: FreeSolve, max_frequency_hz: float | None, n_modes: int | None, progress: Progress | None
) -> tuple[FloatArray, FloatArray, float]:
    """(n, k) elastic modes of the free model, boundary rows first, their w^2, and w^2 below which none is missing."""
    limit = np.inf if max_frequency_hz is None else (2 * np.pi * max_frequency_hz) ** 2
    most = len(free.part.model.dofs) - free.rigid.shape[1]
    ask = min(most, FIRST_GUESS if n_modes is None else n_modes)
    if ask == 0:
        return np.zeros((len(free.part.model.dofs), 0)), np.zeros(0), 0.0
    while True:
        found = lanczos(free.solve, free.mass, ask, locked=free.rigid, progress=progress)
        inside = found.omega2 <= limit
        if found.exhausted or ask in (n_modes, most) or not inside.all():
            last = float(found.omega2[-1]) if found.omega2.size else 0.0
            return found.vectors[:, inside], found.omega2[inside], min(limit, last)
        ask = min(2 * ask, most if n_modes is None else n_modes)
