"""What a study's report does not show it names: mode shapes without a mesh, modes that do not exist, curves of round-off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from small_study import STUDY, write_study

import flexplant as fp
from flexplant.report import Plot
from flexplant.study.pipeline import run_study
from flexplant.study.reporting import report, round_off_height

NO_TRUTH = STUDY[: STUDY.index("truth:")]


def section(result, heading):
    return next(s for s in report(result, None).sections if s.heading == heading).items


def test_mode_shapes_that_cannot_be_drawn_are_named(tmp_path):
    result = run_study(write_study(tmp_path, NO_TRUTH + "report: {mode_shapes: [7, 900]}\n"), output=tmp_path / "out")
    assert f"there is no mode 900; the study solves for modes 1 to {len(result.modes)}" in result.text()
    assert "component 'left' brings no recovery 'display'; component 'right' brings no recovery 'display'" in result.text()
    page = (tmp_path / "out" / "report.html").read_text()
    assert "there is no mode 900" in page
    assert "so its motion cannot be drawn" in page


def test_nothing_is_said_where_no_shapes_are_asked_for(tmp_path):
    assert run_study(write_study(tmp_path, NO_TRUTH)).notes == ()


def decoupled(result):
    """The result with modes that move right.6.2 or take the force left.1.1, but not both, to round-off."""
    plant, rng = result.plant, np.random.default_rng(2)
    y, u = list(plant.outputs).index("right.6.2"), list(plant.inputs).index("left.1.1")
    out, given = np.array(plant.shape_out), np.array(plant.shape_in)
    out[y, ::2] = 1e-15 * rng.standard_normal(out[y, ::2].size)
    given[1::2, u] = 1e-15 * rng.standard_normal(given[1::2, u].size)
    plant = replace(plant, shape_out=out, shape_in=given, static_correction=None)
    return replace(result, plant=plant, response=fp.frequency_response(plant, result.response["frequency"].values))


def test_only_round_off_is_left_out(tmp_path):
    result = run_study(write_study(tmp_path, NO_TRUTH.replace("right.6.12]", "right.6.12, 'right.6.2:a']")))
    for output in ("right.6.1", "right.6.2", "right.6.2:a"):
        assert round_off_height(result, output, "left.1.1") is None
    result = decoupled(result)
    largest = float(abs(result.response.sel(output="right.6.2", input="left.1.1")).max())
    assert 0 < largest == round_off_height(result, "right.6.2", "left.1.1")
    assert round_off_height(result, "right.6.1", "left.1.1") is None
    assert round_off_height(result, "right.6.2", "left.1.2") is None
    items = section(result, "Transfer functions")
    titles = [item.figure.layout.title.text for item in items if isinstance(item, Plot)]
    assert not any("right.6.2 /" in title for title in titles)
    assert any("right.6.1 /" in title for title in titles)
    assert any(isinstance(item, str) and item.startswith("right.6.2 / left.1.1 is not drawn") for item in items)
