"""The example study: every published figure that the surrogate can be held to."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flexplant.study.examples import example_study
from flexplant.study.pipeline import run_study
from flexplant.study.result import StudyResult

PUBLISHED_HZ = [107.0, 112.8, 114.9, 139.3]
FEW = "frequency: {frequency_hz: [15, 40, 70, 107.0, 112.755, 250, 400]}"  # of the unreduced model: each takes a while


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> StudyResult:
    """The example with a short comparison with the unreduced model."""
    folder = tmp_path_factory.mktemp("shocksat") / "data"
    shutil.copytree(example_study("shocksat").parent, folder)
    study = folder / "study.yaml"
    long = "frequency: {from_hz: 10, to_hz: 500, points: 99, spacing: linear}"
    assert long in study.read_text()
    study.write_text(study.read_text().replace(long, FEW))
    return run_study(study, output=folder / "out")


def test_all_checks_pass(result):
    assert result.checks.passed, str(result.checks)


def test_table_2_within_a_tenth_of_a_percent(result):
    """Dual assembly beside MYSTRAN's whole model, and beside the published four frequencies."""
    rows = [row for row in result.compared.table.rows if not str(row[0]).startswith("Rigid")]
    assert [row[0] for row in rows] == ["Axial 1", "X bending 1", "Axial 2", "Y bending 1"]
    assert max(abs(row[4]) for row in rows) < 0.1
    np.testing.assert_allclose([row[2] for row in rows], PUBLISHED_HZ, rtol=1e-3)
    np.testing.assert_allclose([row[3] for row in rows], PUBLISHED_HZ, rtol=1.2e-3)
    assert result.compared.lowest_mac > 0.9999


def test_rigid_body_modes_lie_five_orders_below(result):
    rows = [row for row in result.compared.table.rows if str(row[0]).startswith("Rigid")]
    assert len(rows) == 6
    assert max(row[3] for row in rows) < 1e-5 * 107.0
    assert (result.modes.frequency_hz[:6] == 0.0).all()


def test_all_errors_are_those_of_a_truncated_basis(result):
    """A reduced basis can only stiffen: every frequency is above the whole model's, and less than 0.5 % so."""
    error = result.compared.every.error_percent
    assert error.size == 61
    assert error.min() > -1e-4
    assert error.max() < 0.5


def test_figure_4_plant_over_the_unreduced_model(result):
    truth = result.truth
    direct, plant = truth.direct.values[0, 0], truth.plant.values[0, 0]
    local = abs(plant / direct - 1)
    np.testing.assert_array_less(local[:3], 0.01)
    peak = abs(direct).max()
    assert abs(plant - direct)[:6].max() < 0.15 * peak, "a frequency error of 0.05 % beside a half bandwidth of 0.5 %"
    assert abs(truth.uncorrected.values[0, 0, -1] / direct[-1]) < 0.2, "above 300 Hz the truncated plant rolls off"


def test_components_reduced_here_follow_the_unreduced_model(result):
    """Fewer coordinates than delivered, and no observable difference where the plant keeps its modes."""
    truth = result.truth
    direct, second = truth.direct.values[0, 0], truth.second.values[0, 0]
    below = truth.direct["frequency"].values < 150
    np.testing.assert_array_less(abs(second / direct - 1)[below], 1e-3)
    assert truth.second_below_limit[3] < 0.1 < truth.below_limit[3]


def test_figure_9_loop_numbers(result):
    for axis in result.line_of_sight.figures:
        assert axis.peak_hz == pytest.approx(675.4, rel=1e-3)
        assert axis.bandwidth_hz == pytest.approx(1049.4, rel=1e-3)
        assert axis.rejection_hz == pytest.approx(434.8, rel=1e-3)
        assert axis.phase_margin_deg == pytest.approx(0.81, abs=0.005)


def test_figure_9_singular_values_resolve_the_resonances(result):
    """Peaks are on the grid, those of the modes and that of the loop itself, and the table says what the curves show."""
    loop = result.line_of_sight
    assert loop.peak_gain["open loop"][1] == pytest.approx(112.8, rel=1e-3)
    assert loop.peak_gain["closed loop"][1] == pytest.approx(139.4, rel=1e-3)
    assert loop.loop_peak_gain["closed loop"][1] == pytest.approx(675.4, rel=1e-3)
    (table,) = (t for t in loop.tables if t.title.startswith("Wheel to spot"))
    for case, *numbers in table.rows:
        for value, at in (numbers[:2], numbers[2:]):
            curve = loop.singular_values[case].isel(index=0)
            assert value == float(curve.sel(frequency=at))
            if case == "closed loop":
                assert value == float(curve.where(abs(curve["frequency"] - at) < 20, drop=True).max())
    closed = loop.singular_values["closed loop"].isel(index=0)
    near = closed.where(abs(closed["frequency"] - 675.4) < 20, drop=True)
    assert float(near["frequency"][near.values.argmax()]) == pytest.approx(675.4, rel=1e-3)
    assert loop.peak_gain["closed loop"][0] < 0.05 * loop.peak_gain["open loop"][0]


def test_axial_modes_are_absent_from_x_and_y(result):
    loop = result.line_of_sight
    x, y, z = (loop.contribution[f"optic.9101.{d}"] for d in (1, 2, 3))
    assert loop.flexible_hz[0] == pytest.approx(107.0, rel=1e-3)
    assert z[0] > 0.1
    assert max(x[0], y[0]) < 1e-9
    assert any("107.0 Hz" in text and "do not reach the spot" in text for text in result.summary)


def test_figures_7_and_8_spot_open_and_closed(result):
    loop = result.line_of_sight
    assert list(loop.histories) == [20.0, 56.4]
    for speed in loop.histories:
        assert loop.rms(speed, "closed loop") < 0.05 * loop.rms(speed, "open loop")
    assert loop.rms(56.4, "open loop") > 10 * loop.rms(20.0, "open loop"), "the second harmonic meets the first x-bending mode"
    assert abs(loop.histories[56.4]["closed loop"]["outputs"]).max() < 1e-6, "below a micron, as published"


def test_the_report_says_that_it_is_a_surrogate_and_shows_the_structure(result):
    page = result.files["report"].read_text()
    assert "surrogate" in page
    assert "X bending 1" in page
    assert "0.81" in page
    for component in ("bus.OU1", "optic.OU1"):
        assert component in page
    assert len(result.study.report.mode_shapes) == 10


CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on the path (Debian: apt install chromium)")
def test_the_report_is_drawn_in_a_browser(result, tmp_path):
    """Every figure and the 3-D view, without an error of the page's own scripts."""
    flags = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--virtual-time-budget=40000",
        "--dump-dom",
    ]
    command = [CHROMIUM, *flags, "--dump-dom", f"--user-data-dir={tmp_path}", result.files["report"].resolve().as_uri()]
    page = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False).stdout
    root = page[: page.index("<head")]
    assert 'data-state="ready"' in root
    assert 'data-views="1"' in root
    assert int(root.split('data-plots="')[1].split('"')[0]) == 11
    assert "data-errors" not in root


@pytest.mark.slow
def test_the_demo_runs_from_an_empty_folder(tmp_path: Path):
    code = "from flexplant.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", code, "demo"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    names = {path.name for path in (tmp_path / "flexplant-demo").iterdir()}
    assert {"report.html", "plant.npz", "plant.mat", "results.nc", "tables.txt"} <= names
    assert "All checks passed" in done.stdout
