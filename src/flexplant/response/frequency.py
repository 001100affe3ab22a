"""Frequency response G(s) = C (E s - A)^-1 B + D at s = i 2 pi f."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
import xarray as xr
from scipy.sparse.linalg import splu

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, dense
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace, state_space

Plant = ModalPlant | StateSpace | Descriptor


def frequency_response(plant: Plant, frequency_hz: npt.ArrayLike) -> xr.DataArray:
    """Complex response, dims (output, input, frequency); coordinate `frequency` in Hz."""
    hz = checked_frequencies(frequency_hz)
    values = _sparse(plant, hz) if isinstance(plant, Descriptor) else _solve(state_space(plant), hz)
    return xr.DataArray(
        values,
        dims=("output", "input", "frequency"),
        coords={"output": list(plant.outputs), "input": list(plant.inputs), "frequency": hz},
        name="frequency_response",
    )


def checked_frequencies(frequency_hz: npt.ArrayLike) -> FloatArray:
    """(nf,) finite frequencies that are not negative, Hz; InputError otherwise."""
    hz = np.atleast_1d(np.asarray(frequency_hz, dtype=float))
    if hz.ndim != 1 or not hz.size:
        raise InputError(f"frequency_hz must be a non-empty list of frequencies, got shape {hz.shape}")
    bad = np.flatnonzero(~np.isfinite(hz) | (hz < 0))
    if bad.size:
        raise InputError(f"frequency_hz: entry {bad[0]} is {hz[bad[0]]}; frequencies must be finite and not negative")
    return hz


def _solve(system: StateSpace, hz: FloatArray) -> Any:
    s = 2j * np.pi * hz
    s = s if system.dt is None else np.exp(s * system.dt)
    out = np.empty((len(system.outputs), len(system.inputs), hz.size), dtype=complex)
    for k, point in enumerate(s):
        out[:, :, k] = system.C @ np.linalg.solve(point * np.eye(system.n_states) - system.A, system.B) + system.D
    return out


def _sparse(system: Descriptor, hz: FloatArray) -> Any:
    out = np.empty((len(system.outputs), len(system.inputs), hz.size), dtype=complex)
    for k, point in enumerate(2j * np.pi * hz):
        factor = splu(sp.csc_array(point * system.E - system.A))
        out[:, :, k] = system.C @ factor.solve(dense(system.B).astype(complex)) + system.D
    return out
