"""Frequency response with structural (hysteretic) damping: of coupled systems, unreduced models and modal plants."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg as la
import scipy.sparse as sp
import xarray as xr

from flexplant.assembly import System
from flexplant.errors import InputError, SolverError
from flexplant.model.arrays import FloatArray, Matrix, checked_symmetric, is_number
from flexplant.model.component import FiniteElementModel
from flexplant.numerics.sweep import PencilSweep
from flexplant.plant.channels import checked_system, input_matrix, output_matrices
from flexplant.plant.modal import ModalPlant
from flexplant.response.frequency import checked_frequencies

DENSE_LIMIT = 400  # coordinates up to which a dense solution costs less than a sparse one of such full matrices
DENSE_SHARE = 0.2  # stored entries of all matrices over n^2, above which they are full
SINGULAR = 1e13  # growth of a solution beside its right side, in a scaled matrix, that only a singular one has


def direct_response(
    model: FiniteElementModel,
    *,
    inputs: Sequence[tuple[int, int]],
    outputs: Sequence[tuple[int, int]],
    frequency_hz: npt.ArrayLike,
    structural_damping: float | Matrix = 0.0,
    each: Callable[[int], None] | None = None,
) -> xr.DataArray:
    """Displacements of unit forces, one sparse complex-symmetric solution a frequency:

        [K + i D + i w Z - w^2 M] u = f

    structural_damping: the matrix D (n, n), or a loss factor g for D = g K. Z is the model's own damping, if it has one.
    inputs, outputs: (node, direction). each: called with the number of finished frequencies. Dims (output, input, frequency).
    Nothing is reduced, so this is the yardstick of a reduced plant; g = 2 zeta gives the resonance peaks of a viscous ratio
    zeta. Raises ModelError for a DOF that the model does not have, SolverError where the matrix is singular.
    """
    hz = checked_frequencies(frequency_hz)
    owner = f"model {model.name!r}"
    columns, rows = (model.dofs.rows(list(pairs), owner=owner) for pairs in (inputs, outputs))
    force = np.zeros((len(model.dofs), len(columns)), dtype=complex)
    force[columns, np.arange(len(columns))] = 1.0
    loss = structural_damping * model.stiffness if is_number(structural_damping) else structural_damping
    terms = _Terms.of(model.stiffness, checked_symmetric(loss, len(model.dofs), f"{owner}: D"), model.damping, model.mass)
    pencil = PencilSweep(*terms.matrices)
    values = np.empty((len(rows), len(columns), hz.size), dtype=complex)
    for k, omega in enumerate(2 * np.pi * hz):
        values[:, :, k] = pencil.factor(*terms.coefficients(omega)).solve(force)[rows]
        if each is not None:
            each(k + 1)
    names = [[f"{node}.{direction}" for node, direction in pairs] for pairs in (outputs, inputs)]
    return _labelled(values, names[0], names[1], hz)


@dataclass(frozen=True, eq=False)
class _Terms:
    """K + i D + i w Z - w^2 M as the matrices that are there, and their coefficients at w."""

    matrices: tuple[Any, ...]
    there: tuple[bool, bool]

    @classmethod
    def of(cls, stiffness: Any, structural: Any, damping: Any, mass: Any) -> _Terms:
        there = (structural is not None, damping is not None)
        return cls(tuple(m for m in (stiffness, mass, structural, damping) if m is not None), there)

    def coefficients(self, omega: float) -> list[complex]:
        return [1.0, -(omega**2), *[c for c, there in zip((1j, 1j * omega), self.there, strict=True) if there]]

    def sum(self, omega: float) -> Any:
        return sum(c * m for c, m in zip(self.coefficients(omega), self.matrices, strict=True))


def structural_frequency_response(
    system: System, *, inputs: Sequence[str], outputs: Sequence[str], frequency_hz: npt.ArrayLike
) -> xr.DataArray:
    """Response of a coupled system with the structural damping D of its components, solved directly at each frequency:

        [K + i D + i w Z - w^2 M] p = F u,   y = [C + i w Cv - w^2 Ca] p + C_f (F u - i D p)

    in the eliminated coordinates, with every mode of the system. D is block diagonal over the components and coupled like K;
    interface forces C_f of rigid connections take part of it. Names as for `modal_plant`. Dims (output, input, frequency).
    Large systems: complex-symmetric factors that share one symbolic analysis. Raises InputError for unknown names, SolverError
    where the matrix is singular (a free system at 0 Hz).
    """
    checked_system(system, "structural_frequency_response")
    hz = checked_frequencies(frequency_hz)
    columns, rows = input_matrix(system, inputs), output_matrices(system, outputs)
    basis, structural = system.basis, system.uncoupled_structural_damping
    uncoupled = (system.uncoupled_stiffness, structural, system.uncoupled_damping, system.uncoupled_mass)
    terms = _Terms.of(*(None if m is None else sp.csr_array(basis.T @ m @ basis) for m in uncoupled))
    output = [None if m is None else sp.csr_array(m @ basis) for m in (rows.displacement, rows.velocity, rows.acceleration)]
    if rows.force is not None and structural is not None:
        output[0] = output[0] - 1j * (rows.force @ structural @ basis)
    feedthrough = 0.0 if rows.force is None else (rows.force @ columns.matrix).toarray()
    force = (basis.T @ columns.matrix).toarray().astype(complex)
    solve = _solver(terms)
    values = np.empty((len(rows.names), len(columns.names), hz.size), dtype=complex)
    for k, omega in enumerate(2 * np.pi * hz):
        z = solve(omega, force)
        parts = zip((1.0, 1j * omega, -(omega**2)), output, strict=True)
        values[:, :, k] = sum((c * (m @ z) for c, m in parts if m is not None), start=feedthrough)
    out = _labelled(values, list(rows.names), list(columns.names), hz)
    return out.assign_coords(output_units=("output", list(rows.units)), input_units=("input", list(columns.units)))


def _solver(terms: _Terms) -> Callable[[float, Any], Any]:
    """(omega, right side) -> solution: dense where the matrices are small or full, else one analysis for all frequencies."""
    n = terms.matrices[0].shape[0]
    if n <= DENSE_LIMIT or sum(m.nnz for m in terms.matrices) > DENSE_SHARE * n * n:
        full = replace(terms, matrices=tuple(m.toarray() for m in terms.matrices))
        return lambda omega, right: _dense_solution(full.sum(omega), right)
    pencil = PencilSweep(*terms.matrices)
    return lambda omega, right: pencil.factor(*terms.coefficients(omega)).solve(right)


def _dense_solution(matrix: Any, right: Any) -> Any:
    scale = 1 / np.sqrt(np.maximum(abs(np.diagonal(matrix)), np.finfo(float).tiny))  # metres, radians and modal coordinates
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", la.LinAlgWarning)
            scaled, given = scale[:, None] * matrix * scale, scale[:, None] * right
            found = la.solve(scaled, given, assume_a="sym")
    except (la.LinAlgError, la.LinAlgWarning):
        found = None
    if found is None or abs(found).max(initial=0.0) * abs(scaled).max() > SINGULAR * abs(given).max(initial=0.0):
        raise SolverError(f"the matrix {matrix.shape} is singular at a frequency: leave 0 Hz out, or add damping")
    return scale[:, None] * found


def structural_response(plant: ModalPlant, frequency_hz: npt.ArrayLike, structural_damping: float) -> xr.DataArray:
    """The plant's displacement response with structural damping g in place of its viscous damping:

        G = shape_out diag(1 / (omega^2 (1 + i g) - w^2)) shape_in + static_correction / (1 + i g)

    Dims (output, input, frequency). Raises InputError for velocity or acceleration outputs, whose law would differ, and at
    0 Hz with rigid-body modes.
    """
    hz = checked_frequencies(frequency_hz)
    if any(rows is not None and np.any(rows) for rows in (plant.shape_out_velocity, plant.shape_out_acceleration)):
        raise InputError("structural_response: the plant has velocity or acceleration outputs; select displacement outputs first")
    if plant.n_rigid and not hz.all():
        raise InputError("structural_response: a free structure has no response at 0 Hz; leave that frequency out")
    assert plant.shape_out is not None
    loss = 1 + 1j * structural_damping
    receptance = 1 / (plant.omega[:, None] ** 2 * loss - (2 * np.pi * hz) ** 2)
    values = np.einsum("om,mf,mi->oif", plant.shape_out, receptance, plant.shape_in, optimize=True)
    if plant.static_correction is not None:
        values = values + plant.static_correction[:, :, None] / loss
    return _labelled(values, list(plant.outputs), list(plant.inputs), hz)


def _labelled(values: npt.NDArray[np.complex128], outputs: list[str], inputs: list[str], hz: FloatArray) -> xr.DataArray:
    coords = {"output": outputs, "input": inputs, "frequency": hz}
    return xr.DataArray(values, dims=("output", "input", "frequency"), coords=coords, name="frequency_response")
