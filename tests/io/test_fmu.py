"""FMUs of both versions are valid and equal to our simulation for every kind of plant."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported_plants import DT, N, coupled, kinds, needs_gcc, plant
from fmus import VERSIONS, Fmu, fmpy
from stepwise_simulation import simulate

from flexplant.io import write_plant


def close_enough(y: np.ndarray, given: Any, u: np.ndarray, dt: float, **hold: str) -> None:
    expected = simulate(given, np.arange(u.shape[1]) * dt, u, **hold)["outputs"].values
    np.testing.assert_allclose(y, expected, rtol=0, atol=1e-12 * abs(expected).max())


@needs_gcc
@VERSIONS
@pytest.mark.parametrize("kind", list(kinds()))
def test_fmu_is_valid_and_equals_our_simulation(tmp_path: Path, kind: str, options: dict) -> None:
    from fmpy.validation import validate_fmu

    given = kinds()[kind]
    path = write_plant(given, tmp_path / "plate.fmu", **options)
    assert validate_fmu(str(path)) == []
    fmu = Fmu(path, tmp_path / "unzipped")
    fmu.start()
    u = np.random.default_rng(0).standard_normal((len(given.inputs), N))
    close_enough(fmu.run(u, DT), given, u, DT)
    fmu.fmu.reset()
    fmu.start()
    if getattr(given, "dt", None) is None:  # any communication step is exact
        close_enough(fmu.run(u, 7e-5), given, u, 7e-5)
    else:  # whole multiples of the sample time
        seen = fmu.run(u[:, :100], 3 * DT)
        expected = simulate(given, np.arange(N) * DT, np.repeat(u[:, :100], 3, axis=1))["outputs"].values
        np.testing.assert_allclose(seen, expected[:, ::3], rtol=0, atol=1e-12 * abs(expected).max())
    fmu.close()
    assert fmu.messages == []


@needs_gcc
@VERSIONS
def test_states_are_saved_serialized_and_brought_back(tmp_path: Path, options: dict) -> None:
    given = coupled()
    fmu = Fmu(write_plant(given, tmp_path / "p.fmu", **options), tmp_path / "p")
    fmu.start()
    u = np.random.default_rng(0).standard_normal((3, 60))
    fmu.run(u[:, :20], DT)
    saved = fmu.save()
    content = fmu.fmu.serializeFMUState(saved)
    first = fmu.run(u[:, 20:], DT, 20)
    fmu.restore(saved)
    np.testing.assert_array_equal(fmu.run(u[:, 20:], DT, 20), first)
    other = Fmu(tmp_path / "p.fmu", tmp_path / "q")  # bytes go into another instance
    other.start()
    other.restore(other.fmu.deserializeFMUState(content))
    np.testing.assert_array_equal(other.run(u[:, 20:], DT, 20), first)
    fmu.fmu.freeFMUState(saved)
    fmu.close()
    other.close()


@needs_gcc
@VERSIONS
def test_two_instances_do_not_know_each_other(tmp_path: Path, options: dict) -> None:
    given = plant()
    path = write_plant(given, tmp_path / "p.fmu", **options)
    one, two = Fmu(path, tmp_path / "a"), Fmu(path, tmp_path / "b")
    one.start()
    two.start()
    u = np.random.default_rng(3).standard_normal((2, 3, 80))
    seen: list[list[np.ndarray]] = [[], []]
    for k in range(80):
        for i, fmu in enumerate((one, two)):
            seen[i].append(fmu.run(u[i, :, k : k + 1], (i + 1) * DT, k)[:, 0])
    close_enough(np.array(seen[0]).T, given, u[0], DT)
    close_enough(np.array(seen[1]).T, given, u[1], 2 * DT)
    one.close()
    two.close()


@needs_gcc
def test_linear_inputs_are_exact_with_input_derivatives(tmp_path: Path) -> None:
    """FMI 2.0: first-order hold where the importer sets slopes; the inputs end where they lead."""
    given = plant(inputs=["a", "b", "c"], outputs=["x", "y"])
    u = np.random.default_rng(7).standard_normal((3, N))
    fmu = Fmu(write_plant(given, tmp_path / "p.fmu"), tmp_path / "p")
    assert fmu.about.coSimulation.canInterpolateInputs
    fmu.start()
    references, y = (ctypes.c_uint * 3)(*fmu.inputs), []
    for k in range(N):
        fmu.put(u[:, k])
        y.append(fmu.get())
        if k + 1 < N:
            slopes = (ctypes.c_double * 3)(*((u[:, k + 1] - u[:, k]) / DT))
            fmu.fmu.fmi2SetRealInputDerivatives(fmu.fmu.component, references, 3, (ctypes.c_int * 3)(1, 1, 1), slopes)
            fmu.fmu.doStep(k * DT, DT)
            np.testing.assert_allclose(fmu.fmu.getReal(fmu.inputs), u[:, k + 1], rtol=1e-12, atol=1e-14)
    close_enough(np.array(y).T, given, u, DT, hold="first")
    fmu.close()


@needs_gcc
@VERSIONS
def test_fmpy_simulates_it(tmp_path: Path, options: dict) -> None:
    given = plant(static_correction=None, inputs=["a", "b", "c"], outputs=["x", "y"])
    time = np.arange(200) * DT
    u = np.random.default_rng(4).standard_normal((3, 200))
    path = write_plant(given, tmp_path / "plate.fmu", binary=True, dt=DT, **options)
    about = fmpy.read_model_description(str(path))
    assert float(about.defaultExperiment.stepSize) == DT
    arrays = options == {"version": 3}
    if arrays:
        signals = np.array([(t, row) for t, row in zip(time, u.T, strict=True)], dtype=[("time", float), ("u", float, (3,))])
    else:
        signals = np.array(
            [(t, *row) for t, row in zip(time, u.T, strict=True)], dtype=[(n, float) for n in ("time", "a", "b", "c")]
        )
    result = fmpy.simulate_fmu(str(path), input=signals, output_interval=DT, stop_time=time[-1])
    expected = simulate(given, time, u)["outputs"].values
    for k, name in enumerate("xy"):
        seen = result["y"][:200, k] if arrays else result[name][:200]
        assert abs(seen - expected[k]).max() < 1e-11 * abs(expected).max()


@needs_gcc
def test_arrays_carry_names_and_units(tmp_path: Path) -> None:
    given = plant()
    path = write_plant(given, tmp_path / "p.fmu", version=3)
    fmu = Fmu(path, tmp_path / "p")
    variables = {v.name: v for v in fmu.about.modelVariables}
    assert list(variables) == ["time", "u", "u.names", "u.units", "y", "y.names", "y.units"]
    assert (variables["u"].shape, variables["y"].shape) == ((3,), (2,))
    assert variables["u"].description == 'bus.101.1 [N]; bus.101.2 [N]; odd "name" */ ??= [Nm]'
    for name, expected in (
        ("u.names", given.inputs),
        ("u.units", given.input_units),
        ("y.names", given.outputs),
        ("y.units", given.output_units),
    ):
        references = (ctypes.c_uint * 1)(variables[name].valueReference)
        texts = (ctypes.c_char_p * len(expected))()
        fmu.fmu.fmi3GetString(fmu.fmu.component, references, 1, texts, len(expected))
        assert [t.decode() for t in texts] == list(expected)
    one = write_plant(plant(outputs=["a", "b"], output_units=["m", "m"]), tmp_path / "q.fmu", version=3)
    about = fmpy.read_model_description(str(one))
    assert [v.unit for v in about.modelVariables if v.name in "uy"] == [None, "m"]
    assert [u.baseUnit.m for u in about.unitDefinitions if u.name == "N"] == [1]
    scalars = fmpy.read_model_description(str(write_plant(given, tmp_path / "r.fmu", version=3, arrays=False)))
    assert [v.name for v in scalars.modelVariables] == ["time", *given.inputs, *given.outputs]


@pytest.mark.parametrize("options", [{}, {"version": 3, "arrays": False}])
def test_outputs_say_which_inputs_they_follow_at_once(tmp_path: Path, options: dict) -> None:
    """Importers find algebraic loops by this: the displacement has no feedthrough, the acceleration has."""
    given = plant(shape_out_acceleration=np.array([[0.0], [1.0]]) * np.ones((2, 20)))
    about = fmpy.read_model_description(str(write_plant(given, tmp_path / "p.fmu", binary=False, **options)))
    assert [[d.name for d in unknown.dependencies] for unknown in about.outputs] == [[], list(given.inputs)]
