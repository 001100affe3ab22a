"""How every figure looks: Okabe-Ito colours, thin lines, frequencies in Hz on log axes, units in every label."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike, NDArray
from plotly.subplots import make_subplots

# Okabe and Ito's palette, told apart by people with any colour vision; its black and yellow vanish on dark or white paper.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7F7F7F")
GREY, ACCENT = "#7F7F7F", "#D55E00"
DASHES = ("solid", "dot", "dash", "dashdot")
LINE_WIDTH = 1.4
POINTS_PER_CURVE = 6000
TEMPLATE = go.layout.Template(layout={"font": {"family": "system-ui, 'Segoe UI', 'DejaVu Sans', sans-serif", "size": 13}})

AxisType = Literal["log", "linear"]


@dataclass(frozen=True)
class Mark:
    """A point worth naming on a curve: (x, y) in the units of the drawn axes and a short text; y None marks the vertical."""

    x: float
    text: str
    y: float | None = None


@dataclass(frozen=True)
class Axis:
    """A label with its unit, "Frequency (Hz)", and the kind of scale."""

    label: str
    kind: AxisType = "linear"
    exponent: bool = False

    def layout(self) -> dict[str, Any]:
        """The plotly settings of this axis."""
        settings: dict[str, Any] = {"type": self.kind, "title": {"text": self.label, "standoff": 8}}
        if self.kind == "log":
            # plotly draws powers a quarter larger than other ticks;
            # with a tick format the sub-decade ticks read 20, 50 instead of a bare 2, 5
            settings |= (
                {"exponentformat": "power", "dtick": 1, "tickfont": {"size": 10.5}} if self.exponent else {"tickformat": "~g"}
            )
        return settings


HZ = Axis("Frequency (Hz)", "log")


def plain(text: object) -> str:
    """Text from outside as plotly shall show it: literally, not as its little HTML."""
    return html.escape(str(text), quote=False)


def blank(title: str, x: Axis, rows: Sequence[Axis], *, heights: Sequence[float] | None = None, size: int = 420) -> go.Figure:
    """An empty figure: a column of plots on one x axis, `size` pixels high."""
    figure = make_subplots(
        rows=len(rows),
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.05,
        row_heights=list(heights) if heights else None,
    )
    line = {
        "showline": True,
        "mirror": True,
        "linewidth": 1,
        "ticks": "outside",
        "ticklen": 4,
        "zeroline": False,
        "automargin": True,
    }
    figure.update_xaxes(**line)
    figure.update_yaxes(**line)
    figure.update_xaxes(**{k: v for k, v in x.layout().items() if k != "title"})
    if x.kind == "log":
        figure.update_xaxes(nticks=4)  # few enough that plotly labels 1, 2, 5 of each decade, not all nine
    figure.update_xaxes(title=x.layout()["title"], row=len(rows))
    for number, axis in enumerate(rows, start=1):
        figure.update_yaxes(**axis.layout(), row=number)
    figure.update_layout(
        template=TEMPLATE,
        title={
            "text": f"<b>{plain(title)}</b>",
            "x": 0,
            "xref": "container",
            "xanchor": "left",
            "pad": {"l": 8},
            "font": {"size": 15},
        },
        legend={"orientation": "h", "yanchor": "bottom", "y": 1.01, "xanchor": "right", "x": 1, "itemwidth": 30},
        margin={"l": 70, "r": 20, "t": 66, "b": 52},
        height=size,
        hovermode="closest",
    )
    return figure


def line(
    x: ArrayLike,
    y: ArrayLike,
    *,
    name: str,
    number: int = 0,
    legend: bool = True,
    hover: str = "",
    dash: str = "solid",
    width: float = LINE_WIDTH,
    color: str | None = None,
) -> go.Scatter:
    """One thin curve in the `number`-th colour; numbers as float32 (7 digits) so that the page stays small."""
    # plotly's own simplification leaves visible corners; `thin_out` has made the curve short already
    shape = {"color": color or PALETTE[number % len(PALETTE)], "width": width, "dash": dash, "simplify": False}
    return go.Scatter(
        x=np.asarray(x, dtype=np.float32),
        y=np.asarray(y, dtype=np.float32),
        name=plain(name),
        legendgroup=plain(name),
        showlegend=legend,
        mode="lines",
        line=shape,
        hovertemplate=f"{hover}<extra>{plain(name)}</extra>" if hover else None,
    )


def loop_colour(number: int) -> int:
    """Open loop in vermilion, closed loop in blue, in every figure: the loud one first, the quiet one drawn over it."""
    return (1, 0)[number] if number < 2 else number


def thin_out(values: NDArray[np.float64], limit: int = POINTS_PER_CURVE) -> NDArray[np.intp]:
    """Places to keep of a long curve: the extremes of every bucket, so that no peak or notch is lost; (k,), k about `limit`.

    values: (n,) or (rows, n), drawn over one axis; the places serve all rows.
    """
    rows = np.atleast_2d(values)
    n = rows.shape[1]
    if n <= limit:
        return np.arange(n)
    n_buckets = max(1, limit // (2 * rows.shape[0]))
    edges = np.linspace(0, n, n_buckets + 1).astype(np.intp)
    keep = {0, n - 1}
    for start, stop in pairwise(edges):
        bucket = np.nan_to_num(rows[:, start:stop])
        keep.update((start + bucket.argmin(axis=1)).tolist(), (start + bucket.argmax(axis=1)).tolist())
    return np.array(sorted(keep), dtype=np.intp)


def annotate(figure: go.Figure, marks: Sequence[Mark], *, row: int = 1, log_x: bool = True, log_y: bool = False) -> None:
    """Draw each mark: a dotted vertical, and where y is given a point with its text."""
    for place, mark in enumerate(marks):
        figure.add_vline(x=mark.x, line={"color": GREY, "width": 1, "dash": "dot"}, row=row, col=1)
        x = float(np.log10(mark.x)) if log_x else mark.x
        text = {"text": plain(mark.text), "font": {"size": 12}, "row": row, "col": 1}
        if mark.y is None:
            figure.add_annotation(
                x=x, y=1 - 0.09 * (place % 3), yref="y domain", xanchor="left", xshift=3, showarrow=False, yanchor="top", **text
            )
            continue
        y = float(np.log10(mark.y)) if log_y else mark.y
        point = go.Scatter(
            x=[mark.x], y=[mark.y], mode="markers", showlegend=False, hoverinfo="skip", marker={"color": ACCENT, "size": 7}
        )
        figure.add_trace(point, row=row, col=1)
        arrow = {"ax": (-44, 44)[place % 2], "ay": -30, "arrowwidth": 1, "arrowhead": 2, "arrowcolor": GREY}
        figure.add_annotation(x=x, y=y, **arrow, **text)


def decade_ticks(figure: go.Figure, row: int, most: int) -> None:
    """Label every decade of a row's log y axis, or every second, third ... where more than `most` would crowd."""
    drawn = [np.asarray(trace.y, dtype=float) for trace in figure.select_traces(row=row, col=1)]
    values = np.concatenate([y[np.isfinite(y) & (y > 0)] for y in drawn]) if drawn else np.ones(1)
    if values.size:
        decades = np.log10(values.max()) - np.log10(values.min())
        figure.update_yaxes(dtick=max(1, int(np.ceil(decades / most))), row=row)


def si_scale(values: Mapping[str, NDArray[np.float64]], unit: str) -> tuple[float, str]:
    """The factor and the prefixed unit that bring the largest value to 1 ... 1000: (1e6, "µm") for metres of 3e-6."""
    largest = max((float(np.nanmax(np.abs(v))) for v in values.values() if v.size), default=0.0)
    if not unit or largest == 0.0 or not np.isfinite(largest):
        return 1.0, unit
    power = int(np.clip(3 * np.floor(np.log10(largest) / 3), -12, 0))
    prefix = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: ""}[power]
    return 10.0**-power, prefix + unit
