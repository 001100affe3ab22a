"""Figures: what is drawn equals what was given, extremes survive thinning, every axis carries its unit."""

import re
from functools import cache

import numpy as np
import plotly.graph_objects as go
import pytest
import xarray as xr

from flexplant.errors import InputError
from flexplant.report import figures
from flexplant.report.figures import Mark
from flexplant.report.figures.theme import PALETTE, si_scale, thin_out

HZ = np.geomspace(10, 1000, 400)
SPEED = np.linspace(5, 80, 60)
TIME = np.arange(0, 0.2, 1e-3)
OUTPUTS, INPUTS = ["optic.9101.1", "optic.9101.2"], ["bus.9001.1", "bus.9001.2"]


def oscillator(hz: np.ndarray = HZ, natural_hz: float = 100.0, zeta: float = 0.01) -> xr.DataArray:
    s, w = 2j * np.pi * hz, 2 * np.pi * natural_hz
    one = 1 / (s**2 + 2 * zeta * w * s + w**2)
    gains = np.array([[1.0, 0.3], [-0.2, 2.0]])
    coords = {"output": OUTPUTS, "input": INPUTS, "frequency": hz}
    return xr.DataArray(gains[:, :, None] * one, dims=("output", "input", "frequency"), coords=coords)


def motion(amplitude: float) -> xr.DataArray:
    rows = amplitude * np.array([np.sin(300 * TIME), np.cos(300 * TIME)])
    return xr.DataArray(rows, dims=("output", "time"), coords={"output": OUTPUTS, "time": TIME})


def rms(amplitude: float) -> xr.DataArray:
    rows = amplitude * np.vstack([SPEED**2, 2 * SPEED**2])
    return xr.DataArray(rows, dims=("output", "omega_hz"), coords={"output": OUTPUTS, "omega_hz": SPEED})


def pair() -> dict[str, str]:
    return {"output": OUTPUTS[0], "input": INPUTS[0]}


@cache
def every_figure() -> dict[str, go.Figure]:
    G = oscillator()
    values = abs(G).isel(input=0).rename(output="rank")
    modes = np.array([0.0, 107.0, 112.8])
    return {
        "transfer": figures.transfer_function({"reduced": G, "explicit": 1.01 * G}, **pair(), reference="explicit"),
        "shaded": figures.transfer_function({"reduced": G}, **pair(), truncated_above_hz=300, marks=[Mark(112.8, "X bending 1")]),
        "bode": figures.bode({"closed loop": G}, **pair(), marks=[Mark(100, "peak", -20)]),
        "sensitivity": figures.sensitivity({"S": G}, **pair(), marks=[Mark(434.8, "-3 dB", -3)]),
        "singular": figures.singular_values({"open loop": values}, marks=[Mark(100, "norm", 1e-3)]),
        "time": figures.time_histories({"open loop": motion(3e-6), "closed loop": motion(1e-7)}),
        "spot": figures.spot({"open loop": motion(3e-6)}, x=OUTPUTS[0], y=OUTPUTS[1], pixel=5e-6),
        "rms": figures.rms_over_speed({"open loop": rms(1e-9)}, marks=[Mark(20, "20 Hz")]),
        "modes": figures.mode_contributions(modes, {"x": [0.0, 1e-6, 1.0]}, marks=[Mark(107, "absent", 1e-6)]),
        "errors": figures.frequency_comparison(["Axial 1", "X bending 1"], [1e-4, 2.0], limit_percent=0.1),
    }


@pytest.mark.parametrize("name", list(every_figure()))
def test_every_axis_has_a_label_with_its_unit(name):
    figure = every_figure()[name]
    titles = [axis.title.text for axis in (*figure.select_xaxes(), *figure.select_yaxes()) if axis.title.text]
    assert len(titles) >= 2
    assert all(re.search(r"\([^)]+\)$", title) or title == "Mode" for title in titles), titles
    assert figure.layout.title.text


@pytest.mark.parametrize("name", ["transfer", "bode", "sensitivity", "singular", "modes"])
def test_frequencies_are_drawn_in_hz_on_a_log_axis(name):
    axes = list(every_figure()[name].select_xaxes())
    assert all(axis.type == "log" for axis in axes)
    assert any(axis.title.text == "Frequency (Hz)" for axis in axes)


def test_a_transfer_function_draws_the_given_magnitude_phase_and_difference():
    G = oscillator()
    figure = figures.transfer_function({"reduced": G, "explicit": 1.01 * G}, **pair(), reference="explicit")
    magnitude, phase, *_, difference = figure.data
    entry = G.sel(pair()).values
    np.testing.assert_allclose(magnitude.y, abs(entry), rtol=1e-6)
    np.testing.assert_allclose(phase.y, np.degrees(np.angle(entry)), rtol=1e-5)
    np.testing.assert_allclose(difference.y, 100 * 0.01 / 1.01, rtol=1e-5)


def test_the_difference_uses_the_frequencies_that_both_curves_have():
    figure = figures.transfer_function({"a": oscillator(), "b": oscillator(HZ[::4])}, **pair(), reference="b")
    difference = figure.data[-1]
    np.testing.assert_allclose(difference.x, HZ[::4], rtol=1e-6)
    np.testing.assert_allclose(difference.y, 0, atol=1e-5)


def test_wide_log_axes_label_few_enough_decades():
    errors = 10.0 ** np.linspace(-8, 3, HZ.size)
    figure = figures.transfer_function({"a": (1 + errors) * oscillator(), "b": oscillator()}, **pair(), reference="b")
    assert figure.layout.yaxis3.dtick == 3, "eleven decades on the low plot"
    modes = figures.mode_contributions([100.0, 200.0], {"x": [1.0, 1e-15]})
    assert modes.layout.yaxis.dtick == 3


def test_a_wrapping_phase_breaks_instead_of_drawing_a_vertical_line():
    delay = xr.DataArray(np.exp(-2j * np.pi * HZ * 0.01), dims=("frequency",), coords={"frequency": HZ})
    phase = figures.transfer_function({"delay": delay}).data[1].y
    steps = np.diff(phase)
    assert np.isnan(phase).any()
    assert np.nanmax(abs(steps)) < 270
    unwrapped = figures.bode({"delay": delay}).data[1].y
    np.testing.assert_allclose(unwrapped, -360 * HZ * 0.01 + np.round(unwrapped[0] / 360 + HZ[0] * 0.01) * 360, atol=0.01)


def test_singular_values_draw_every_row_and_name_each_curve_once():
    values = abs(oscillator()).isel(input=0).rename(output="rank")
    figure = figures.singular_values({"open loop": values, "closed loop": 0.1 * values})
    assert [trace.showlegend for trace in figure.data] == [True, False, True, False]
    np.testing.assert_allclose(figure.data[2].y, 0.1 * values.isel(rank=0), rtol=1e-6)


def test_time_histories_and_spot_keep_the_motion_up_to_the_shown_unit():
    curves = {"open loop": motion(3e-6), "closed loop": motion(1e-7)}
    figure = figures.time_histories(curves, labels=dict(zip(OUTPUTS, ("x", "y"), strict=True)))
    assert [axis.title.text for axis in figure.select_yaxes()] == ["x (µm)", "y (µm)"]
    np.testing.assert_allclose(figure.data[1].y, 1e6 * curves["open loop"].values[1], rtol=1e-5, atol=1e-6)
    path = figures.spot(curves, x=OUTPUTS[0], y=OUTPUTS[1]).data[0]
    np.testing.assert_allclose(np.hypot(path.x, path.y), 3.0, rtol=1e-5)


def test_rms_takes_one_or_several_outputs():
    figure = figures.rms_over_speed({"open loop": rms(1e-9), "closed loop": rms(1e-10)}, labels={OUTPUTS[0]: "x"})
    assert [t.name for t in figure.data[:2]] == ["open loop, x", f"open loop, {OUTPUTS[1]}"]
    assert figure.data[0].line.color != figure.data[2].line.color
    single = figures.rms_over_speed({"open loop": rms(1e-9).isel(output=0, drop=True)}).data[0]
    assert single.name == "open loop"
    np.testing.assert_allclose(single.y / single.y[0], (SPEED / SPEED[0]) ** 2, rtol=1e-5)


def test_contributions_leave_rigid_body_modes_out_and_point_at_the_rest():
    figure = figures.mode_contributions([0.0, 107.0, 112.8], {"x": [5.0, 1e-6, 1.0]}, names=["Tx", "Axial 1", "X bending 1"])
    heads = figure.data[1]
    np.testing.assert_allclose(heads.x, [107.0, 112.8], rtol=1e-6)
    assert list(heads.text) == ["Axial 1", "X bending 1"]


def test_modes_without_any_contribution_draw_nothing():
    figure = figures.mode_contributions([0.0, 107.0], {"x": [0.0, 0.0]})
    assert all(len(trace.x) == 0 for trace in figure.data)


def test_errors_above_the_limit_are_marked():
    bars = figures.frequency_comparison(["a", "b"], [1e-4, -2.0], limit_percent=0.1).data[0]
    assert bars.marker.color[0] != bars.marker.color[1]


@pytest.mark.parametrize("n_rows", [1, 3])
def test_thinning_keeps_the_extremes_of_every_curve(n_rows):
    rows = np.random.default_rng(3).normal(size=(n_rows, 100_000))
    keep = thin_out(rows, limit=4000)
    assert keep.size <= 4002
    assert (np.diff(keep) > 0).all()
    assert {0, 99_999} <= set(keep.tolist())
    np.testing.assert_array_equal(rows[:, keep].max(axis=1), rows.max(axis=1))
    np.testing.assert_array_equal(rows[:, keep].min(axis=1), rows.min(axis=1))


def test_a_short_curve_is_kept_whole():
    np.testing.assert_array_equal(thin_out(np.ones(10)), np.arange(10))


def test_a_long_history_stays_small():
    time = np.linspace(0, 10, 200_000)
    long = xr.DataArray(np.sin(40 * time)[None], dims=("output", "time"), coords={"output": ["x"], "time": time})
    assert len(figures.time_histories({"open loop": long}).to_json()) < 150_000


@pytest.mark.parametrize(
    ("largest", "expected"), [(3e-6, "µm"), (2e-9, "nm"), (0.5, "mm"), (7.0, "m"), (4000.0, "m"), (1e-15, "pm")]
)
def test_the_prefix_fits_the_largest_value(largest, expected):
    factor, unit = si_scale({"a": np.array([0.1 * largest, -largest])}, "m")
    assert unit == expected
    assert expected in ("m", "pm") or 1 <= factor * largest < 1000


def test_zero_motion_keeps_its_unit():
    assert si_scale({"a": np.zeros(3)}, "m") == (1.0, "m")


def test_names_from_files_are_shown_literally():
    curves = {"<a href='https://example.org'>open</a>": oscillator()}
    figure = figures.transfer_function(curves, **pair(), title="<b>x</b>", marks=[Mark(100, "<i>m</i>")])
    shown = [
        figure.data[0].name,
        figure.layout.title.text.removeprefix("<b>").removesuffix("</b>"),
        figure.layout.annotations[0].text,
    ]
    assert not any("<" in text for text in shown)


def test_colours_differ():
    assert len(set(PALETTE)) == len(PALETTE)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: figures.bode({"a": oscillator()}), "say which output"),
        (lambda: figures.bode({"a": oscillator()}, output="optic.9101.3", input=INPUTS[0]), "Did you mean"),
        (lambda: figures.transfer_function({"a": oscillator()}, **pair(), reference="b"), "no curve 'b'"),
        (lambda: figures.transfer_function({"a": oscillator(), "b": oscillator(HZ + 1)}, **pair(), reference="b"), "in common"),
        (lambda: figures.sensitivity({"a": motion(1)}, output=OUTPUTS[0]), "'frequency' in Hz"),
        (lambda: figures.time_histories({"a": motion(1)}, outputs=["optic.9101.9"]), "Did you mean"),
        (lambda: figures.rms_over_speed({"a": oscillator()}), "speed"),
        (lambda: figures.mode_contributions([1.0, 2.0], {"x": [1.0]}), "2 modes"),
    ],
)
def test_what_cannot_be_drawn_is_said_plainly(make, words):
    with pytest.raises(InputError, match=re.escape(words)):
        make()
