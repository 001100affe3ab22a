"""The commands that look into files and convert them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from flexplant.cli import app
from flexplant.io import read_component, write_component
from flexplant.model.component import Component
from flexplant.model.geometry import Nodes


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
