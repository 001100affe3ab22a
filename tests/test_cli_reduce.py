"""`flexplant reduce`: what it writes couples like the model itself; mistakes are one line."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import flexplant as fp
from flexplant.cli import app
from flexplant.errors import InputError
from flexplant.study.arguments import parse_patch
from flexplant.study.reduction import reduce_model
from flexplant.study.schema_reduce import InterfaceNodeSpec

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


@pytest.fixture(scope="module")
def plate(tmp_path_factory):
    """The plate of the example, as a file, and its model."""
    place = Path(__file__).parents[1] / "examples" / "bolted_plate" / "make.py"
    spec = importlib.util.spec_from_file_location("bolted_plate_model", place)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    model = script.plate("plate")
    return fp.write_model(model, tmp_path_factory.mktemp("plate") / "plate.npz"), model


PATCH = [(1 + n) for n in (0, 1, 2, 3, 12, 13, 14, 15)]


def reduced(plate, out, *arguments):
    """The component that the command wrote."""
    result = call(plate[0], *arguments, "-q", "-o", out)
    assert result.exit_code == 0, result.output
    return fp.read_component(out), result


@pytest.mark.parametrize(
    ("kind", "arguments", "call_of_library"),
    [
        ("average", ("--method", "rubin", "--modes", 5), lambda m, b: fp.rubin(m, b, n_modes=5)),
        ("rigid", ("--method", "guyan"), fp.guyan),
        (
            "average",
            ("--max-frequency", 9e3, "--ritz", 1),
            lambda m, b: fp.craig_bampton(m, b, max_frequency_hz=9e3, residual_vectors=1),
        ),
    ],
)
def test_each_method_with_a_patch_is_what_the_library_gives(plate, tmp_path, kind, arguments, call_of_library):
    patch = (f"--{kind}-patch", "500=1-4,13-16")
    ours, result = reduced(plate, tmp_path / "r.npz", "--boundary", "500 108:123", *patch, *arguments)
    middle = plate[1].nodes.positions[[n - 1 for n in PATCH]].mean(axis=0)
    model = fp.with_interface_node(plate[1], 500, middle, PATCH, kind=kind)
    theirs = call_of_library(model, [(500, "123456"), (108, "123")])
    np.testing.assert_array_equal(ours.stiffness, theirs.stiffness)
    np.testing.assert_array_equal(ours.mass, theirs.mass)
    assert str(theirs.report) in result.stdout
    assert f"reduced 324 DOF to {theirs.n}" in result.stdout


@pytest.mark.parametrize(
    ("more", "options"),
    [
        ({"kind": "average", "weights": [1.0, 2, 3, 4, 5, 6]}, {"weights": np.arange(1.0, 7)}),
        ({"kind": "rigid", "directions": "123"}, {"directions": "123"}),
    ],
)
def test_a_patch_of_a_study_is_what_lies_within_its_radius(plate, more, options):
    """Six nodes lie within 0.0551 m of the corner: cells are 0.05, 0.05 and 0.02 m."""
    spec = InterfaceNodeSpec(node=500, radius_m=0.0551, position_m=[0, 0, 0], **more)
    listed = InterfaceNodeSpec(node=500, patch=["1-4", "13-14"], position_m=[0, 0, 0], kind="rigid")
    near = [1, 2, 3, 4, 13, 14]
    assert listed.arguments["patch"] == near
    ours = reduce_model(plate[1], [(500, "123456"), (108, "123")], method="guyan", interface_nodes=[spec.arguments])
    theirs = fp.guyan(
        fp.with_interface_node(plate[1], 500, [0, 0, 0], near, kind=spec.kind, **options), [(500, "123456"), (108, "123")]
    )
    np.testing.assert_array_equal(ours.stiffness, theirs.stiffness)


def test_a_patch_as_text():
    assert parse_patch("500=1-3,9@0.1,-2,3e-1", "rigid") == {
        "node": 500, "kind": "rigid", "patch": [1, 2, 3, 9], "position_m": [0.1, -2.0, 0.3]
    }  # fmt: skip
    assert parse_patch("5=0.03@1,2,3", "average") == {
        "node": 5,
        "kind": "average",
        "radius_m": 0.03,
        "position_m": [1.0, 2.0, 3.0],
    }
    for wrong in ("500", "500=1-4@1,2", "500=0.1", "x=1", "5=", "5=3-1", "5=1@1,2,x", "=1,2,3"):
        with pytest.raises(InputError, match="write node=node,node-node"):
            parse_patch(wrong, "average")


def test_characteristic_modes_loads_recovery_and_basis_are_written(plate, tmp_path):
    options = ("--boundary", "1,6:123 97-108:123", "--modes", 8, "--loads", "50:3", "--recover", "55:12", "--keep-basis")
    small, result = reduced(plate, tmp_path / "r.h5", *options, "--keep", "1,6:123", "--interface-modes", 30)
    assert "30 coordinates of the interface for 36 boundary DOF" in result.stdout
    assert (small.report.interface_coordinates, small.report.interface_dofs) == (30, 36)
    assert small.boundary.nodes == [1, 6]
    assert small.interior.pairs == [(50, 3)]
    assert small.recovery["displacement"].labels == ("55.1", "55.2")
    np.testing.assert_allclose(small.basis.T @ (plate[1].mass @ small.basis), small.mass, atol=1e-9)
    np.testing.assert_allclose(small.interior_rows[0], small.basis[3 * 49 + 2], atol=1e-9)
    full = fp.normal_modes(plate[1], n_modes=10).frequency_hz[6:]
    assert (fp.normal_modes(small).frequency_hz[6:10] / full - 1).max() < 5e-3
    fewer, _ = reduced(plate, tmp_path / "f.npz", *options, "--keep", "1,6:123", "--interface-frequency", 6e3)
    assert small.n_boundary == fewer.n_boundary == 6
    assert fewer.n < small.n


def test_two_files_share_a_reduced_interface(plate, tmp_path):
    left, right = tmp_path / "left.npz", tmp_path / "right.npz"
    here, there = (
        fp.craig_bampton(plate[1], [(n, "123") for n in edge], max_frequency_hz=6e3, residual_vectors=1)
        for edge in (range(97, 109), range(1, 13))
    )
    fp.write_component(here, left)
    nodes = fp.Nodes(ids=there.nodes.ids, positions=there.nodes.positions + np.array([0.4, 0, 0]))
    fp.write_component(replace(there, nodes=nodes), right)
    runner = CliRunner()
    arguments = ["couple", str(left), str(right), "--connect", "left:right::123", "--max-frequency", "800", "-o"]
    sizes, first = [], []
    for place, more in (("whole.npz", []), ("small.npz", ["--interface-modes", "left-right=20"])):
        done = runner.invoke(app, [*arguments, str(tmp_path / place), *more])
        assert done.exit_code == 0, done.output
        with np.load(tmp_path / place) as data:
            sizes.append(int(data["shape"][0]))
        first.append(float(done.stdout.split("\n7 ")[-1].split()[0]))
    assert sizes[1] < sizes[0] - 2 * 16
    assert first[1] == pytest.approx(first[0], rel=1e-4)
    for wrong, words in (("left-rigth=20", "Did you mean 'left-right'"), ("left-right", "write connection=number")):
        refused = runner.invoke(app, [*arguments, str(tmp_path / "x.npz"), "--interface-modes", wrong])
        assert (refused.exit_code, words in refused.stderr) == (2, True), refused.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--method", "guyan", "--modes", 3), "--modes is no option of method guyan, which has recover"),
        (("--modes", 3, "--loads", "50:3 50:13"), "--loads: DOF set: listed twice: 50-3"),
        (("--modes", 3, "--interface-modes", 4), "need --keep"),
        (("--modes", 3, "--keep", "1,12:123", "--interface-modes", -4), "--interface-modes must be a whole number"),
    ],
)
def test_mistakes_in_the_words_of_the_command_line(plate, tmp_path, arguments, words):
    result = call(plate[0], "--boundary", "1,12:123 6:1", *arguments, "-q", "-o", tmp_path / "x.npz")
    assert result.exit_code == 2
    (line,) = result.stderr.strip().splitlines()
    assert words in line
    assert not (tmp_path / "x.npz").exists()


def averaged(*nodes, node=500):
    """An averaging patch for reduce_model."""
    return {"node": node, "kind": "average", "patch": list(nodes)}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"method": "Rubin"}, "there is no method 'Rubin'. Did you mean 'rubin'?"),
        ({"method": "rubin", "accuracy": 1e-3}, "accuracy is no option of method rubin"),
        ({"interface_nodes": [averaged(13, 14, 900)]}, "interface_nodes.0 (node 500): model 'plate' has no node 900"),
        ({"interface_nodes": [averaged(13)]}, "does not define all six motions"),
        ({"interface_nodes": [averaged(*range(13, 18)), averaged(17, 18, 19, 20, node=501)]}, "node 17 is in the patches of"),
        ({"interface_nodes": [averaged(12, 13, 14, 15)]}, "node 12 is in the patch of interface node 500"),
        ({"interface_nodes": [averaged(13, 14, 15, node=502)]}, "interface node 502 is neither in boundary nor in loads"),
        (
            {"interface_nodes": [{"node": 500, "kind": "rigid", "radius_m": 0.01, "position_m": [0, 0, 9]}]},
            "no node within radius_m 0.01 of position_m; the nearest is node 2 at 8.98 m",
        ),
        ({"characteristic": {"keep": [(50, "123")], "n_modes": 4}}, "characteristic_modes: component 'plate' has no node 50"),
    ],
)
def test_mistakes_about_methods_and_interfaces(plate, given, words):
    new = [(node, "123456") for node in (500, 501)][: len(given.get("interface_nodes", ()))]
    with pytest.raises(InputError) as caught:
        reduce_model(plate[1], [(1, "123"), (12, "123"), (6, 1), *new], n_modes=3, **given)
    assert words in str(caught.value)


def test_a_format_that_cannot_hold_what_is_asked_is_told_first(tmp_path):
    (tmp_path / "none.npz").write_text("nothing that can be read")
    for extra, what in ((("--loads", "1:1"), "interior DOF"), (("--keep-basis",), "basis")):
        result = call(tmp_path / "none.npz", "--boundary", "1:1", "--modes", 2, *extra, "-o", tmp_path / "r.op4")
        assert (result.exit_code, f"does not hold the {what}" in result.stderr) == (2, True)


def test_progress_of_a_long_reduction_is_on_stderr(model, tmp_path, monkeypatch):
    def slow(model, boundary, progress):
        progress("modes", 0.5)
        return fp.guyan(model, boundary)

    monkeypatch.setattr("flexplant.study.reduction.METHODS", {"guyan": slow})
    loud = call(model, "--boundary", f"1,{N}:1", "--method", "guyan", "-o", tmp_path / "r.npz")
    assert "modes" in loud.stderr
    assert "50 %" in loud.stderr
