"""Frequency response G(s) = C (E s - A)^-1 B + D at s = 2 pi i f (equations 25-27)."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import xarray as xr

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, real_values
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace
from flexplant.response.first_order import descriptor_response, state_space_response
from flexplant.response.modal_sum import modal_response

Plant: TypeAlias = ModalPlant | StateSpace | Descriptor


def frequency_response(plant: Plant, frequency_hz: npt.ArrayLike) -> xr.DataArray:
    """Complex response of a plant, dims (output, input, frequency), frequencies in Hz as given.

    Modal plants: sum over modes in real arithmetic, or the pole-residue form of the fully damped system. State space: poles
    and residues where the eigenvectors are well conditioned, a Schur form otherwise; discrete plants at z = exp(2 pi i f dt).
    Descriptors: one sparse factorisation a frequency. Raises InputError for frequencies that are negative, NaN or none, and
    for one that lies exactly on an undamped pole (at 0 Hz: on a rigid-body mode that the outputs see), naming the mode.
    """
    hz = checked_frequencies(frequency_hz)
    if isinstance(plant, ModalPlant):
        values = modal_response(plant, hz)
    elif isinstance(plant, StateSpace):
        values = state_space_response(plant, hz)
    elif isinstance(plant, Descriptor):
        values = descriptor_response(plant, hz)
    else:
        raise InputError(f"frequency_response needs a ModalPlant, StateSpace or Descriptor, got {type(plant).__name__}")
    return xr.DataArray(
        values,
        dims=("output", "input", "frequency"),
        coords={
            "output": list(plant.outputs),
            "input": list(plant.inputs),
            "frequency": ("frequency", hz, {"units": "Hz"}),
            "output_units": ("output", list(plant.output_units)),
            "input_units": ("input", list(plant.input_units)),
        },
        name="frequency_response",
        attrs={"plant": plant.name},
    )


def checked_frequencies(frequency_hz: npt.ArrayLike) -> FloatArray:
    """(nf,) finite frequencies that are not negative, Hz; InputError otherwise."""
    hz = np.atleast_1d(real_values(frequency_hz, "frequency_hz"))
    if hz.ndim != 1 or not hz.size:
        raise InputError(f"frequency_hz must be a non-empty list of frequencies, got shape {hz.shape}")
    bad = np.flatnonzero(~np.isfinite(hz) | (hz < 0))
    if bad.size:
        raise InputError(f"frequency_hz: entry {bad[0]} is {hz[bad[0]]}; frequencies must be finite and not negative")
    return hz
