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
from flexplant.loop.frequency import ComplexArray, Linear, frequency_response
from flexplant.loop.unstable import refuse_unstable
from flexplant.model.arrays import FloatArray, checked_switch, real_values
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace
from flexplant.response.band_variance import band_variance, poles_and_residues
from flexplant.response.frequency import checked_frequencies
from flexplant.response.grids import adaptive_grid
from flexplant.response.quadrature import integrated

SMALL = 300  # states of a diagram up to which its closed poles are found
Spectra = Mapping[str, Any] | npt.ArrayLike


def random_response(system: Linear, psd: Spectra, frequency_hz: npt.ArrayLike, *, cross: bool = False) -> xr.Dataset:
    """Output spectra G_y = H G_u H^H and RMS for one-sided input spectra in unit^2 / Hz.

    psd: a mapping input name -> number, (nf,) values at frequency_hz, or a pair of tables (hz, values) taken linearly between
    its points and zero outside; inputs left out are zero and all are uncorrelated. Or a (nu, nu, nf) array of cross-spectra,
    Hermitian and not negative. frequency_hz: ascending (see `adaptive_grid`).

    Returns `psd` (output, frequency); `cumulative_rms` (output, frequency) from the lowest frequency up and
    `cumulative_rms_down` from the highest down, by the trapezoidal rule; `rms` their total; `rms_exact` the same band without a
    grid error, for input spectra linear between the frequencies: from poles and residues, or, for rigid-body modes, critically
    damped poles, descriptors and loops of more than 300 states, by Gauss quadrature refined to 1e-9 of the variance.
    cross=True adds `cross` (output, output_2, frequency).
    Raises InputError for frequencies that do not ascend, unknown inputs, spectra that are negative or not Hermitian, and for an
    unstable system, naming a pole.
    """
    if not isinstance(system, Diagram | ModalPlant | StateSpace | Descriptor):
        raise InputError(f"random_response needs a plant, a block or a Diagram, got {type(system).__name__}")
    checked_switch(cross, "random_response: cross")
    hz = checked_frequencies(frequency_hz)
    if hz.size < 2 or (np.diff(hz) <= 0).any():
        raise InputError("random_response: frequency_hz must ascend and have at least two values; sort it and drop equal ones")
    names = list(system.inputs)
    refuse_unstable(system, "random_response")
    spectra = _diagonal(psd, names, hz) if isinstance(psd, Mapping) else _cross(psd, names, hz)
    G = frequency_response(system, hz).values
    values = output_spectra(G, spectra)
    data = {"psd": (("output", "frequency"), values), **_rms(values, hz)}
    data["rms_exact"] = (("output",), _exact(system, spectra, hz))
    if cross:
        through: Any = G * np.sqrt(spectra.real) if spectra.ndim == 2 else np.einsum("oif,ijf->ojf", G, _root(spectra))
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


def output_spectra(G: ComplexArray, spectra: FloatArray | ComplexArray) -> FloatArray:
    """(ny, nf) diagonal of G S G^H, for S (nu, nf) of uncorrelated inputs or (nu, nu, nf)."""
    if spectra.ndim == 2:
        return np.asarray(np.einsum("oif,if->of", abs(G) ** 2, spectra))
    return np.asarray(np.maximum(np.einsum("oif,ijf,ojf->of", G, spectra, G.conj(), optimize=True).real, 0.0))


def _exact(system: Linear, spectra: FloatArray | ComplexArray, hz: FloatArray) -> FloatArray:
    form = _poles_of(system)
    lasting = np.zeros(0) if form is None else abs(form[0].imag[form[0].real >= 0]) / (2 * np.pi)
    if ((lasting >= hz[0]) & (lasting <= hz[-1])).any():
        return np.full(len(system.outputs), np.inf)
    variance = _by_quadrature(system, spectra, hz) if form is None or lasting.size else band_variance(form, hz, spectra)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _poles_of(system: Linear) -> tuple[ComplexArray, ComplexArray, ComplexArray, FloatArray] | None:
    """Poles and residues where they are cheap and well conditioned."""
    if isinstance(system, Descriptor):
        return None
    if isinstance(system, Diagram):
        if sum(2 * b.n_modes if isinstance(b, ModalPlant) else getattr(b, "n_states", 0) for b in system.blocks.values()) > SMALL:
            return None
        system = close(system)
    return poles_and_residues(system)


def _by_quadrature(system: Linear, spectra: FloatArray | ComplexArray, hz: FloatArray) -> FloatArray:
    """Gauss quadrature over panels that end at the given frequencies and are dense about the poles of the blocks."""
    blocks = list(system.blocks.values()) if isinstance(system, Diagram) else [system]
    edges = [hz]
    if hz[0] > 0:
        edges.append(np.geomspace(hz[0], hz[-1], 2 + int(8 * np.log10(hz[-1] / hz[0])))[1:-1])
    for block in blocks:
        if isinstance(block, ModalPlant) or (isinstance(block, StateSpace) and block.n_states):
            low = max(hz[0], 1e-6 * hz[-1])
            edges.append(adaptive_grid(block, low, hz[-1], per_mode=7, per_decade=8))
    flat = spectra.reshape(-1, hz.size)

    def density(at: FloatArray) -> FloatArray:
        between: Any = np.stack([np.interp(at, hz, row) for row in flat]).reshape(*spectra.shape[:-1], at.size)
        return output_spectra(frequency_response(system, at).values, between)

    return integrated(density, np.unique(np.concatenate(edges)))


def _diagonal(psd: Mapping[str, Any], names: list[str], hz: FloatArray) -> FloatArray:
    out = np.zeros((len(names), hz.size))
    for name, given in psd.items():
        if name not in names:
            raise InputError(f"random_response: no input {name!r:.60}." + nearest(name, names))
        out[names.index(name)] = _spectrum(given, str(name), hz)
    return out


def _spectrum(given: Any, name: str, hz: FloatArray) -> FloatArray:
    if isinstance(given, tuple):
        table: list[FloatArray] = [real_values(part, f"input {name!r}: table") for part in given]
        if len(table) != 2 or table[0].ndim != 1 or table[0].shape != table[1].shape or (np.diff(table[0]) <= 0).any():
            raise InputError(f"input {name!r}: a table is a pair (hz, values) of equal length, hz ascending")
        values = np.asarray(np.interp(hz, table[0], table[1], left=0.0, right=0.0))
    else:
        values = real_values(given, f"input {name!r}: PSD")
    if values.shape not in ((), hz.shape):
        raise InputError(f"input {name!r}: PSD of shape {values.shape}; one number, {hz.shape} values, or a pair (hz, values)")
    if not np.isfinite(values).all() or (values < 0).any():
        raise InputError(f"input {name!r}: a PSD must be finite and not negative")
    return np.broadcast_to(values, hz.shape)


def _cross(psd: Any, names: list[str], hz: FloatArray) -> ComplexArray:
    """(nu, nu, nf) cross-spectra, checked: Hermitian and not negative at every frequency."""
    try:
        given = np.asarray(psd, dtype=complex)
    except (TypeError, ValueError, OverflowError):
        raise InputError("random_response: psd is neither a mapping of inputs nor an array of cross-spectra") from None
    nu = len(names)
    if given.shape != (nu, nu, hz.size):
        raise InputError(f"random_response: cross-spectra of shape {given.shape}, but {(nu, nu, hz.size)} is needed")
    matrices = given.transpose(2, 0, 1)
    size = abs(matrices).max(initial=0.0)
    if not np.isfinite(matrices).all() or (abs(matrices - matrices.conj().transpose(0, 2, 1)) > 1e-10 * size).any():
        raise InputError("random_response: the cross-spectra must be finite and Hermitian at every frequency")
    smallest = np.linalg.eigvalsh(matrices)[:, 0]
    if (smallest < -1e-10 * size).any():
        k = int(np.argmin(smallest))
        raise InputError(f"random_response: the cross-spectra are not positive at {hz[k]:.6g} Hz (coherence above one)")
    return given


def _root(spectra: Any) -> ComplexArray:
    """(nu, nu, nf) factors R with R R^H = the cross-spectra."""
    values, vectors = np.linalg.eigh(spectra.transpose(2, 0, 1))
    root: ComplexArray = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    return root.transpose(1, 2, 0)
