"""Hurty/Craig-Bampton reduction, with optional residual (load-dependent Ritz) vectors and promised accuracy."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from flexplant.errors import InputError, SolverError, expect_function
from flexplant.model.arrays import Matrix, checked_switch, checked_symmetric, is_number
from flexplant.model.component import FiniteElementModel
from flexplant.model.damping import DampingRatio, with_modal_damping
from flexplant.model.dofs import DofSet
from flexplant.numerics.lanczos import Progress
from flexplant.reduction.accuracy import SAMPLES, best_of_size, chosen_for, out_of_reach
from flexplant.reduction.bound import round_off
from flexplant.reduction.budget import Drawn
from flexplant.reduction.component import basis_bytes, checked_extras, hcb_component
from flexplant.reduction.interior import Interior, damper_columns, fixed_interface, load_columns
from flexplant.reduction.partition import Partition
from flexplant.reduction.reduced import ReducedComponent, ReductionReport, Storage


def craig_bampton(
    model: FiniteElementModel,
    boundary: DofSet | Iterable[tuple[int, int | str]],
    *,
    max_frequency_hz: float | None = None,
    n_modes: int | None = None,
    residual_vectors: int = 0,
    accuracy: float | None = None,
    size: int | None = None,
    loads: DofSet | Iterable[tuple[int, int | str]] = (),
    damping_ratio: DampingRatio | None = None,
    structural_damping: Matrix | float | None = None,
    recover: DofSet | Iterable[tuple[int, int | str]] = (),
    keep_basis: Storage = False,
    error_estimate: bool = True,
    progress: Progress | None = None,
    threads: int | None = None,
    memory_limit: float | None = None,
    backend: str | None = None,
    verify_count: bool | None = None,
) -> ReducedComponent:
    """Reduce a finite-element model to HCB form, u = [I, 0; Psi, Phi] [b; q] (equations 2-4).

    Psi = -Kii^-1 Kib are constraint modes; Phi are fixed-interface modes up to `max_frequency_hz` or the first `n_modes`,
    and `residual_vectors` = k blocks of load-dependent Ritz vectors X1 = Kii^-1 (Mii Psi + Mib), X(k+1) = Kii^-1 Mii Xk,
    made orthogonal and diagonalised, so that Kbq = 0, Mqq = I and Kqq = diag(w^2) hold for all q. Modes below
    `max_frequency_hz` are counted by Sylvester's law, so none is missing. So are the first `n_modes`, with verify_count=True,
    at the price of one more factorisation; None leaves that out where it would be most of the work, False always. Where both are
    given, whichever is fewer: modes end at `max_frequency_hz`, or before it with the n_modes-th, and `.report` says so.

    accuracy: instead of n_modes and residual_vectors, the relative error that no frequency up to `max_frequency_hz` of any
    system containing the component shall exceed because of its basis; what was chosen and verified is in `.report`.
    size: instead of these, the number of q that may be spent: the exact modes up to a little above `max_frequency_hz` and
    the vectors that the worst boundary motions below it need most, drawn from a larger basis; the report states the bound.
    loads: interior DOF where forces will act; their static answers, and further blocks of them, join the residual vectors.
    "component.node.direction" then names them as inputs and outputs of a plant (`Component.interior`).
    Static answers to discrete dampers inside the model (`with_dampers`) join too, unless damping_ratio replaces the dampers.
    damping_ratio: modal damping of q (equation 4); without it a physical damping matrix of the model is projected.
    structural_damping: (n, n) matrix D of a complex stiffness K + i D, or a loss factor g for D = g K; projected.
    recover: DOF whose displacements become the recovery "displacement", labels "node.direction".
    keep_basis: True, or a function shape -> array (for example a numpy memmap) to hold the basis that `expand` needs.
    error_estimate: keep the rows that `estimate_error` needs, which costs one more block of solutions.
    backend: of the factorisation, "rslab", "superlu", "pardiso", "cholmod", "banded" or "supernodal"; None takes the best there.
    progress("modes", share): called while modes are computed; an exception it raises ends the reduction.
    Raises ModelError for DOF that the model does not have, SolverError where the held interior is a mechanism or indefinite,
    memory is too small or the accuracy is out of reach, InputError for impossible numbers.
    Sources: Craig and Bampton 1968; Wilson, Yuan and Dickens 1982; Craig and Hale 1988.
    """
    _check_request(max_frequency_hz, n_modes, residual_vectors)
    _check_choice(max_frequency_hz, n_modes, residual_vectors, accuracy, size)
    if not isinstance(model, FiniteElementModel):
        raise InputError(f"craig_bampton reduces a FiniteElementModel, got {type(model).__name__}")
    if not (verify_count is None or isinstance(verify_count, (bool, np.bool_))):
        raise InputError(f"craig_bampton: verify_count is True, False or None, got {verify_count!r:.60}")
    checked_switch(error_estimate, "craig_bampton: error_estimate")
    max_frequency_hz = None if max_frequency_hz is None else float(max_frequency_hz)
    expect_function(progress, "craig_bampton: progress", "stage, share")
    recover = checked_extras(model, recover, keep_basis, damping_ratio)
    structural_damping = _checked_damping(model, structural_damping)
    part = Partition.of(model, boundary, threads=threads, memory_limit=memory_limit, backend=backend)
    loads = DofSet.of(loads)
    forces = load_columns(part, loads)
    if damping_ratio is None:
        forces = np.hstack([forces, damper_columns(part)])
    verified = None
    if accuracy is not None and max_frequency_hz is not None and part.i.size:
        interior, verified = chosen_for(part, accuracy, max_frequency_hz, forces, progress)
    elif size is not None and max_frequency_hz is not None and part.i.size:
        interior, verified = best_of_size(part, size, max_frequency_hz, forces, progress)
    else:
        interior = fixed_interface(
            part,
            max_frequency_hz=max_frequency_hz,
            n_modes=n_modes,
            loads=forces,
            progress=progress,
            verify_count=verify_count,
        )
        for _ in range(max(residual_vectors, 1 if forces.shape[1] else 0) if part.i.size else 0):
            size_before = interior.raw.shape[1]
            interior = interior.extended()
            if interior.raw.shape[1] == size_before:
                break  # the basis is complete
    if verified is not None and max_frequency_hz is not None:
        verified = _within(accuracy, verified, round_off(interior, max_frequency_hz, SAMPLES))
    component = hcb_component(
        interior,
        _report(interior, max_frequency_hz, accuracy, verified),
        error_rows=interior.error_rows if error_estimate and part.i.size else None,
        structural_damping=structural_damping,
        recover=recover,
        loads=loads,
        keep_basis=keep_basis,
    )
    return component if damping_ratio is None else with_modal_damping(component, damping_ratio)  # type: ignore[return-value]


def _within(accuracy: float | None, bound: float, rounding: float) -> float:
    """The error of the basis or of rounding, whichever is larger; SolverError where that breaks the promise."""
    found = max(bound, rounding)
    if accuracy is not None and found > accuracy:
        cause = "rounding to double precision" if rounding > accuracy else "the best basis"
        raise SolverError(out_of_reach(accuracy, found, cause))
    return found


def _check_request(max_frequency_hz: float | None, n_modes: int | None, residual_vectors: int) -> None:
    if max_frequency_hz is None and n_modes is None:
        raise InputError("craig_bampton: give max_frequency_hz or n_modes")
    if max_frequency_hz is not None and not (is_number(max_frequency_hz) and 0 < max_frequency_hz < np.inf):
        raise InputError(f"craig_bampton: max_frequency_hz must be positive and finite, got {max_frequency_hz!r:.60}")
    if not _is_count(residual_vectors) or not (n_modes is None or _is_count(n_modes)):
        counts = f"n_modes {n_modes!r:.60} and residual_vectors {residual_vectors!r:.60}"
        raise InputError(f"craig_bampton: {counts} must be whole numbers, not negative")


def _check_choice(
    max_frequency_hz: float | None, n_modes: int | None, residual_vectors: int, accuracy: float | None, size: int | None
) -> None:
    """What is left to the reduction to choose: by accuracy, or by size."""
    if accuracy is None and size is None:
        return
    word = "size" if accuracy is None else "accuracy"
    if max_frequency_hz is None or n_modes is not None or residual_vectors:
        raise InputError(
            f"craig_bampton: {word} chooses modes and blocks; give max_frequency_hz, not n_modes or residual_vectors"
        )
    if accuracy is not None and size is not None:
        raise InputError("craig_bampton: give accuracy (as few coordinates as it needs) or size (as accurate as it allows)")
    if size is not None and not _is_count(size):
        raise InputError(f"craig_bampton: size {size!r:.60} must be a whole number, not negative")
    if accuracy is not None and not (is_number(accuracy) and 0 < accuracy < 1):
        raise InputError(f"craig_bampton: accuracy is a relative frequency error between 0 and 1, got {accuracy!r:.60}")


def _is_count(value: object) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and bool(value >= 0)


def _checked_damping(model: FiniteElementModel, matrix: Matrix | float | None) -> Matrix | None:
    if np.isscalar(matrix):
        if not (is_number(matrix) and 0 <= matrix < np.inf):
            raise InputError(f"craig_bampton: a loss factor must be finite and not negative, got {matrix!r:.60}")
        return float(matrix) * model.stiffness
    return None if matrix is None else checked_symmetric(matrix, len(model.dofs), f"model {model.name!r}: structural damping")


def _report(
    interior: Interior, max_frequency_hz: float | None, accuracy: float | None, verified: float | None
) -> ReductionReport:
    n = interior.part.b.size + interior.raw.shape[1]
    return ReductionReport(
        method="Hurty/Craig-Bampton",
        n_modes=interior.modes.shape[1],
        n_residual=interior.ritz.shape[1],
        blocks=interior.blocks,
        drawn_from=interior.drawn_from if isinstance(interior, Drawn) else None,
        complete_below_hz=float(np.sqrt(interior.complete)) / (2 * np.pi),
        proved=interior.proved,
        residuals=interior.residuals,
        max_frequency_hz=max_frequency_hz,
        accuracy=accuracy,
        verified=verified,
        basis_bytes=basis_bytes(interior.part.model, n),
    )
