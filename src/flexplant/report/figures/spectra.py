"""Figures of random response: power spectra, and how the RMS builds up over frequency."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go
import xarray as xr

from flexplant.report.figures.theme import HZ, Axis, blank, line, plain, thin_out


def spectra(results: Mapping[str, xr.Dataset], *, title: str = "Random response") -> go.Figure:
    """PSD above, cumulative RMS from the lowest frequency up below; the RMS of the band stands in the legend.

    results: label -> `random_response(...)` of one output.
    """
    units = {str(r["output_units"].item()) if "output_units" in r.coords else "" for r in results.values()}
    unit = units.pop() if len(units) == 1 else ""
    axes = [Axis(f"PSD ({unit or '1'}²/Hz)", "log", exponent=True), Axis(f"RMS below ({unit or '1'})", "log", exponent=True)]
    figure = blank(title, HZ, axes, heights=(0.6, 0.4), size=560)
    for number, (label, result) in enumerate(results.items()):
        name = f"{label}, RMS {float(result['rms']):.3g} {unit}".rstrip()
        for row, (kind, hover) in enumerate({"psd": f"{unit or '1'}²/Hz", "cumulative_rms": unit}.items(), start=1):
            values = np.asarray(result[kind].values, dtype=float)
            hz = np.asarray(result["frequency"].values, dtype=float)
            drawn = (values > 0) & np.isfinite(values) & (hz > 0)
            keep = np.flatnonzero(drawn)[thin_out(np.log(values[drawn]))] if drawn.any() else np.zeros(0, dtype=int)
            text = f"%{{x:.5g}} Hz<br>%{{y:.4g}} {plain(hover)}"
            figure.add_trace(line(hz[keep], values[keep], name=name, number=number, legend=row == 1, hover=text), row=row, col=1)
    return figure
