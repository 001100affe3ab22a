"""Figures and tables of modes: contributions to the outputs, frequencies beside a reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike

from flexplant.errors import InputError
from flexplant.report.figures.theme import ACCENT, GREY, HZ, PALETTE, Axis, Mark, annotate, blank, plain


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

    frequency_hz: (n,), rigid-body modes (0 Hz) are left out; contributions: output -> (n,) not negative; names: what each mode is.
    marks: (Hz, value) of modes to point at, such as one that must be absent. Raises InputError where lengths differ.
    """
    hz = np.asarray(frequency_hz, dtype=float)
    texts = list(names) if names is not None else [f"mode {i + 1}" for i in range(hz.size)]
    figure = blank(title, HZ, [Axis(label, "log", exponent=True)], size=430)
    for number, (name, given) in enumerate(contributions.items()):
        values = np.asarray(given, dtype=float)
        if values.shape != hz.shape or len(texts) != hz.size:
            raise InputError(f"figure: {values.shape} contributions of {name!r} and {len(texts)} names for {hz.size} modes")
        _stems(figure, name, hz, values, texts, number)
    annotate(figure, marks, log_y=True)
    return figure


def _stems(figure: go.Figure, name: str, hz: np.ndarray, values: np.ndarray, texts: Sequence[str], number: int) -> None:
    """Stems from the floor of the log axis up to each value; one line with gaps is far lighter than many bars."""
    shown = np.flatnonzero((hz > 0) & (values > 0))
    if shown.size == 0:
        return
    x, y = hz[shown] * (1 + 0.003 * number), values[shown]  # outputs of one mode side by side
    floor = 10.0 ** np.floor(np.log10(values[shown].min()))
    stem_x = np.repeat(x, 3).astype(np.float32)
    stem_y = np.column_stack([np.full(x.size, floor), y, np.full(x.size, np.nan)]).ravel().astype(np.float32)
    colour = PALETTE[number % len(PALETTE)]
    stems = go.Scatter(
        x=stem_x, y=stem_y, mode="lines", line={"color": colour, "width": 1.2}, legendgroup=plain(name), showlegend=False
    )
    stems.update(hoverinfo="skip")
    heads = go.Scatter(x=x, y=y, mode="markers", name=plain(name), legendgroup=plain(name), marker={"color": colour, "size": 5})
    heads.update(text=[plain(texts[i]) for i in shown], hovertemplate="%{text}<br>%{x:.5g} Hz<br>%{y:.3g}")
    figure.add_traces([stems, heads])


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
