"""Figure of the steady state under tones: a line spectrum, each tone's amplitude at its frequency."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go
import xarray as xr
from numpy.typing import NDArray

from flexplant.report.figures.theme import HZ, Axis, blank, line, plain

FLOOR = 1e-9  # of the largest amplitude: what is smaller is not drawn


def line_spectrum(results: Mapping[str, xr.DataArray], *, unit: str = "", title: str = "Response to tones") -> go.Figure:
    """A vertical line up to |Y| at every tone, and a dot at its end; the RMS of all tones stands in the legend.

    A constant (0 Hz) has no place on the axis, and counts in full in the RMS.

    results: label -> `harmonic_response(...)` of one output, complex (output, frequency); unit: of the outputs.
    """
    sizes = {label: abs(np.asarray(result.values, dtype=complex)).ravel() for label, result in results.items()}
    floor = FLOOR * max((float(np.max(size, initial=0.0)) for size in sizes.values()), default=0.0)
    lowest = min((float(np.min(size[size > floor], initial=np.inf)) for size in sizes.values()), default=np.inf) / 3
    figure = blank(title, HZ, [Axis(f"Amplitude ({unit or '1'})", "log", exponent=True)], size=460)
    for number, (label, result) in enumerate(results.items()):
        every = np.asarray(result["frequency"].values, dtype=float)
        drawn = np.flatnonzero((sizes[label] > floor) & (every > 0))
        hz, tops = every[drawn], sizes[label][drawn]
        rms = np.sqrt(np.sum(np.where(every > 0, 0.5, 1.0) * abs(_constant_or_tone(result, every)) ** 2))
        name = f"{label}, RMS {rms:.3g} {unit}".rstrip()
        gap = np.full(hz.size, np.nan)
        stems = np.stack([hz, hz, gap], axis=1).ravel(), np.stack([np.full(hz.size, lowest), tops, gap], axis=1).ravel()
        text = f"%{{x:.5g}} Hz<br>%{{y:.4g}} {plain(unit)}"
        trace = line(*stems, name=name, number=number, hover=text)
        trace.update(mode="lines+markers", marker={"size": np.tile([0, 7, 0], hz.size)})
        figure.add_trace(trace, row=1, col=1)
    return figure


def _constant_or_tone(result: xr.DataArray, hz: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Amplitudes; of a constant only the real part moves anything."""
    values = np.asarray(result.values, dtype=complex).ravel()
    return np.where(hz > 0, values, values.real)
