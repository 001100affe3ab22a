"""Figures and tables of modes: contributions to the outputs, frequencies beside a reference."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike, NDArray

from flexplant.errors import InputError
from flexplant.report.figures.theme import ACCENT, GREY, HZ, PALETTE, Axis, Mark, annotate, blank, decade_ticks, plain

FloatArray = NDArray[np.float64]


def mode_contributions(
    frequency_hz: ArrayLike,
    contributions: Mapping[str, ArrayLike],
    *,
    title: str = "Contribution of each mode",
    label: str = "Residue over the largest (-)",
    names: Sequence[str] | None = None,
    marks: Sequence[Mark] = (),
) -> go.Figure:
    """A stem at each mode's frequency, as high as its contribution (residue, peak gain), one colour an output.

    frequency_hz: (n,), rigid-body modes (0 Hz) are left out; contributions: output -> (n,) not negative; names: one a mode.
    marks: (Hz, value) of modes to point at, such as one that must be absent. Raises InputError where lengths differ.
    """
    hz = np.asarray(frequency_hz, dtype=float)
    texts = list(names) if names is not None else [f"mode {i + 1}" for i in range(hz.size)]
    figure = blank(title, HZ, [Axis(label, "log", exponent=True)], size=430)
    outputs = {name: np.asarray(given, dtype=float) for name, given in contributions.items()}
    floor = _decade_below(hz, outputs.values())
    for number, (name, values) in enumerate(outputs.items()):
        if values.shape != hz.shape or len(texts) != hz.size:
            raise InputError(f"figure: {values.shape} contributions of {name!r} and {len(texts)} names for {hz.size} modes")
        shown = np.flatnonzero((hz > 0) & (values > 0))
        stems = _stems(hz[shown] * (1 + 0.003 * number), values[shown], [texts[int(i)] for i in shown], floor)
        for trace in stems:
            trace.update(name=plain(name), legendgroup=plain(name))
            trace.update(line_color=PALETTE[number % len(PALETTE)], marker_color=PALETTE[number % len(PALETTE)])
        figure.add_traces(stems, rows=[1, 1], cols=[1, 1])
    figure.update_xaxes(nticks=3)  # modes often span one decade, where more would crowd
    decade_ticks(figure, row=1, most=6)
    annotate(figure, marks, log_y=True)
    return figure


def _decade_below(hz: FloatArray, outputs: Iterable[FloatArray]) -> float:
    """Where the stems start: the decade below the smallest contribution, or below 1 where there is none."""
    smallest = min(
        (values[(hz > 0) & (values > 0)].min(initial=1.0) for values in outputs if values.shape == hz.shape), default=1.0
    )
    return float(10.0 ** np.floor(np.log10(smallest)))


def _stems(x: FloatArray, y: FloatArray, texts: Sequence[str], floor: float) -> list[go.Scatter]:
    """Stems from the floor up to each value, and their heads; one line with gaps is far lighter than many bars."""
    stem_x = np.repeat(x, 3).astype(np.float32)
    stem_y = np.column_stack([np.full(x.size, floor), y, np.full(x.size, np.nan)]).ravel().astype(np.float32)
    stems = go.Scatter(x=stem_x, y=stem_y, mode="lines", line={"width": 1}, showlegend=False, hoverinfo="skip")
    heads = go.Scatter(x=x.astype(np.float32), y=y.astype(np.float32), mode="markers", marker={"size": 4.5})
    heads.update(text=[plain(text) for text in texts], hovertemplate="%{text}<br>%{x:.5g} Hz<br>%{y:.3g}")
    return [stems, heads]


def frequency_comparison(
    labels: Sequence[str],
    error_percent: ArrayLike,
    *,
    title: str = "Frequency error of the reduced model",
    limit_percent: float | None = None,
) -> go.Figure:
    """Bars of each mode's frequency error against the reference, in percent on a log axis, red above the limit."""
    error = np.abs(np.asarray(error_percent, dtype=float))
    over = error > (np.inf if limit_percent is None else limit_percent)
    figure = blank(title, Axis("Mode"), [Axis("|Error| (%)", "log", exponent=True)], size=360)
    figure.update_xaxes(type="category")
    colours = [ACCENT if bad else PALETTE[0] for bad in over]
    figure.add_trace(
        go.Bar(
            x=[plain(t) for t in labels], y=error, marker={"color": colours}, hovertemplate="%{x}<br>%{y:.3g} %<extra></extra>"
        )
    )
    if limit_percent is not None:
        figure.add_hline(
            y=limit_percent, line={"color": GREY, "width": 1, "dash": "dash"}, annotation_text=f"limit {limit_percent:g} %"
        )
    figure.update_layout(showlegend=False)
    return figure
