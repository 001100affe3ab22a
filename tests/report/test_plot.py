"""The one plot function: it draws every kind of result with its numbers, names and units, and refuses the rest."""

import numpy as np
import plotly.graph_objects as go
import pytest

import flexplant as fp
from flexplant.errors import InputError

TIME = np.arange(200) * 1e-3


@pytest.fixture(scope="module")
def plant():
    shapes = np.random.default_rng(0).normal(size=(5, 2))
    return fp.ModalPlant(
        omega=2 * np.pi * np.array([3.0, 11.0, 29.0, 60.0, 110.0]), zeta=0.01, shape_in=shapes, shape_out=shapes.T,
        inputs=["fx", "fy"], outputs=["x", "y"], input_units=["N", "N"], output_units=["m", "m"],
    )  # fmt: skip


@pytest.fixture(scope="module")
def loop(plant):
    return fp.Diagram(
        blocks={"plant": plant, "control": fp.transfer_function([-30.0, 0.0], [1e-3, 1.0], input_name="x", output_name="f")},
        connections=[("plant.x", "control.x"), ("control.f", "plant.fx")],
        inputs={"fy": "plant.fy"},
        outputs={"x": "plant.x", "y": "plant.y"},
    )


def drawn(figure: go.Figure) -> dict[str, np.ndarray]:
    return {trace.name: np.asarray(trace.y, dtype=float) for trace in figure.data if trace.showlegend}


def axes(figure: go.Figure) -> list[str]:
    return [axis.title.text for axis in figure.select_yaxes()]


def test_a_curve_for_each_pair_with_units(plant):
    G = fp.frequency_response(plant, np.geomspace(1, 200, 300))
    curves = drawn(fp.plot(G))
    assert set(curves) == {"fx -&gt; x", "fx -&gt; y", "fy -&gt; x", "fy -&gt; y"}
    one = fp.plot(G, output="y", input="fx", title="Mine & yours")
    assert drawn(one)["fx -&gt; y"].max() == pytest.approx(abs(G.sel(output="y", input="fx")).max().item(), rel=1e-6)
    assert axes(one)[0] == "Magnitude (m/N)"
    assert one.layout.title.text == "<b>Mine &amp; yours</b>"
    assert len(drawn(fp.plot({"a": G.isel(input=[0]), "b": G.isel(input=[0])}))) == 4


def test_singular_values_and_loops(plant, loop):
    G = fp.frequency_response(plant, np.geomspace(1, 200, 300))
    sigma = fp.singular_values(G)
    assert max(values.max() for values in drawn(fp.plot(sigma)).values()) == pytest.approx(float(sigma.max()), rel=1e-6)
    found = fp.loop_response(loop, ["control.f"])
    curves = drawn(fp.plot(found))
    assert set(curves) == {"loop gain L", "sensitivity S", "complementary sensitivity T", "disk margin"}
    level = 20 * np.log10(float(found.S_singular.max()))
    assert curves["sensitivity S"].max() == pytest.approx(level, abs=1e-4)
    texts = " ".join(str(note.text) for note in fp.plot(found).layout.annotations)
    assert f"S {float(found.S_peak):.3g}" in texts
    assert len(drawn(fp.plot({"one": found, "two": found}))) == 8


def test_random_response_says_its_rms(plant):
    found = fp.random_response(plant, {"fx": 2.0}, np.geomspace(1, 200, 300))
    names = list(drawn(fp.plot(found)))
    assert names == [f"{o}, RMS {float(found.rms.sel(output=o)):.3g} m" for o in "xy"]
    assert axes(fp.plot(found, output="x")) == ["PSD (m²/Hz)", "RMS below (m)"]


def test_time_and_sweeps(plant, loop):
    motion = fp.simulate(loop, TIME, {"fy": np.sin(40 * TIME)})
    figure = fp.plot(motion)
    assert len(figure.data) == 2
    assert all(title.startswith(name) for name, title in zip("xy", axes(figure), strict=True))
    thinned = fp.simulate(loop, TIME, {"fy": np.sin(40 * TIME)}, every=4)
    assert len(fp.plot({"all": motion, "every fourth": thinned}, output="x").data) == 2
    wheel = fp.Wheel(amplitude=1e-3, harmonics=[1.0, 2.0], inputs=["fy", *"abcde"])
    six = fp.ModalPlant(
        omega=plant.omega,
        zeta=0.01,
        shape_in=np.ones((5, 6)),
        shape_out=plant.shape_out,
        inputs=["fy", *"abcde"],
        outputs=["x", "y"],
    )
    sweep = fp.wheel_speed_sweep({"open": six, "again": six}, wheel, np.linspace(2, 40, 50))
    assert len(fp.plot(sweep).data) == 4
    assert len(fp.plot(sweep.sel(case="open")).data) == 2


def test_tones_are_a_line_spectrum(plant):
    tones = fp.Tones(frequency_hz=[0.0, 2.0, 5.0, 9.0], amplitude=np.ones((1, 4)), inputs=["fx"])
    found = fp.harmonic_response(plant, tones)
    figure = fp.plot(found)
    size = abs(found.values)
    names = [f"{o}, RMS {np.sqrt(a[0] ** 2 + (a[1:] ** 2).sum() / 2):.3g} m" for o, a in zip("xy", size, strict=True)]
    assert list(drawn(figure)) == names
    assert np.allclose(drawn(figure)[names[0]].reshape(3, 3)[:, 1], size[0, 1:], rtol=1e-6)  # drawn in single precision
    assert fp.plot(found, output="x").layout.xaxis.type == "log"


def test_a_piece_of_a_long_run_is_drawn(plant):
    piece = next(iter(fp.simulate_stream(plant, dt=1e-3, samples=50)))
    assert axes(fp.plot(piece)) == axes(fp.plot(fp.simulate(plant, 1e-3 * np.arange(50))))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda G: (3.0, {}), "draws results of frequency_response.*got float"),
        (lambda G: (G.rename("other"), {}), "got DataArray with other"),
        (lambda G: (G, {"output": "z"}), "no output 'z'"),
        (lambda G: ({"a": G, "b": fp.singular_values(G)}, {}), "one kind .* got 2"),
        (lambda G: ({}, {}), "one kind .* got 0"),
        (lambda G: ({str(k): G for k in range(4)}, {}), "16 curves are more than 12"),
    ],
)
def test_what_cannot_be_drawn(plant, change, message):
    result, options = change(fp.frequency_response(plant, [1.0, 2.0]))
    with pytest.raises(InputError, match=message):
        fp.plot(result, **options)
