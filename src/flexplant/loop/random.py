"""Random response: input power spectra to output power spectra and RMS, of plants and of whole loops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from flexplant.errors import InputError, nearest
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.frequency import Linear, frequency_response
from flexplant.model.arrays import FloatArray
from flexplant.plant.state_space import Descriptor
from flexplant.response.band_variance import band_variance, poles_and_residues
from flexplant.response.frequency import checked_frequencies

Spectra = Mapping[str, Any] | npt.ArrayLike


def random_response(system: Linear, psd: Spectra, frequency_hz: npt.ArrayLike, *, cross: bool = False) -> xr.Dataset:
    """Output spectra G_y = H G_u H^H and RMS for one-sided input spectra in unit^2 / Hz.

    psd: a mapping input name -> number, (nf,) values at frequency_hz, or a pair of tables (hz, values) taken linearly between
    its points and zero outside; inputs left out are zero and all are uncorrelated. Or a (nu, nu, nf) array of cross-spectra,
    Hermitian and not negative. frequency_hz: ascending (see `adaptive_grid`).

    Returns `psd` (output, frequency); `cumulative_rms` (output, frequency) from the lowest frequency up and
    `cumulative_rms_down` from the highest down, by the trapezoidal rule; `rms` their total; `rms_exact` the same band without a
    grid error, from poles and residues, for input spectra linear between the frequencies (NaN where the system has no such
    form: rigid-body modes, critically damped poles, cross-spectra). cross=True adds `cross` (output, output_2, frequency).
    Raises InputError for frequencies that do not ascend, unknown inputs, spectra that are negative or not Hermitian.
    """
    hz = checked_frequencies(frequency_hz)
    if hz.size < 2 or (np.diff(hz) <= 0).any():
        raise InputError("random_response: frequency_hz must ascend and have at least two values; sort it and drop equal ones")
    names = list(system.inputs)
    diagonal = _diagonal(psd, names, hz) if isinstance(psd, Mapping) else None
    G = frequency_response(system, hz).values
    if diagonal is not None:
        values = np.einsum("oif,if->of", abs(G) ** 2, diagonal)
        through = G * np.sqrt(diagonal)[None]
    else:
        through = np.einsum("oif,ijf->ojf", G, _root(psd, names, hz))
        values = (abs(through) ** 2).sum(axis=1)
    data = {"psd": (("output", "frequency"), values), **_rms(values, hz)}
    data["rms_exact"] = (("output",), _exact(system, diagonal, hz))
    if cross:
        data["cross"] = (("output", "output_2", "frequency"), np.einsum("ouf,puf->opf", through, through.conj()))
    coords = {"output": list(system.outputs), "frequency": ("frequency", hz, {"units": "Hz"})}
    return xr.Dataset(data, coords=coords, attrs={"plant": system.name})


def _rms(values: FloatArray, hz: FloatArray) -> dict[str, Any]:
    pieces = 0.5 * (values[:, 1:] + values[:, :-1]) * np.diff(hz)
    up = np.concatenate([np.zeros((len(values), 1)), np.cumsum(pieces, axis=1)], axis=1)
    down = np.concatenate([np.cumsum(pieces[:, ::-1], axis=1)[:, ::-1], np.zeros((len(values), 1))], axis=1)
    return {
        "cumulative_rms": (("output", "frequency"), np.sqrt(up)),
        "cumulative_rms_down": (("output", "frequency"), np.sqrt(down)),
        "rms": (("output",), np.sqrt(up[:, -1])),
    }


def _exact(system: Linear, diagonal: FloatArray | None, hz: FloatArray) -> FloatArray:
    plant = close(system) if isinstance(system, Diagram) else system
    form = None if diagonal is None or isinstance(plant, Descriptor) else poles_and_residues(plant)
    if form is None or diagonal is None:
        return np.full(len(system.outputs), np.nan)
    return np.sqrt(np.maximum(band_variance(form, hz, diagonal), 0.0))


def _diagonal(psd: Mapping[str, Any], names: list[str], hz: FloatArray) -> FloatArray:
    out = np.zeros((len(names), hz.size))
    for name, given in psd.items():
        if name not in names:
            raise InputError(f"random_response: no input {name!r}." + nearest(str(name), names))
        out[names.index(name)] = _spectrum(given, str(name), hz)
    return out


def _spectrum(given: Any, name: str, hz: FloatArray) -> FloatArray:
    if isinstance(given, tuple):
        table: list[FloatArray] = [np.asarray(part, dtype=float) for part in given]
        if len(table) != 2 or table[0].ndim != 1 or table[0].shape != table[1].shape or (np.diff(table[0]) <= 0).any():
            raise InputError(f"input {name!r}: a table is a pair (hz, values) of equal length, hz ascending")
        values = np.asarray(np.interp(hz, table[0], table[1], left=0.0, right=0.0))
    else:
        values = np.asarray(given, dtype=float)
    if values.shape not in ((), hz.shape):
        raise InputError(f"input {name!r}: PSD of shape {values.shape}; one number, {hz.shape} values, or a pair (hz, values)")
    if not np.isfinite(values).all() or (values < 0).any():
        raise InputError(f"input {name!r}: a PSD must be finite and not negative")
    return np.broadcast_to(values, hz.shape)


def _root(psd: Any, names: list[str], hz: FloatArray) -> npt.NDArray[np.complex128]:
    """(nu, nu, nf) factors R with R R^H = the cross-spectra."""
    given = np.asarray(psd, dtype=complex)
    nu = len(names)
    if given.shape != (nu, nu, hz.size):
        raise InputError(f"random_response: cross-spectra of shape {given.shape}, but {(nu, nu, hz.size)} is needed")
    matrices = given.transpose(2, 0, 1)
    size = abs(matrices).max(initial=0.0)
    if not np.isfinite(matrices).all() or (abs(matrices - matrices.conj().transpose(0, 2, 1)) > 1e-10 * size).any():
        raise InputError("random_response: the cross-spectra must be finite and Hermitian at every frequency")
    values, vectors = np.linalg.eigh(matrices)
    if (values < -1e-10 * size).any():
        k = int(np.argmin(values[:, 0]))
        raise InputError(f"random_response: the cross-spectra are not positive at {hz[k]:.6g} Hz (coherence above one)")
    root: npt.NDArray[np.complex128] = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    return root.transpose(1, 2, 0)
