"""The figure of a broken loop: largest singular values of L, S and T, with their peaks and the disk margin."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go
import xarray as xr

from flexplant.report.figures.theme import DASHES, GREY, HZ, Axis, Mark, annotate, blank, line, thin_out

CURVES = {"L_singular": "loop gain L", "S_singular": "sensitivity S", "T_singular": "complementary sensitivity T"}


def broken_loop(results: Mapping[str, xr.Dataset], *, title: str = "The loop, broken at its signals") -> go.Figure:
    """sigma_max of L, S and T in dB above, the disk margin over frequency below.

    results: label -> `loop_response(...)`; several labels take a dash each.
    """
    figure = blank(title, HZ, [Axis("Largest singular value (dB)"), Axis("Disk margin", "log")], heights=(0.7, 0.3), size=560)
    marks = []
    for place, (label, result) in enumerate(results.items()):
        hz, dash = np.asarray(result["frequency"].values, dtype=float), DASHES[place % len(DASHES)]
        ahead = f"{label}: " if label else ""
        for number, (kind, text) in enumerate(CURVES.items()):
            level = 20 * np.log10(np.maximum(result[kind].values.max(axis=1), np.finfo(float).tiny))
            keep = thin_out(level)
            hover = "%{x:.5g} Hz<br>%{y:.3f} dB"
            trace = line(hz[keep], level[keep], name=ahead + text, number=number, hover=hover, dash=dash)
            figure.add_trace(trace, row=1, col=1)
        disk = np.asarray(result["disk"].values, dtype=float)
        keep = thin_out(np.log(np.maximum(disk, np.finfo(float).tiny)))
        hover = "%{x:.5g} Hz<br>%{y:.3g}"
        trace = line(hz[keep], disk[keep], name=f"{ahead}disk margin", number=3, hover=hover, dash=dash)
        figure.add_trace(trace, row=2, col=1)
        if len(results) == 1:
            peaks = {k: (float(result[f"{k}_peak_hz"]), float(result[f"{k}_peak"])) for k in "ST"}
            marks = [
                Mark(at, f"{k} {top:.3g}", 20 * np.log10(top)) for k, (at, top) in peaks.items() if at > 0 and np.isfinite(top)
            ]
            least = float(result["disk_margin"])
            annotate(figure, [Mark(float(result["disk_margin_hz"]), f"least {least:.3g}", least)], row=2, log_y=True)
    figure.add_hline(y=0, line={"color": GREY, "width": 1}, row=1, col=1)
    annotate(figure, marks)
    return figure
