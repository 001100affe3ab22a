"""One call that draws whatever a response function returned."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import product
from typing import Any, TypeAlias

import plotly.graph_objects as go
import xarray as xr

from flexplant.errors import InputError, expect_text, nearest
from flexplant.report.figures.broken_loop import broken_loop
from flexplant.report.figures.frequency import singular_values, transfer_function
from flexplant.report.figures.shape import mode_shape
from flexplant.report.figures.spectra import spectra
from flexplant.report.figures.theme import plain
from flexplant.report.figures.time import rms_over_speed, time_histories
from flexplant.report.figures.tones import line_spectrum
from flexplant.report.structure import StructureView

Result: TypeAlias = xr.DataArray | xr.Dataset
MOST_CURVES = 12


def plot(
    result: Result | Mapping[str, Result] | StructureView,
    *,
    output: str | None = None,
    input: str | None = None,  # noqa: A002 - the name of the dimension
    title: str | None = None,
) -> go.Figure:
    """A figure of a result, or of several of one kind laid over each other, with names and units from the result itself.

    result: what `frequency_response`, `singular_values`, `loop_response`, `random_response`, `harmonic_response`, `simulate` or
    `wheel_speed_sweep` returned, a piece of `simulate_stream`, or a mapping label -> such results; or a `mode_view`, of which the
    first flexible mode is drawn. output, input: one channel, where not all shall be drawn; title: instead of the usual one.
    Returns a plotly figure: `.show()` opens it, `.write_html(path)` keeps it.
    Raises InputError for another kind of value, results of different kinds, unknown channels and more than twelve curves.
    """
    if title is not None:
        expect_text(title, "plot: title")
    if isinstance(result, StructureView):
        if output is not None or input is not None:
            raise InputError("plot: output and input choose channels of a response; a mode shape has none")
        return _titled(mode_shape(result), title)
    results = dict(result) if isinstance(result, Mapping) and not isinstance(result, xr.Dataset) else {"": result}
    kinds = {_kind(value) for value in results.values()}
    if len(kinds) != 1:
        raise InputError(f"plot: results of one kind can be laid over each other, got {len(kinds)}: {', '.join(sorted(kinds))}")
    chosen = {str(label): _chosen(value, output=output, input=input) for label, value in results.items()}
    return _titled(_DRAWN[kinds.pop()](chosen), title)


def _titled(figure: go.Figure, title: str | None) -> go.Figure:
    if title is not None:
        figure.update_layout(title_text=f"<b>{plain(title)}</b>")
    return figure


def _kind(value: object) -> str:
    names = set(value.data_vars) if isinstance(value, xr.Dataset) else {value.name} if isinstance(value, xr.DataArray) else set()
    for kind, needed in _NEEDED.items():
        if needed <= names:
            return kind
    raise InputError(
        f"plot: draws results of {', '.join(_NEEDED)}, or a mapping label -> result; got {type(value).__name__}"
        + (f" with {', '.join(sorted(map(str, names)))}" if names else "")
    )


def _chosen(result: Result, **wanted: str | None) -> Result:
    for dimension, name in wanted.items():
        if name is None:
            continue
        known = [str(k) for k in result[dimension].values] if dimension in result.dims else []
        if not isinstance(name, str) or name not in known:
            raise InputError(f"plot: no {dimension} {name!r:.60} in this result." + nearest(str(name), known))
        result = result.isel({dimension: [known.index(name)]})
    return result


def _responses(results: Mapping[str, Any]) -> go.Figure:
    """A curve for every pair of an output and an input."""
    curves, units = {}, set()
    for label, G in results.items():
        for o, i in product(range(G.sizes["output"]), range(G.sizes["input"])):
            entry = G.isel(output=[o], input=[i])
            name = f"{entry.input.item()} -> {entry.output.item()}"
            curves[_joined(label, name)] = entry
            units.add(f"{_unit(entry, 'output')}/{_unit(entry, 'input')}")
    if len(curves) > MOST_CURVES:
        raise InputError(f"plot: {len(curves)} curves are more than {MOST_CURVES}; choose with output= and input=")
    title = "Transfer function" if len(curves) > 1 else f"Transfer function {next(iter(curves))}"
    return transfer_function(curves, title=title, unit=", ".join(sorted(units)))


def _singular(results: Mapping[str, Any]) -> go.Figure:
    curves = {label or "singular values": values.transpose("index", "frequency") for label, values in results.items()}
    return singular_values(curves, title="Singular values", unit="output/input")


def _random(results: Mapping[str, Any]) -> go.Figure:
    return spectra({_joined(label, str(o)): r.sel(output=o) for label, r in results.items() for o in r.output.values})


def _tones(results: Mapping[str, Any]) -> go.Figure:
    entries = {_joined(label, str(o)): r.isel(output=[k]) for label, r in results.items() for k, o in enumerate(r.output.values)}
    if len(entries) > MOST_CURVES:
        raise InputError(f"plot: {len(entries)} outputs are more than {MOST_CURVES} curves; choose with output=")
    units = sorted({_unit(entry, "output") for entry in entries.values()})
    return line_spectrum(entries, unit=", ".join(units))


def _histories(results: Mapping[str, Any]) -> go.Figure:
    first = next(iter(results.values()))
    names = [str(name) for name in first.output.values]
    if not names:
        raise InputError("plot: this result has no outputs to draw")
    if len(names) > MOST_CURVES:
        raise InputError(f"plot: {len(names)} outputs are more than {MOST_CURVES} plots; choose with output=")
    units = {_unit(first.isel(output=[k]), "output") for k in range(len(names))}
    shown = {name: f"{name} ({_unit(first.isel(output=[k]), 'output')})" for k, name in enumerate(names)}
    curves = {label or str(r.attrs.get("plant", "simulation")): _over_time(r) for label, r in results.items()}
    return time_histories(
        curves, title="Response over time", unit=units.pop() if len(units) == 1 else "", labels=shown if len(units) > 1 else None
    )


def _over_time(result: xr.Dataset) -> xr.DataArray:
    outputs = result["outputs"]
    return outputs.rename(output_time="time") if "output_time" in outputs.dims else outputs


def _sweeps(results: Mapping[str, Any]) -> go.Figure:
    curves = {}
    for label, sweep in results.items():
        cases = sweep["case"].values if "case" in sweep.dims else [None]
        for case in cases:
            rms = sweep["rms"] if case is None else sweep["rms"].sel(case=case)
            curves[label or "RMS" if case is None else _joined(label, str(case))] = rms
    first = next(iter(results.values()))
    units = {_unit(first.isel(output=[k]), "output") for k in range(first.sizes["output"])}
    return rms_over_speed(curves, title="RMS over wheel speed", unit=units.pop() if len(units) == 1 else "")


def _loops(results: Mapping[str, Any]) -> go.Figure:
    return broken_loop(results)


def _unit(result: Any, dimension: str) -> str:
    """The unit of the one channel, or the name of the dimension."""
    coordinate = f"{dimension}_units"
    text = str(result[coordinate].values.ravel()[0]) if coordinate in result.coords else ""
    return text or (dimension if dimension == "input" else "1")


def _joined(label: str, name: str) -> str:
    return f"{label}: {name}" if label else name


_NEEDED = {
    "frequency_response": {"frequency_response"},
    "singular_values": {"singular_values"},
    "loop_response": {"L_singular", "S_singular", "T_singular"},
    "random_response": {"psd", "cumulative_rms"},
    "harmonic_response": {"harmonic_response"},
    "simulate": {"outputs", "final_state"},
    "wheel_speed_sweep": {"rms", "amplitude"},
}
_DRAWN: dict[str, Callable[[Mapping[str, Any]], go.Figure]] = {
    "frequency_response": _responses,
    "singular_values": _singular,
    "loop_response": _loops,
    "random_response": _random,
    "harmonic_response": _tones,
    "simulate": _histories,
    "wheel_speed_sweep": _sweeps,
}
