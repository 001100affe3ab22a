"""Figures of motion: time histories, the path of the spot, RMS over wheel speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
import xarray as xr
from numpy.typing import NDArray

from flexplant.errors import InputError, nearest
from flexplant.report.figures.theme import DASHES, GREY, Axis, Mark, annotate, blank, line, loop_colour, plain, si_scale, thin_out

FloatArray = NDArray[np.float64]


def time_histories(
    curves: Mapping[str, xr.DataArray],
    *,
    outputs: Sequence[str] | None = None,
    title: str = "Line of sight at the sensor over time",
    unit: str = "m",
    labels: Mapping[str, str] | None = None,
) -> go.Figure:
    """One plot an output (x, y), one curve a case (open loop, closed loop), over time in seconds.

    curves: label -> real (output, time), as in `simulate(...)["outputs"]`. outputs: which to draw, by default all of the
    first curve; labels: output -> axis text.
    Values get an SI prefix that fits the largest. Raises InputError for an unknown output.
    """
    names = list(outputs) if outputs is not None else _outputs(next(iter(curves.values())))
    picked = {label: _picked(data, names) for label, data in curves.items()}
    scale, shown_unit = si_scale(picked, unit)
    behind = f" ({shown_unit})" if shown_unit else ""
    axes = [Axis(plain((labels or {}).get(name, name)) + behind) for name in names]
    figure = blank(title, Axis("Time (s)"), axes, size=140 + 190 * len(names))
    for number, (label, values) in enumerate(picked.items()):
        seconds = np.asarray(curves[label]["time"].values, dtype=float)
        for row, motion in enumerate(scale * values, start=1):
            keep = thin_out(motion)
            hover = f"%{{x:.5g}} s<br>%{{y:.4g}} {plain(shown_unit)}"
            trace = line(
                seconds[keep], motion[keep], name=label, number=loop_colour(number), legend=row == 1, hover=hover, width=1.1
            )
            figure.add_trace(trace, row=row, col=1)
    return figure


def spot(
    curves: Mapping[str, xr.DataArray],
    *,
    x: str,
    y: str,
    title: str = "Spot motion on the sensor",
    unit: str = "m",
    pixel: float | None = None,
) -> go.Figure:
    """The path of the spot on the sensor, y over x at equal scales; `pixel` (same unit) draws one pixel for comparison.

    curves: label -> real (output, time).
    """
    picked = {label: _picked(data, [x, y]) for label, data in curves.items()}
    scale, shown = si_scale(picked, unit)
    figure = blank(title, Axis(f"x ({shown})"), [Axis(f"y ({shown})")], size=520)
    hover = f"x %{{x:.4g}} {plain(shown)}<br>y %{{y:.4g}} {plain(shown)}"
    for number, (label, values) in enumerate(picked.items()):
        keep = _even(values.shape[1])
        path = scale * values[:, keep]
        figure.add_trace(line(path[0], path[1], name=label, number=loop_colour(number), hover=hover, width=1.0), row=1, col=1)
    if pixel is not None:
        half = scale * pixel / 2
        edge = np.array([-half, half, half, -half, -half])
        figure.add_trace(
            line(edge, np.roll(edge, 1), name=f"one pixel, {scale * pixel:g} {shown}", color=GREY, dash="dash", width=2),
            row=1,
            col=1,
        )
    figure.update_xaxes(constrain="domain")
    figure.update_yaxes(scaleanchor="x", scaleratio=1, constrain="domain")
    figure.update_layout(height=_height_of(picked))
    return figure


def _height_of(paths: Mapping[str, FloatArray]) -> int:
    """Page height in pixels that a path wider than tall needs at equal scales."""
    wide, tall = np.ptp(np.hstack(list(paths.values())), axis=1) if paths else (1.0, 1.0)
    return int(np.clip(200 + 900 * tall / max(wide, np.finfo(float).tiny), 300, 520))


def rms_over_speed(
    curves: Mapping[str, xr.DataArray],
    *,
    title: str = "RMS spot motion over wheel speed",
    unit: str = "m",
    speed_label: str = "Wheel speed (Hz)",
    labels: Mapping[str, str] | None = None,
    marks: Sequence[Mark] = (),
) -> go.Figure:
    """RMS over wheel speed, log y; one colour a curve (open loop, closed loop), one dash an output.

    curves: label -> real (speed,) or (output, speed), the speed under any name; labels: output -> text; marks: speeds to name.
    Raises InputError for other dimensions.
    """
    values = {label: np.asarray(_speed_rows(label, data).values, dtype=float) for label, data in curves.items()}
    scale, shown = si_scale(values, unit)
    figure = blank(title, Axis(speed_label), [Axis(f"RMS ({shown})", "log")], size=440)
    hover = f"%{{x:.5g}}<br>%{{y:.4g}} {plain(shown)}"
    for number, (label, data) in enumerate(curves.items()):
        rows = _speed_rows(label, data)
        speed = np.asarray(rows[rows.dims[-1]].values, dtype=float)
        for which, rms in enumerate(scale * values[label]):
            keep = thin_out(np.log(np.maximum(rms, np.finfo(float).tiny)))
            name = label if data.ndim == 1 else f"{label}, {_named(rows, which, labels or {})}"
            dash = DASHES[which % len(DASHES)]
            trace = line(speed[keep], rms[keep], name=name, number=loop_colour(number), hover=hover, dash=dash)
            figure.add_trace(trace, row=1, col=1)
    annotate(figure, marks, log_x=False)
    return figure


def _speed_rows(label: str, data: xr.DataArray) -> xr.DataArray:
    """(output, speed), with one nameless output where there is none."""
    rows = data if "output" in data.dims else data.expand_dims("output")
    if rows.ndim != 2:
        raise InputError(f"figure: curve {label!r} has dimensions {data.dims}; RMS over speed needs (speed,) or (output, speed)")
    return rows.transpose("output", ...)


def _named(rows: xr.DataArray, which: int, labels: Mapping[str, str]) -> str:
    name = str(rows["output"].values[which])
    return labels.get(name, name)


def _outputs(data: xr.DataArray) -> list[str]:
    return [str(name) for name in data["output"].values]


def _picked(data: xr.DataArray, names: Sequence[str]) -> FloatArray:
    """Real values (len(names), time) of the named outputs."""
    known = _outputs(data)
    for name in names:
        if name not in known:
            raise InputError(f"figure: no output {name!r}." + nearest(name, known))
    rows = data.transpose("output", "time").values
    return np.asarray(rows[[known.index(name) for name in names]], dtype=float)


def _even(n: int, limit: int = 12000) -> NDArray[np.intp]:
    """Every k-th place: a path through the plane has no axis along which extremes could be kept."""
    return np.arange(0, n, max(1, -(-n // limit)), dtype=np.intp)
