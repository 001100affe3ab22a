"""`flexplant reduce`: what it writes couples like the model itself; mistakes are one line."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

import flexplant as fp
from flexplant.cli import app

N = 8


@pytest.fixture
def model(tmp_path):
    """A free chain of eight masses along x, as a file."""
    k = 1e4 * (np.diag([1.0] + [2.0] * (N - 2) + [1.0]) - np.eye(N, k=1) - np.eye(N, k=-1))
    nodes = fp.Nodes(np.arange(1, N + 1), np.c_[np.arange(float(N)), np.zeros((N, 2))])
    chain = fp.FiniteElementModel(name="chain", mass=np.eye(N), stiffness=k, dofs=[(i, 1) for i in range(1, N + 1)], nodes=nodes)
    return fp.write_model(chain, tmp_path / "chain.npz")


def call(*arguments: object):
    return CliRunner().invoke(app, ["reduce", *map(str, arguments)])


def test_the_written_component_has_the_modes_of_the_model(model, tmp_path):
    out = tmp_path / "reduced.npz"
    result = call(model, "--boundary", f"1,{N}:1", "--modes", N - 2, "-o", out)
    assert result.exit_code == 0, result.output
    assert f"reduced {N} DOF to {N}" in result.stdout
    full, reduced = (fp.normal_modes(m).frequency_hz for m in (fp.read_model(model), fp.read_component(out)))
    np.testing.assert_allclose(reduced, full, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("how", [("--accuracy", 1e-6), ("--size", 4)])
def test_what_was_chosen_and_its_bound_are_told(model, tmp_path, how):
    out = tmp_path / "reduced.npz"
    result = call(model, "--boundary", f"1,{N}:1", "--max-frequency", 15, *how, "-o", out)
    assert result.exit_code == 0, result.output
    assert "frequency error below 15 Hz at most" in result.stdout
    full, reduced = (fp.normal_modes(m).frequency_hz for m in (fp.read_model(model), fp.read_component(out)))
    low = full[(full > 0.1) & (full < 15)]
    assert low.size > 1
    written = fp.read_component(out)
    assert (reduced[1 : 1 + low.size] / low - 1).max() <= written.report.verified + 1e-12
    assert written.n_modal <= N - 2


@pytest.mark.parametrize("option", ["--residual-vectors", "--ritz"])
def test_blocks_of_residual_vectors(model, tmp_path, option):
    out = tmp_path / "reduced.npz"
    assert call(model, "--boundary", f"1,{N}:1", "--modes", 1, option, 2, "-o", out).exit_code == 0
    assert fp.read_component(out).n_modal == 5


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--boundary", "99:1", "--modes", 2), "99"),
        (("--boundary", "1:8", "--modes", 2), "directions"),
        (("--boundary", "one:1", "--modes", 2), "whole numbers"),
        (("--boundary", " ", "--modes", 2), "boundary"),
        (("--boundary", "1:1"), "give --max-frequency or --modes"),
        (("--boundary", "1:1", "--modes", 50), "50"),
        (("--boundary", "1:1", "--accuracy", 1e-6), "--max-frequency"),
        (("--boundary", "1:1", "--accuracy", 3, "--max-frequency", 5), "between 0 and 1"),
        (("--boundary", "1:1", "--accuracy", 1e-3, "--modes", 2, "--max-frequency", 5), "not --modes"),
        (("--boundary", "1:1", "--size", 0, "--max-frequency", 30), "size 0 is too small"),
        (("--boundary", "1:1", "--size", 4), "--max-frequency"),
        (("--boundary", "1:1", "--size", 4, "--max-frequency", 5, "--residual-vectors", 1), "or --residual-vectors"),
    ],
)
def test_mistakes_are_one_line_and_nothing_is_written(model, tmp_path, arguments, words):
    out = tmp_path / "reduced.npz"
    result = call(model, *arguments, "-o", out)
    assert result.exit_code == 2
    (line,) = result.stderr.strip().splitlines()
    assert words in line
    assert not out.exists()


def test_a_bad_ending_is_told_before_the_model_is_read(tmp_path):
    (tmp_path / "none.npz").write_text("nothing that can be read")
    result = call(tmp_path / "none.npz", "--boundary", "1:1", "--modes", 2, "-o", tmp_path / "reduced.txt")
    assert result.exit_code == 2
    assert "has none of the endings" in result.stderr


def test_the_component_can_be_named(model, tmp_path):
    assert call(model, "--boundary", "1:1", "--modes", 2, "--name", "arm", "-o", tmp_path / "r.npz").exit_code == 0
    assert fp.read_component(tmp_path / "r.npz").name == "arm"
    bad = call(model, "--boundary", "1:1", "--modes", 2, "--name", "two.parts", "-o", tmp_path / "s.npz")
    assert (bad.exit_code, "without dots" in bad.stderr) == (2, True)
