"""Frequency response with structural (hysteretic) damping, of an unreduced model and of a plant, for fair comparisons."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import xarray as xr

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray
from flexplant.model.component import FiniteElementModel
from flexplant.numerics.sweep import PencilSweep
from flexplant.plant.modal import ModalPlant
from flexplant.response.frequency import checked_frequencies


def direct_response(
    model: FiniteElementModel,
    *,
    inputs: Sequence[tuple[int, int]],
    outputs: Sequence[tuple[int, int]],
    frequency_hz: npt.ArrayLike,
    structural_damping: float = 0.0,
    each: Callable[[int], None] | None = None,
) -> xr.DataArray:
    """Displacements of unit forces, one sparse complex-symmetric solution a frequency:

        [K (1 + i g) - w^2 M] u = f,   g = structural_damping

    inputs, outputs: (node, direction). each: called with the number of finished frequencies. Dims (output, input, frequency).
    Nothing is reduced, so this is the yardstick of a reduced plant; g = 2 zeta gives the resonance peaks of a viscous ratio
    zeta. Raises ModelError for a DOF that the model does not have, SolverError where the matrix is singular.
    """
    hz = checked_frequencies(frequency_hz)
    owner = f"model {model.name!r}"
    columns, rows = (model.dofs.rows(list(pairs), owner=owner) for pairs in (inputs, outputs))
    force = np.zeros((len(model.dofs), len(columns)), dtype=complex)
    force[columns, np.arange(len(columns))] = 1.0
    pencil = PencilSweep(model.stiffness, model.mass)
    values = np.empty((len(rows), len(columns), hz.size), dtype=complex)
    for k, omega in enumerate(2 * np.pi * hz):
        values[:, :, k] = pencil.factor(1 + 1j * structural_damping, -(omega**2)).solve(force)[rows]
        if each is not None:
            each(k + 1)
    names = [[f"{node}.{direction}" for node, direction in pairs] for pairs in (outputs, inputs)]
    return _labelled(values, names[0], names[1], hz)


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
