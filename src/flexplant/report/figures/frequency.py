"""Figures over frequency: transfer functions, singular values, Bode, sensitivity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
import xarray as xr
from numpy.typing import NDArray

from flexplant.errors import InputError, nearest
from flexplant.report.figures.theme import (
    GREY,
    HZ,
    LINE_WIDTH,
    Axis,
    Mark,
    annotate,
    blank,
    decade_ticks,
    line,
    loop_colour,
    plain,
    thin_out,
)

ComplexArray = NDArray[np.complex128]
FloatArray = NDArray[np.float64]


def transfer_function(
    curves: Mapping[str, xr.DataArray],
    *,
    output: str | None = None,
    input: str | None = None,  # noqa: A002 - the name of the dimension
    title: str = "Transfer function",
    unit: str = "m/N",
    reference: str | None = None,
    marks: Sequence[Mark] = (),
    truncated_above_hz: float | None = None,
) -> go.Figure:
    """Magnitude and phase of several curves laid over each other, and their relative difference from a reference.

    curves: label -> complex (output, input, frequency); `output` and `input` pick one entry where there are several.
    reference: the label of the curve that the others are compared with, at its own frequencies: |G - Gref| / |Gref| in percent.
    marks: frequencies to name; truncated_above_hz: where the retained modes end, shaded above.
    Raises InputError for an unknown output, input or reference.
    """
    entries = {label: _entry(data, output, input) for label, data in curves.items()}
    axes = [Axis(f"Magnitude ({unit})", "log", exponent=True), Axis("Phase (deg)")]
    if reference is not None:
        axes.append(Axis("Difference (%)", "log", exponent=True))
    heights = (0.52, 0.22, 0.26) if reference is not None else (0.7, 0.3)
    figure = blank(title, HZ, axes, heights=heights, size=620 if reference is not None else 520)
    for number, (label, data) in enumerate(entries.items()):
        _magnitude_and_phase(figure, label, data, number, f"%{{x:.5g}} Hz<br>%{{y:.4g}} {plain(unit)}")
    if reference is not None:
        _differences(figure, entries, reference)
    _phase_ticks(figure, row=2)
    annotate(figure, marks)
    if truncated_above_hz is not None:
        _shade_truncated(figure, entries, truncated_above_hz)
    return figure


def bode(
    curves: Mapping[str, xr.DataArray],
    *,
    output: str | None = None,
    input: str | None = None,  # noqa: A002
    title: str = "Closed-loop Bode diagram",
    marks: Sequence[Mark] = (),
    level_db: float | None = -3.0,
) -> go.Figure:
    """Magnitude in dB and unwrapped phase in degrees; `marks` (Hz, dB) name peaks and crossings; a level line at `level_db`."""
    entries = {label: _entry(data, output, input) for label, data in curves.items()}
    figure = blank(title, HZ, [Axis("Magnitude (dB)"), Axis("Phase (deg)")], heights=(0.65, 0.35), size=500)
    for number, (label, data) in enumerate(entries.items()):
        hz, values = _frequency(data), _complex(data)
        keep = thin_out(np.vstack([_db(values), _degrees(values)]))
        figure.add_trace(line(hz[keep], _db(values)[keep], name=label, number=number, hover=_DB_HOVER), row=1, col=1)
        phase = line(hz[keep], _degrees(values)[keep], name=label, number=number, legend=False, hover=_DEGREE_HOVER)
        figure.add_trace(phase, row=2, col=1)
    _phase_ticks(figure, row=2)
    _level(figure, level_db)
    annotate(figure, marks)
    return figure


def sensitivity(
    curves: Mapping[str, xr.DataArray],
    *,
    output: str | None = None,
    input: str | None = None,  # noqa: A002
    title: str = "Output sensitivity",
    marks: Sequence[Mark] = (),
    level_db: float | None = -3.0,
) -> go.Figure:
    """|S| in dB over frequency, with its crossings and peak named by `marks` (Hz, dB); below 0 dB a disturbance is attenuated."""
    figure = blank(title, HZ, [Axis("|S| (dB)")], size=420)
    for number, (label, data) in enumerate(curves.items()):
        entry = _entry(data, output, input)
        level = _db(_complex(entry))
        keep = thin_out(level)
        figure.add_trace(line(_frequency(entry)[keep], level[keep], name=label, number=number, hover=_DB_HOVER), row=1, col=1)
    figure.add_hline(y=0, line={"color": GREY, "width": 1})
    _level(figure, level_db)
    annotate(figure, marks)
    figure.update_layout(showlegend=len(curves) > 1)
    return figure


def singular_values(
    curves: Mapping[str, xr.DataArray],
    *,
    title: str = "Singular values: disturbance to sensor, open and closed loop",
    unit: str = "m/N",
    marks: Sequence[Mark] = (),
) -> go.Figure:
    """Singular values of a response over frequency, one colour a curve, the largest solid and the smaller ones dotted.

    curves: label -> real (frequency,) or (any, frequency), in descending order; marks: (Hz, value) such as the H-infinity norms.
    """
    figure = blank(title, HZ, [Axis(f"Singular value ({unit})", "log", exponent=True)], size=460)
    for number, (label, data) in enumerate(curves.items()):
        hz, rows = _frequency(data), _rows(data)
        keep = thin_out(np.log(np.maximum(rows, np.finfo(float).tiny)))
        for rank, row in enumerate(rows):
            dash, width = ("solid", LINE_WIDTH) if rank == 0 else ("dot", 1.0)
            hover = f"%{{x:.5g}} Hz<br>σ{rank + 1} = %{{y:.4g}} {plain(unit)}"
            trace = line(
                hz[keep], row[keep], name=label, number=loop_colour(number), legend=rank == 0, hover=hover, dash=dash, width=width
            )
            figure.add_trace(trace, row=1, col=1)
    annotate(figure, marks, log_y=True)
    return figure


_DB_HOVER = "%{x:.5g} Hz<br>%{y:.3f} dB"
_DEGREE_HOVER = "%{x:.5g} Hz<br>%{y:.2f}°"


def _entry(data: xr.DataArray, output: str | None, input_: str | None) -> xr.DataArray:
    """The one curve over frequency that was asked for."""
    for dimension, wanted in (("output", output), ("input", input_)):
        if dimension not in data.dims:
            continue
        known = [str(name) for name in data[dimension].values]
        if wanted is None and len(known) > 1:
            raise InputError(f"figure: say which {dimension} to draw; there are {len(known)}: {', '.join(known[:8])}")
        name = known[0] if wanted is None else wanted
        if name not in known:
            raise InputError(f"figure: no {dimension} {name!r}." + nearest(name, known))
        data = data.isel({dimension: known.index(name)})
    return data


def _frequency(data: xr.DataArray) -> FloatArray:
    if "frequency" not in data.dims:
        raise InputError(f"figure: the result needs a dimension 'frequency' in Hz; it has {', '.join(map(str, data.dims))}")
    return np.asarray(data["frequency"].values, dtype=float)


def _complex(data: xr.DataArray) -> ComplexArray:
    return np.asarray(data.values, dtype=complex)


def _rows(data: xr.DataArray) -> FloatArray:
    return np.atleast_2d(np.asarray(data.transpose(..., "frequency").values, dtype=float))


def _db(values: ComplexArray) -> FloatArray:
    return np.asarray(20 * np.log10(np.maximum(np.abs(values), np.finfo(float).tiny)))


def _degrees(values: ComplexArray) -> FloatArray:
    return np.asarray(np.degrees(np.unwrap(np.angle(values))))


def _wrapped_degrees(values: ComplexArray) -> FloatArray:
    """Phase in (-180, 180], with a gap instead of a vertical line where it wraps."""
    phase = np.degrees(np.angle(values))
    phase[np.flatnonzero(np.abs(np.diff(phase)) > 270)] = np.nan
    return np.asarray(phase)


def _magnitude_and_phase(figure: go.Figure, label: str, data: xr.DataArray, number: int, hover: str) -> None:
    hz, values = _frequency(data), _complex(data)
    keep = thin_out(_db(values))
    # later curves are dotted over the first solid one, so that full agreement is still seen as two curves
    dash, width = ("solid", LINE_WIDTH) if number == 0 else ("dot", LINE_WIDTH + 0.8)
    figure.add_trace(
        line(hz[keep], np.abs(values)[keep], name=label, number=number, hover=hover, dash=dash, width=width), row=1, col=1
    )
    phase = _wrapped_degrees(values[keep])
    figure.add_trace(
        line(hz[keep], phase, name=label, number=number, legend=False, hover=_DEGREE_HOVER, dash=dash, width=width), row=2, col=1
    )


def _differences(figure: go.Figure, entries: Mapping[str, xr.DataArray], reference: str) -> None:
    """The lowest plot: how far each curve is from the reference, at the reference's frequencies where both have them."""
    if reference not in entries:
        raise InputError(f"figure: no curve {reference!r} to compare with." + nearest(reference, entries))
    base = entries[reference]
    for number, (label, data) in enumerate(entries.items()):
        if label == reference:
            continue
        hz, here, there = np.intersect1d(_frequency(data), _frequency(base), return_indices=True)
        if hz.size == 0:
            raise InputError(
                f"figure: curves {label!r} and {reference!r} have no frequency in common; compute both at the same ones"
            )
        truth = _complex(base)[there]
        percent = 100 * np.abs(_complex(data)[here] - truth) / np.maximum(np.abs(truth), np.finfo(float).tiny)
        keep = thin_out(percent)
        name = f"{label} minus {reference}"
        hover = "%{x:.5g} Hz<br>%{y:.3g} %"
        trace = line(hz[keep], percent[keep], name=name, number=number, legend=False, hover=hover, width=1.0)
        figure.add_trace(trace, row=3, col=1)
    decade_ticks(figure, row=3, most=4)


def _phase_ticks(figure: go.Figure, row: int) -> None:
    figure.update_yaxes(dtick=90, row=row)


def _level(figure: go.Figure, level_db: float | None) -> None:
    if level_db is not None:
        figure.add_hline(y=level_db, line={"color": GREY, "width": 1, "dash": "dash"}, row=1, col=1)
        text = f"{level_db:g} dB".replace("-", "−")
        note = {"text": text, "font": {"size": 11}, "showarrow": False, "xanchor": "left", "yanchor": "top"}
        figure.add_annotation(x=0, xref="x domain", y=level_db, row=1, col=1, **note)


def _shade_truncated(figure: go.Figure, entries: Mapping[str, xr.DataArray], above_hz: float) -> None:
    """Shade what lies above the retained modes, on every plot."""
    highest = max(float(_frequency(data).max()) for data in entries.values())
    if highest > above_hz:
        figure.add_vrect(x0=above_hz, x1=highest, fillcolor=GREY, opacity=0.13, line_width=0, row="all", col=1)
        annotate(figure, [Mark(above_hz, "no modes kept above")])
