"""The command line: what it prints, exit codes, one line a mistake, nothing half-written."""

import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from structures import chain_halves
from typer.testing import CliRunner

import flexplant.study.pipeline as pipeline
from flexplant.cli import app
from flexplant.io import read_plant, write_component, write_plant
from flexplant.io.output import plant_endings
from flexplant.model.component import Component
from flexplant.plant.modal import ModalPlant

sys.path.insert(0, str(Path(__file__).parent / "study"))
from small_study import STUDY, write_study

COMMANDS = ("demo", "run", "check", "reduce", "couple", "export", "new", "schema")
EXECUTABLE = [sys.executable, "-c", "from flexplant.cli import main; main()"]


def call(*arguments: object):
    """Run the app in this process."""
    return CliRunner().invoke(app, [str(a) for a in arguments])


def refused(*arguments: object, code: int = 2) -> str:
    """The one line on stderr of a refused call."""
    result = call(*arguments)
    assert result.exit_code == code, result.output
    assert "Traceback" not in result.output
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith("flexplant: ")
    return lines[0]


@pytest.fixture
def halves(tmp_path: Path) -> list[Path]:
    """The two halves of the chain as files."""
    return [write_component(c, tmp_path / f"{c.name}.npz") for c in chain_halves()]


def test_help_names_every_command_with_an_example():
    text = call("--help").output
    assert all(command in text for command in COMMANDS)
    assert "130 interrupted" in " ".join(text.split())
    for command in COMMANDS:
        assert f"Example: flexplant {command}" in " ".join(call(command, "--help").output.split())


def test_help_is_fast_because_nothing_heavy_is_imported():
    code = "import sys; from flexplant.cli import app; print([m for m in ('numpy', 'pydantic', 'plotly') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"


def test_version():
    assert call("--version").output.startswith("flexplant 0")


def test_run_prints_the_tables_and_where_the_results_are(tmp_path):
    result = call("run", write_study(tmp_path), "-o", tmp_path / "out", "-q")
    assert result.exit_code == 0
    assert "6 rigid-body modes" in result.stdout
    assert "Plant against the unreduced model" in result.stdout
    assert str(tmp_path / "out" / "report.html") in result.stdout.replace("\n", "")


def test_progress_goes_to_stderr_only(tmp_path):
    study = write_study(tmp_path)
    loud, quiet = (call("run", study, "-o", tmp_path / "out", *more) for more in ((), ("-q",)))
    assert loud.stdout == quiet.stdout
    assert quiet.stderr == ""
    assert "100 %" in loud.stderr


def test_a_failed_check_is_exit_code_1_and_the_results_are_there(tmp_path):
    study = write_study(tmp_path, STUDY.replace("rigid_body_modes: 6", "rigid_body_modes: 5"))
    assert "rigid-body modes" in refused("run", study, "-o", tmp_path / "out", "-q", code=1)
    assert (tmp_path / "out" / "report.html").is_file()


def test_check_prints_mass_properties_and_modes(halves):
    result = call("check", *halves)
    assert result.exit_code == 0
    for text in ("left", "right", "Mass properties", "rigid-body strain energy", "0 modal"):
        assert text in result.stdout


def test_check_of_a_bad_frame_is_exit_code_1(tmp_path):
    left, _ = chain_halves()
    stiffness = np.array(left.stiffness)
    stiffness[0, 0] *= 1.01
    write_component(Component(name="grounded", mass=left.mass, stiffness=stiffness, boundary=left.boundary, nodes=left.nodes),
                    tmp_path / "grounded.npz")  # fmt: skip
    assert "rigid-body strain energy" in refused("check", tmp_path / "grounded.npz", code=1)


def test_couple_prints_the_modes_and_writes_the_matrices(halves, tmp_path):
    out = tmp_path / "system.npz"
    result = call("couple", *halves, "--connect", "left:right:4", "-o", out)
    assert result.exit_code == 0, result.output
    assert "rigid body" in result.stdout
    with np.load(out) as arrays:
        assert tuple(arrays["shape"]) == (48, 48)


def test_couple_by_position_needs_one_side_to_match_completely(halves):
    assert "List the interface nodes" in refused("couple", *halves, "--connect", "left:right")


def test_export_to_matlab_and_back_to_npz(tmp_path):
    call("run", write_study(tmp_path), "-o", tmp_path / "out", "-q")
    plant = tmp_path / "out" / "plant.npz"
    assert call("export", plant, "--to", "mat", "-o", tmp_path / "p.mat").exit_code == 0
    assert (tmp_path / "p.mat").stat().st_size > 1000
    assert call("export", plant, "--to", "h5").exit_code == 0
    np.testing.assert_array_equal(read_plant(plant.with_suffix(".h5")).omega, read_plant(plant).omega)
    assert "Did you mean 'mat'" in refused("export", plant, "--to", "matt")
    assert "that file already" in refused("export", plant, "--to", "npz")


def test_export_knows_every_plant_format_and_its_options(tmp_path):
    plant = write_plant(
        ModalPlant(omega=[0.0, 9.0], zeta=0.01, shape_in=np.ones((2, 1)), shape_out=np.ones((1, 2)), inputs=["f"], outputs=["y"]),
        tmp_path / "plant.npz",
    )
    needed = {"c": ["--dt", "1e-3", "--hold", "first"], "fmu": ["--fmi", "3", "--dt", "0.01"]}
    for ending in plant_endings():
        target = tmp_path / f"copy.{ending}"
        assert call("export", plant, "--to", ending, "-o", target, *needed.get(ending, [])).exit_code == 0, ending
        assert target.stat().st_size > 100
        assert ending in call("export", "--help").stdout
    assert "linear between samples" in (tmp_path / "copy.h").read_text()
    assert "--dt" in refused("export", plant, "--to", "c")
    assert "no option --fmi" in refused("export", plant, "--to", "c", "--dt", "1e-3", "--fmi", "3")
    said = refused("export", plant, "--to", "fmu", "--fmi", "4")  # in the words that were typed
    assert "--fmi 4: FMUs are written for FMI 2.0 or 3.0; pass --fmi 2 or --fmi 3" in said
    assert "version" not in said
    assert "does not end with .c" in refused("export", plant, "--to", "c", "--dt", "1e-3", "-o", tmp_path / "p.fmu")
    assert "there is no folder" in refused("export", plant, "--to", "mat", "-o", tmp_path / "nowhere" / "p.mat")


def test_new_writes_a_study_once(tmp_path):
    path = tmp_path / "study.yaml"
    assert call("new", path).exit_code == 0
    assert "exists already" in refused("new", path)
    assert "no file 'bus.op4'" in call("run", path, "-o", tmp_path / "out").stderr


def test_schema_is_printed_as_json():
    assert call("schema").stdout.startswith("{")
    assert call("schema", "--markdown").stdout.startswith("# The study file")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("title:", "titel:", "line 1: unknown key 'titel'; did you mean 'title'?"),
        ("left.npz", "../left.npz", "outside the study's folder"),
        ("nodes: [4]}", "nodes: [7]}", "7"),
        ("nodes: [4]}", "nodes: [4]}\n  - {a: left, b: right, nodes: [4]}", "left"),
        ("nodes: [4]}", "nodes: [4], frame: polar}", "'a', 'b' or 'system'"),
        ("left.1.123456", "left.1.7", "left.1.7"),
        ("right.6.12]", "right.60.1]", "60"),
        ("left.npz}", "left.npz, units: yards}", "yards"),
        ("left.npz}", "left.npz, format: nastran}", "nastran"),
    ],
)
def test_a_bad_study_is_exit_code_2_with_one_line(tmp_path, old, new, said):
    assert old in STUDY
    study = write_study(tmp_path, STUDY.replace(old, new))
    assert said in refused("run", study, "-o", tmp_path / "out", "-q")
    assert not (tmp_path / "out").exists()


def test_permission_to_leave_the_folder_is_given_on_the_command_line(tmp_path):
    folder = tmp_path / "inner"
    folder.mkdir()
    study = write_study(folder)
    (folder / "left.npz").rename(tmp_path / "left.npz")
    study.write_text(STUDY.replace("left.npz", "../left.npz"))
    refused("run", study, "-o", tmp_path / "out", "-q")
    assert call("run", study, "-o", tmp_path / "out", "-q", "--allow-outside").exit_code == 0


def unsymmetric(path: Path) -> None:
    """A component file whose stiffness has one triangle only."""
    with np.load(path) as data:
        arrays = dict(data)
    name = next(k for k in arrays if "stiffness" in k and arrays[k].ndim == 2)
    arrays[name] = np.triu(arrays[name])
    np.savez(path, **arrays)


def with_nan(path: Path) -> None:
    """A component file with a NaN in its mass."""
    with np.load(path) as data:
        arrays = dict(data)
    name = next(k for k in arrays if "mass" in k and arrays[k].ndim == 2)
    arrays[name][1, 2] = np.nan
    np.savez(path, **arrays)


def cut_short(path: Path) -> None:
    """A truncated file."""
    path.write_bytes(path.read_bytes()[:700])


def noise(path: Path) -> None:
    """A file of another kind."""
    path.write_bytes(bytes(range(256)) * 8)


@pytest.mark.parametrize(
    ("harm", "said"), [(unsymmetric, "not symmetric"), (with_nan, "not finite"), (cut_short, ""), (noise, "")]
)
def test_a_bad_component_file_is_exit_code_2_and_named(halves, harm, said):
    harm(halves[0])
    line = refused("check", halves[0])
    assert "left.npz" in line
    assert said in line


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["check", "none.op4"], "none.op4"),
        (["run", "none.yaml"], "none.yaml"),
        (["export", "none.npz", "--to", "mat"], "none.npz"),
        (["couple", "left.npz", "--connect", "left"], "write a:b:node,node"),
        (["couple", "left.npz", "--connect", "left:right:x"], "whole numbers"),
        (["couple", "left.npz", "--ground", "left"], "component:node,node"),
        (["couple", "left.npz", "--method", "both"], "both"),
    ],
)
def test_bad_arguments_are_exit_code_2(halves, monkeypatch, arguments, said):
    monkeypatch.chdir(halves[0].parent)
    assert said in refused(*arguments)


def test_usage_errors_are_exit_code_2():
    assert call("demos").exit_code == 2
    assert call("run").exit_code == 2
    assert call("demo", "--fast").exit_code == 2


def test_an_output_folder_that_cannot_be_written_is_exit_code_2(tmp_path):
    study = write_study(tmp_path)
    assert "choose another folder" in refused("run", study, "-o", study / "out", "-q")
    assert "choose another folder" in refused("demo", "-o", study / "out", "-q")


def test_an_interrupt_is_exit_code_130(tmp_path, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "assemble", stop)
    assert "interrupted" in refused("run", write_study(tmp_path), "-o", tmp_path / "out", "-q", code=130)
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT for another process")
def test_ctrl_c_in_the_middle_of_the_demo_leaves_nothing(tmp_path):
    out = tmp_path / "out"
    process = subprocess.Popen([*EXECUTABLE, "demo", "-o", str(out), "-q"], stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while not list(out.glob(".partial-*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(1.0)  # well inside the work
    for _ in range(5):  # finalisers, and libraries that catch everything, drop an interrupt that arrives inside them
        process.send_signal(signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            _, said = process.communicate(timeout=2)  # well before the demo would have ended by itself
            break
    assert process.returncode == 130, said
    assert said.strip() == "flexplant: interrupted; nothing was written"
    assert not out.exists()


def test_a_missing_folder_is_told_before_the_model_is_read(tmp_path):
    (tmp_path / "no-model.npz").write_text("nothing that can be read")
    told = refused("reduce", tmp_path / "no-model.npz", "--boundary", "1:123", "--modes", 2, "-o", tmp_path / "no" / "bus.npz")
    assert "there is no folder" in told


def test_a_mistake_before_the_first_step_prints_one_line_only(tmp_path):
    result = call("run", tmp_path / "missing.yaml")
    assert result.exit_code == 2
    assert result.stderr.startswith("flexplant: "), "no empty line of a progress bar that never began"
