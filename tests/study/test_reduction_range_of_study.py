"""A study says where its reductions end: checks, summary, table, the terminal's text and the plant's report."""

from __future__ import annotations

import csv

import pytest
from small_study import write_study

import flexplant as fp
from flexplant.study.pipeline import run_study

BODY = """\
title: A chain reduced in the study
components:
  body: {{file: whole.npz, reduce: {{boundary: [[1, '123456'], [6, '123456']], {reduce}}}}}
damping: {{ratio: 0.01}}
verification: {{rigid_body_modes: 6{more}}}
plant: {{inputs: [body.1.123], outputs: [body.6.123], max_frequency_hz: {top}}}
"""


def result(tmp_path, reduce, top, more=""):
    study = write_study(tmp_path, BODY.format(reduce=reduce, top=top, more=more))
    return run_study(study, output=tmp_path / "out")


def test_a_plant_beyond_its_reductions_is_no_passed_study(tmp_path):
    found = result(tmp_path, "max_frequency_hz: 40", 200)
    check = found.checks["body: modes complete up to the frequency asked"]
    assert not check.passed
    assert check.limit == 200
    words = f"asked up to 200 Hz, but component 'body' is complete only below {check.value:.4g} Hz"
    assert f"A{words[1:]}" in found.text()
    assert words in found.plant.report["notice"]
    assert found.plant.report["complete_below_hz"] == check.value
    assert words in (tmp_path / "out" / "report.html").read_text().replace("&#39;", "'")
    assert fp.read_plant(tmp_path / "out" / "plant.npz").report["notice"] == found.plant.report["notice"]


def test_a_plant_within_its_reductions_shows_the_errors_of_its_modes(tmp_path):
    found = result(tmp_path, "max_frequency_hz: 200, residual_vectors: 1", 100)
    assert found.checks.passed
    assert "notice" not in found.plant.report
    (table,) = (t for t in found.tables if t.title.startswith("Estimated frequency errors"))
    flexible = found.modes.frequency_hz[found.modes.n_rigid :]
    assert [row[1] for row in table.rows] == pytest.approx(flexible[flexible <= 100].tolist())
    assert str(table) in found.text()
    assert "Estimated frequency errors of the reductions up to 100 Hz" in found.text()
    with (tmp_path / "out" / found.files[table.title].name).open() as stream:
        assert len(list(csv.reader(stream))) == 1 + len(table.rows)


def test_the_study_says_what_error_it_accepts(tmp_path):
    name = "estimated frequency error of the reductions"
    value = result(tmp_path, "max_frequency_hz: 200", 100).checks[name].value / 100
    (tmp_path / "again").mkdir()
    stricter = result(tmp_path / "again", "max_frequency_hz: 200", 100, f", reduction_error: {value / 2:.3e}")
    assert not stricter.checks[name].passed
    assert f"FAILED {name}" in stricter.text()
