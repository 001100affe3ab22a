"""The commands that look into files and convert them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from flexplant.cli import app
from flexplant.io import read_component, read_model, write_component, write_model, write_plant, write_results
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.geometry import Nodes
from flexplant.plant.modal import ModalPlant


def test_inspect_and_convert(tmp_path: Path) -> None:
    nodes = Nodes(ids=[5], positions=np.zeros((1, 3)))
    given = Component(name="mass", mass=np.eye(4) * 2.0, stiffness=np.diag([0, 0, 0, 9.0]), boundary=[(5, "123")], nodes=nodes)
    source, target = write_component(given, tmp_path / "mass.npz"), tmp_path / "mass.op4"
    shown = CliRunner().invoke(app, ["inspect", str(source)])
    assert shown.exit_code == 0
    assert "3 DOF at nodes 5" in shown.output
    done = CliRunner().invoke(app, ["convert", str(source), str(target)])
    assert (done.exit_code, done.output.strip()) == (0, f"wrote {target}")
    np.testing.assert_array_equal(read_component(target).mass, given.mass)
    wrong = CliRunner().invoke(app, ["convert", str(source), str(tmp_path / "mass.xyz")])
    assert wrong.exit_code == 2
    assert "which choose the format" in wrong.output


def test_options_of_the_format_that_is_read(tmp_path: Path) -> None:
    """A file with several parts: which one, on the command line."""
    path = tmp_path / "parts.npz"
    labels = {f"lab{i}": [[3 + i, d] for d in (1, 2, 3)] for i in (1, 2)}
    np.savez(path, **{f"{kind}{i}": i * np.eye(3) for kind in "KM" for i in (1, 2)}, **labels)
    asked = CliRunner().invoke(app, ["inspect", str(path)])
    assert (asked.exit_code, "pass part=" in asked.output) == (2, True)
    shown = CliRunner().invoke(app, ["inspect", str(path), "-O", "part=2"])
    assert (shown.exit_code, "parts2" in shown.output) == (0, True)
    done = CliRunner().invoke(app, ["convert", str(path), str(tmp_path / "two.npz"), "--option", "part=2"])
    assert done.exit_code == 0
    assert read_model(tmp_path / "two.npz").dofs.pairs == [(5, 1), (5, 2), (5, 3)]
    for text, words in (
        ("part", "write name=value"),
        ("prt=2", "no option 'prt'. Did you mean 'part'"),
        ("part=x", "whole number"),
        ("units=SI", "see --units"),
    ):
        wrong = CliRunner().invoke(app, ["inspect", str(path), "-O", text])
        assert (wrong.exit_code, words in wrong.output) == (2, True), wrong.output


def test_inspect_says_why_there_are_no_frequencies(tmp_path: Path) -> None:
    nodes = Nodes(ids=[5], positions=np.zeros((1, 3)))
    given = Component(name="m", mass=np.diag([1.0, 1.0, 0.0]), stiffness=np.zeros((3, 3)), boundary=[(5, "123")], nodes=nodes)
    shown = CliRunner().invoke(app, ["inspect", str(write_component(given, tmp_path / "m.npz"))])
    assert "none: a rigid-body motion of the model moves no mass" in shown.output


def test_commands_replace_nothing_that_they_read_or_did_not_write(tmp_path: Path) -> None:
    """reduce, convert, export and couple: refused before the work, the files as they were, --force for strangers only."""
    nodes = Nodes(ids=[1, 2, 3], positions=np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]))
    dofs = [(n, d) for n in (1, 2, 3) for d in range(1, 7)]
    stiffness = 1e4 * np.kron([[1, -1, 0], [-1, 2, -1], [0, -1, 1]], np.eye(6))
    whole = FiniteElementModel(name="w", mass=np.eye(18), stiffness=stiffness, dofs=dofs, nodes=nodes)
    model, stranger = write_model(whole, tmp_path / "w.npz"), tmp_path / "s.npz"
    np.savez(stranger, a=1)
    kept = {p: p.read_bytes() for p in (model, stranger)}
    reduce = ["reduce", str(model), "--boundary", "1,3", "--modes", "2", "-o"]
    for target, force in ((model, []), (model, ["--force"]), (stranger, [])):
        told = CliRunner().invoke(app, [*reduce, str(target), *force])
        assert (told.exit_code, target.name in told.output, "reduced" in told.output) == (2, True, False)
    assert kept == {p: p.read_bytes() for p in kept}
    assert CliRunner().invoke(app, [*reduce, str(stranger), "--force"]).exit_code == 0
    assert CliRunner().invoke(app, [*reduce, str(stranger)]).exit_code == 0  # its own by now
    part = read_component(stranger)
    plant = ModalPlant(omega=[3.0], zeta=0.1, shape_in=[[1.0]], shape_out=[[1.0]], inputs=["u"], outputs=["y"])
    source = write_plant(plant, tmp_path / "p.npz")
    (tmp_path / "p.mat").write_bytes(b"measured")
    commands = [
        ["export", str(source), "--to", "m"],
        ["couple", str(stranger), "-o", str(stranger), "--force"],
        ["convert", str(stranger), str(source)],
    ]
    for command in commands:
        assert CliRunner().invoke(app, command).exit_code == 2
    assert (tmp_path / "p.mat").read_bytes() == b"measured"
    assert (tmp_path / "p.m").exists() is False
    assert CliRunner().invoke(app, [*commands[0], "--force"]).exit_code == 0
    assert np.array_equal(read_component(stranger).stiffness, part.stiffness)


@pytest.mark.parametrize("command", [["run"], ["check"], ["inspect"], ["couple"], ["convert", "y.npz"], ["export", "--to", "c"],
                                     ["reduce", "--boundary", "1", "-o", "x.npz"]])  # fmt: skip
def test_a_path_that_is_not_there_is_told_at_once(command: list[str], tmp_path: Path) -> None:
    """Before numpy is imported, let alone the formats; by `python -m flexplant` as by the script."""
    words = [command[0], "nope.yaml", *command[1:]]
    code = f"import sys; sys.argv = ['flexplant', *{words!r}]; import runpy\n"
    code += "try: runpy.run_module('flexplant', run_name='__main__')\n"
    code += "except SystemExit as end: print(end.code, 'numpy' in sys.modules, file=sys.stderr)"
    found = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert found.stderr.splitlines() == ["flexplant: nope.yaml: no such file", "2 False"]


def test_a_stem_without_ending_is_still_found(tmp_path: Path) -> None:
    nodes = Nodes(ids=[5], positions=np.zeros((1, 3)))
    write_component(
        Component(name="m", mass=np.eye(3), stiffness=np.eye(3), boundary=[(5, "123")], nodes=nodes), tmp_path / "m.npz"
    )
    assert CliRunner().invoke(app, ["inspect", str(tmp_path / "m")]).exit_code == 0
    assert CliRunner().invoke(app, ["inspect", str(tmp_path / "n")]).exit_code == 2


def test_inspect_shows_results(tmp_path: Path) -> None:
    """A NetCDF file, ours or another's: what variables it has, along which dimensions."""
    response = xr.DataArray(np.ones((2, 3, 4), dtype=complex), dims=("output", "input", "frequency"), attrs={"units": "m/N"})
    data = xr.Dataset({"response": response, "count": 3}, attrs={"title": "A run"})
    write_results(data, tmp_path / "r.nc")
    data[["count"]].to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    shown = CliRunner().invoke(app, ["inspect", str(tmp_path / "r.nc"), str(tmp_path / "other.nc")])
    assert shown.exit_code == 0, shown.output
    for words in ("results (NetCDF-4)", "A run", "complex128, 2 output x 3 input x 4 frequency [m/N]", "one number"):
        assert words in shown.output
    (tmp_path / "bad.nc").write_bytes((tmp_path / "r.nc").read_bytes()[:700])
    assert CliRunner().invoke(app, ["inspect", str(tmp_path / "bad.nc")]).exit_code == 2
