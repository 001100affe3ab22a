"""Random response: input power spectra to output power spectra and RMS, of plants and of whole loops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from flexplant.errors import InputError
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.diagram_response import ComplexArray
from flexplant.loop.frequency import Linear, frequency_response
from flexplant.loop.spectra import Interpolation, Spectra, checked_spectra
from flexplant.loop.unstable import refuse_unstable
from flexplant.model.arrays import FloatArray, checked_switch
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace
from flexplant.response.band_variance import band_variance, poles_and_residues
from flexplant.response.frequency import checked_frequencies
from flexplant.response.grids import adaptive_grid
from flexplant.response.quadrature import panel_integrals

SMALL = 300  # states of a diagram up to which its closed poles are found


def random_response(
    system: Linear,
    psd: Mapping[str, Any] | npt.ArrayLike,
    frequency_hz: npt.ArrayLike,
    *,
    cross: bool = False,
    interpolation: Interpolation = "linear",
) -> xr.Dataset:
    """Output spectra G_y = H G_u H^H and RMS for one-sided input spectra in unit^2 / Hz.

    psd: a mapping input name -> number, (nf,) values at frequency_hz (linear between them), or a pair of tables (hz, values),
    zero outside; inputs left out are zero and all are uncorrelated. Or a (nu, nu, nf) array of cross-spectra, Hermitian and not
    negative. interpolation: how tables go between their lines, "linear", or "log" for straight lines on double logarithmic
    paper, as test specifications are drawn. frequency_hz: ascending (see `adaptive_grid`); its ends are the band.

    Returns `psd` (output, frequency); `rms` (output) of the band; `cumulative_rms` (output, frequency) from the lowest frequency
    up and `cumulative_rms_down` from the highest down. The three are exact for the input spectra, whatever the grid: from poles
    and residues, or, for rigid-body modes, critically damped poles, descriptors, loops of more than 300 states and
    logarithmic tables, by Gauss quadrature refined to 1e-9 of the variance. An undamped mode in the band makes them infinite.
    `rms_grid` (output) is the trapezoidal rule over `psd`: where it differs from `rms`, the grid is too coarse to read peaks off.
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
    spectra = checked_spectra(psd, list(system.inputs), hz, interpolation)
    refuse_unstable(system, "random_response")
    G = frequency_response(system, hz).values
    values = output_spectra(G, spectra.at_hz)
    data: dict[str, Any] = {"psd": (("output", "frequency"), values), **_rms(_variances(system, spectra))}
    data["rms_grid"] = (("output",), np.sqrt(np.trapezoid(values, hz, axis=1)))
    if cross:
        S: Any = spectra.at_hz
        through: Any = G * np.sqrt(S) if S.ndim == 2 else np.einsum("oif,ijf->ojf", G, _root(S))
        data["cross"] = (("output", "output_2", "frequency"), np.einsum("ouf,puf->opf", through, through.conj()))
    coords = {
        "output": list(system.outputs),
        "frequency": ("frequency", hz, {"units": "Hz"}),
        "output_units": ("output", list(system.output_units)),
    }
    return xr.Dataset(data, coords=coords, attrs={"plant": system.name})


def _rms(variances: FloatArray) -> dict[str, Any]:
    """RMS and its growth from the (ny, nf - 1) variances between the frequencies."""
    up, down = _growing(variances), _growing(variances[:, ::-1])[:, ::-1]
    return {
        "rms": (("output",), np.sqrt(up[:, -1])),
        "cumulative_rms": (("output", "frequency"), np.sqrt(up)),
        "cumulative_rms_down": (("output", "frequency"), np.sqrt(down)),
    }


def _growing(variances: FloatArray) -> FloatArray:
    """Running sums from zero that never fall: round-off of an interval may be negative."""
    sums = np.pad(np.cumsum(variances, axis=1), ((0, 0), (1, 0)))
    return np.asarray(np.maximum.accumulate(sums, axis=1))


def output_spectra(G: ComplexArray, spectra: FloatArray | ComplexArray) -> FloatArray:
    """(ny, nf) diagonal of G S G^H, for S (nu, nf) of uncorrelated inputs or (nu, nu, nf)."""
    if spectra.ndim == 2:
        return np.asarray(np.einsum("oif,if->of", abs(G) ** 2, spectra))
    return np.asarray(np.maximum(np.einsum("oif,ijf,ojf->of", G, spectra, G.conj(), optimize=True).real, 0.0))


def _variances(system: Linear, spectra: Spectra) -> FloatArray:
    """(ny, nf - 1) variance of each output between neighbouring frequencies."""
    form, edges = _poles_of(system), spectra.edges()
    lasting = np.zeros(0) if form is None else abs(form[0].imag[form[0].real >= 0]) / (2 * np.pi)
    if form is None or lasting.size or (spectra.log and spectra.tables):
        fine = _by_quadrature(system, spectra, edges, lasting)
    else:
        fine = band_variance(form, edges, *spectra.ends(edges))
    return np.asarray(np.add.reduceat(fine, np.searchsorted(edges, spectra.hz[:-1]), axis=1))


def _poles_of(system: Linear) -> tuple[ComplexArray, ComplexArray, ComplexArray, FloatArray] | None:
    """Poles and residues where they are cheap and well conditioned."""
    if isinstance(system, Descriptor):
        return None
    if isinstance(system, Diagram):
        if sum(2 * b.n_modes if isinstance(b, ModalPlant) else getattr(b, "n_states", 0) for b in system.blocks.values()) > SMALL:
            return None
        system = close(system)
    return poles_and_residues(system)


def _by_quadrature(system: Linear, spectra: Spectra, edges: FloatArray, lasting: FloatArray) -> FloatArray:
    """(ny, edges - 1) Gauss quadrature over panels dense about the poles; infinite where an undamped pole (Hz) lies."""
    panels = np.unique(np.concatenate([edges, *_dense_points(system, edges)]))
    touched = np.zeros(edges.size - 1, dtype=bool)
    for pole in lasting:
        touched |= (edges[:-1] <= pole) & (pole <= edges[1:])
    home = np.searchsorted(edges, panels[:-1], side="right") - 1
    open_ = ~touched[home]
    out = np.zeros((len(system.outputs), touched.size))
    out[:, touched] = np.inf
    if open_.any():

        def density(at: FloatArray) -> FloatArray:
            return output_spectra(frequency_response(system, at).values, spectra.between(at))

        found = panel_integrals(density, panels[:-1][open_], panels[1:][open_])
        np.add.at(out.T, home[open_], found.T)
    return out


def _dense_points(system: Linear, edges: FloatArray) -> list[FloatArray]:
    """Frequencies within the edges that follow the decades and the poles of the blocks."""
    low, high = edges[0], edges[-1]
    points = [np.geomspace(low, high, 2 + int(8 * np.log10(high / low)))[1:-1]] if low > 0 else []
    blocks = list(system.blocks.values()) if isinstance(system, Diagram) else [system]
    moving = [b for b in blocks if isinstance(b, ModalPlant) or (isinstance(b, StateSpace) and b.n_states)]
    return points + [adaptive_grid(b, max(low, 1e-6 * high), high, per_mode=7, per_decade=8) for b in moving]


def _root(spectra: Any) -> ComplexArray:
    """(nu, nu, nf) factors R with R R^H = the cross-spectra."""
    values, vectors = np.linalg.eigh(spectra.transpose(2, 0, 1))
    root: ComplexArray = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    return root.transpose(1, 2, 0)
