"""The pipeline against the unsplit structure, and its files: all of them or none."""

import json
from typing import get_args

import numpy as np
import pytest
import xarray as xr
from small_study import LINE_OF_SIGHT, STUDY, write_study
from structures import chain, elastic_hz

import flexplant.study.pipeline as pipeline
import flexplant.study.write as write
from flexplant.errors import CouplingError, InputError, StudyError, WriteError
from flexplant.io import read_plant
from flexplant.io.output import plant_endings
from flexplant.response.frequency import frequency_response
from flexplant.study.grid import frequency_grid
from flexplant.study.load import load_study
from flexplant.study.pipeline import run_study
from flexplant.study.schema_outputs import ExportSpec, ResponseSpec


def files(folder):
    """Name -> content of everything below a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_study_gives_the_unsplit_structure_back(tmp_path):
    result = run_study(write_study(tmp_path))
    whole = chain()
    expected = elastic_hz(whole.mass, whole.stiffness, 6)
    assert result.modes.n_rigid == 6
    np.testing.assert_allclose(result.modes.frequency_hz[6:], expected, rtol=1e-9)
    assert result.checks.passed
    difference = abs(result.truth.plant - result.truth.direct).max() / abs(result.truth.direct).max()
    assert difference < 1e-8, "nothing is reduced here, so the plant is the structure"
    assert result.files == {}


def test_a_study_writes_the_plant_for_other_programs(tmp_path):
    wanted = "export: [{to: c, dt_s: 1.0e-4}, {to: fmu, fmi: 3, name: bus_3}, {to: fmu, dt_s: 0.01}, {to: m, name: model}]\n"
    result = run_study(write_study(tmp_path, STUDY + wanted), output=tmp_path / "out")
    for name in ("plant.c", "plant.h", "bus_3.fmu", "plant.fmu", "model.m", "model.mat"):
        assert (tmp_path / "out" / name).stat().st_size > 100
    assert result.files["plant as fmu: bus_3"] == tmp_path / "out" / "bus_3.fmu"
    assert read_plant(tmp_path / "out" / "plant.npz").n_modes == result.plant.n_modes


@pytest.mark.parametrize(
    ("wanted", "says"),
    [
        ("{to: c}", "give dt_s, in seconds"),
        ("{to: mat, dt_s: 0.1}", "dt_s is an option of c and fmu, not of mat"),
        ("{to: fmu, hold: first}", "hold is an option of c, not of fmu"),
        ("{to: fmu, name: ../plant}", "export.0.name"),
        ("{to: m, name: end}", "'end' is a word of MATLAB's own"),
        ("{to: xlsx}", "'c', 'fmu'"),
        ("{to: fmu}, {to: fmu, fmi: 3}", "export writes plant.fmu twice"),
    ],
)
def test_an_export_that_cannot_be_is_told_before_anything_is_computed(tmp_path, wanted, says):
    with pytest.raises(StudyError, match=says):
        load_study(write_study(tmp_path, f"{STUDY}export: [{wanted}]\n"))


def test_the_study_file_knows_every_plant_format():
    assert set(get_args(ExportSpec.model_fields["to"].annotation)) == set(plant_endings()) - {"hdf5"}


def test_primal_and_dual_studies_agree(tmp_path):
    dual = run_study(write_study(tmp_path))
    primal = run_study(write_study(tmp_path, STUDY + "method: primal\n"))
    np.testing.assert_allclose(
        primal.response.values, dual.response.values, rtol=1e-8, atol=1e-9 * abs(dual.response.values).max()
    )


def test_damping_of_the_components_is_equation_4(tmp_path):
    text = STUDY.replace("damping: {ratio: 0.01}", "damping: {ratio: 0.01, on: components}")
    result = run_study(write_study(tmp_path, text))
    assert all(c.damping is not None for c in result.system.components)
    assert not result.system.damping.count_nonzero(), "components that keep every DOF have no modal coordinates to damp"


def test_a_grounded_study_has_no_rigid_body_modes(tmp_path):
    text = STUDY.replace("rigid_body_modes: 6", "rigid_body_modes: 0") + "ground: [{component: left, nodes: [2]}]\n"
    result = run_study(write_study(tmp_path, text.split("truth:")[0] + "ground: [{component: left, nodes: [2]}]\n"))
    assert result.modes.n_rigid == 0
    assert result.checks.passed


def test_a_floating_part_fails_its_check_and_says_which(tmp_path):
    text = STUDY.replace("nodes: [4]}", "nodes: [4], directions: '123'}")
    result = run_study(write_study(tmp_path, text))
    assert not result.checks.passed
    assert "floats" in result.checks.failed[0].explanation
    assert "FAILED rigid-body modes" in result.text()


def test_all_files_are_written_and_can_be_read_back(tmp_path):
    out = tmp_path / "out"
    heard = []
    result = run_study(write_study(tmp_path, STUDY + LINE_OF_SIGHT), output=out, progress=lambda text, share: heard.append(share))
    assert all(path.is_file() for path in result.files.values())
    assert not list(out.glob(".*")), "no work folder is left"
    assert heard == sorted(heard)
    assert heard[-1] == 1.0
    plant = read_plant(result.files["plant"])
    np.testing.assert_array_equal(plant.omega, result.plant.omega)
    np.testing.assert_array_equal(plant.shape_out, result.plant.shape_out)
    with xr.open_dataset(result.files["results"], engine="h5netcdf") as data:
        stored = data["frequency_response__real"].values + 1j * data["frequency_response__imag"].values
        np.testing.assert_array_equal(stored, result.response.values)
        assert set(data["case"].values) == {"open loop", "closed loop"}
        hashes = json.loads(data.attrs["Files (SHA-256)"])
        assert {"study.yaml", "left.npz"} <= set(hashes)
        assert all(len(digest) == 64 for digest in hashes.values())
        assert str(tmp_path) not in result.files["report"].read_text(encoding="utf-8"), "where it was made is nobody's business"
    page = result.files["report"].read_text()
    assert "Two halves of a chain" in page
    assert "phase margin" in page
    assert "rigid-body modes" in result.files["tables"].read_text()


def test_closed_loop_spot_is_the_open_one_times_the_sensitivity(tmp_path):
    loop = run_study(write_study(tmp_path, STUDY + LINE_OF_SIGHT)).line_of_sight
    opened, closed = (loop.sweep["amplitude"].sel(case=case) for case in ("open loop", "closed loop"))
    hz = opened["harmonic"] * opened["omega_hz"]
    s = 2j * np.pi * hz / 100.0
    sensitivity = 1 / (1 + 1800 / (s**2 + 0.6 * s + 1))
    np.testing.assert_allclose(closed.values, (opened * sensitivity).transpose(*closed.dims).values, rtol=1e-9)
    speed = loop.sweep["rms"].sel(case="open loop", omega_hz=20.0)
    assert loop.rms(20.0, "open loop") == pytest.approx(float(np.sqrt((speed**2).sum())), rel=0.02)


@pytest.mark.parametrize(
    ("module", "step"), [(pipeline, "frequency_response"), (pipeline, "compare_with_truth"), (write, "render")]
)
@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
def test_an_interrupted_study_leaves_the_old_results_as_they_were(tmp_path, monkeypatch, module, step, error):
    study, out = write_study(tmp_path), tmp_path / "out"
    run_study(study, output=out)
    before = files(out)

    def stop(*_, **__):
        raise error

    monkeypatch.setattr(module, step, stop)
    with pytest.raises(error):
        run_study(study, output=out)
    assert files(out) == before
    with pytest.raises(error):
        run_study(study, output=tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_an_output_folder_that_cannot_be_written_is_refused_before_the_work(tmp_path, monkeypatch):
    study = write_study(tmp_path)
    monkeypatch.setattr(pipeline, "read_components", lambda *_: pytest.fail("the work has begun"))
    for out in (study, study / "below", "/proc/flexplant"):
        with pytest.raises(WriteError, match="choose another folder"):
            run_study(study, output=out)


@pytest.mark.parametrize(
    ("old", "new", "error", "said"),
    [
        ("nodes: [4]}", "nodes: [5]}", CouplingError, "5"),
        ("nodes: [4]}", "nodes: [4]}\n  - {a: right, b: left, nodes: [4], directions: '1'}", CouplingError, "4"),
        ("left.1.123456", "left.9.1", InputError, "9"),
        ("right.6.12]", "right.display.1]", InputError, "display"),
        ("output: right.6.1", "output: right.5.1", InputError, "right.5.1"),
        ("file: left.npz}", "file: left.npz, units: furlong}", InputError, "furlong"),
    ],
)
def test_what_cannot_be_coupled_or_observed_is_named(tmp_path, old, new, error, said):
    assert old in STUDY
    with pytest.raises(error, match=said):
        run_study(write_study(tmp_path, STUDY.replace(old, new)))


def test_a_wheel_on_a_node_that_is_no_input_is_named(tmp_path):
    text = STUDY + LINE_OF_SIGHT.replace("node: left.1", "node: left.2")
    with pytest.raises(StudyError, match=r"left\.2\.1"):
        run_study(write_study(tmp_path, text))


def test_unimportant_modes_are_dropped_on_request(tmp_path):
    full = run_study(write_study(tmp_path))
    few = run_study(write_study(tmp_path, STUDY.replace("  outputs:", "  drop_tolerance: 1e-2\n  outputs:")))
    assert few.plant.n_modes < full.plant.n_modes
    assert few.plant.n_rigid == 6
    hz = np.linspace(10, 200, 40)
    ours, theirs = (frequency_response(result.plant, hz) for result in (few, full))
    assert abs(ours - theirs).max() < 0.02 * abs(theirs).max()


@pytest.mark.parametrize("spacing", ["log", "linear"])
def test_frequencies_resolve_every_resonance(tmp_path, spacing):
    plant = run_study(write_study(tmp_path)).plant
    hz = frequency_grid(ResponseSpec(from_hz=5, to_hz=200, points=10, spacing=spacing), plant, also=((77.0, 0.001),))
    assert (np.diff(hz) > 0).all()
    assert (hz[0], hz[-1]) == (5.0, 200.0)
    for mode in [*plant.frequency_hz[(plant.frequency_hz > 6) & (plant.frequency_hz < 190)], 77.0]:
        assert abs(hz - mode).min() < 1e-12 * mode
        assert np.sum(abs(hz / mode - 1) < 0.011) >= 5


def test_frequencies_given_as_a_list_are_taken_as_they_are(tmp_path):
    plant = run_study(write_study(tmp_path)).plant
    np.testing.assert_array_equal(frequency_grid(ResponseSpec(frequency_hz=[3.0, 1.0, 3.0]), plant), [1.0, 3.0])


@pytest.mark.parametrize("how", ["accuracy: 1.0e-7", "size: 16"])
def test_a_study_reduces_to_a_promise_or_a_budget(tmp_path, how):
    """The unsplit chain alone, reduced in the study, with a force inside it."""
    reduce = "{boundary: [[1, '123456'], [6, '123456']], max_frequency_hz: 60, " + how + ", loads: [[3, '3']]}"
    body = "components:\n  body: {file: whole.npz, reduce: " + reduce + "}\ndamping: {ratio: 0.01}\n"
    text = "title: One body\n" + body + "plant:\n  inputs: [body.3.3]\n  outputs: [body.6.12]\n"
    result = run_study(write_study(tmp_path, text))
    whole = chain()
    expected = elastic_hz(whole.mass, whole.stiffness, 6)
    expected = expected[expected < 60]
    assert result.plant.inputs == ("body.3.3",)
    np.testing.assert_allclose(result.modes.frequency_hz[6 : 6 + expected.size], expected, rtol=1e-7)
    assert result.modes.frequency_hz.size < len(whole.dofs)


@pytest.mark.parametrize("name", ["plant", "left"])
def test_a_study_does_not_replace_what_it_reads(tmp_path, monkeypatch, name):
    """Results in the study's own folder, where a component has the name of a result: told before the work."""
    path = write_study(tmp_path, STUDY.replace("left.npz", f"{name}.npz") + f"export: [{{to: npz, name: {name}x}}]\n")
    if name == "plant":
        (tmp_path / "left.npz").rename(tmp_path / "plant.npz")
    else:
        path.write_text(path.read_text().replace("leftx", "left"))
    before = files(tmp_path)
    monkeypatch.setattr(pipeline, "read_components", None)
    with pytest.raises(WriteError, match=rf"{name}\.npz is a file that this study reads"):
        run_study(path, output=tmp_path)
    assert files(tmp_path) == before


def test_names_that_only_the_results_have_are_no_sources_either(tmp_path):
    path = write_study(tmp_path, STUDY)
    (tmp_path / "tables.txt").hardlink_to(tmp_path / "whole.npz")
    with pytest.raises(WriteError, match=r"tables\.txt is a file"):
        run_study(path, output=tmp_path)
    assert (tmp_path / "tables.txt").read_bytes() == (tmp_path / "whole.npz").read_bytes()
