"""Components through MATLAB files: as our reader takes them, and as Octave does."""

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from flexplant.errors import InputError
from flexplant.io import read_component, write_component
from flexplant.model.component import Component
from flexplant.model.geometry import Nodes, cylindrical_frame
from flexplant.model.recovery import Recovery
from flexplant.model.units import UNSTATED

needs_octave = pytest.mark.skipif(shutil.which("octave") is None, reason="Octave is not installed")


def component() -> Component:
    rng = np.random.default_rng(6)
    half = rng.standard_normal((3, 15, 15)) * 10.0 ** rng.integers(-6, 9, (3, 15, 15))
    mass, stiffness, damping = half + half.transpose(0, 2, 1)
    frames = np.stack([np.eye(3), cylindrical_frame([1, 1, 0], [0, 0, 0], np.eye(3))])
    nodes = Nodes(ids=[7, 3], positions=rng.standard_normal((2, 3)), frames=frames)
    recovery = [
        Recovery("displacement", ["20.1", 'a "b": {c}'], displacement=rng.standard_normal((2, 15)), units="m"),
        Recovery("rates", ["1"], velocity=rng.standard_normal((1, 15)), acceleration=rng.standard_normal((1, 15))),
    ]
    boundary = [(7, "123456"), (3, "123456")]
    return Component(name="part", mass=mass, stiffness=sp.csr_array(stiffness), damping=damping, boundary=boundary, nodes=nodes,
                     recovery=recovery)  # fmt: skip


def assert_same(back: Component, given: Component) -> None:
    assert (back.name, back.boundary.pairs, list(back.recovery)) == (given.name, given.boundary.pairs, list(given.recovery))
    for kind in ("mass", "stiffness", "damping"):
        ours, theirs = (getattr(c, kind) for c in (given, back))
        assert (abs(ours - theirs)).max() == 0
    np.testing.assert_array_equal(back.nodes.positions, given.nodes.positions)
    np.testing.assert_allclose(back.nodes.frames, given.nodes.frames, atol=1e-15)
    for name, ours in given.recovery.items():
        theirs = back.recovery[name]
        assert (theirs.labels, theirs.units) == (ours.labels, ours.units)
        for kind in ("displacement", "velocity", "acceleration"):
            np.testing.assert_array_equal(getattr(theirs, kind), getattr(ours, kind))


def test_every_bit_comes_back(tmp_path: Path) -> None:
    given = component()
    back = read_component(write_component(given, tmp_path / "x.mat"))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["x.mat", "x.yaml"]
    assert_same(back, given)
    assert (back.units, back.source["format"]) == ("SI", "mat_matrices")


def test_units_as_they_are_known(tmp_path: Path) -> None:
    given = replace(component(), recovery={})
    open_ = read_component(write_component(replace(given, units=UNSTATED), tmp_path / "o.mat"))
    assert open_.units == UNSTATED
    small = read_component(write_component(replace(given, units="mm-kg-s"), tmp_path / "s.mat"))
    np.testing.assert_allclose(small.nodes.positions, 1e-3 * given.nodes.positions, rtol=1e-15)
    with pytest.raises(InputError, match="in 'cubit', which a sidecar cannot name"):
        write_component(replace(given, units="cubit"), tmp_path / "c.mat")
    bare = replace(component(), nodes=None, damping=None, recovery={}, boundary=[(1, "123")], modal_ids=None)
    assert read_component(write_component(bare, tmp_path / "b.mat")).nodes is None


@needs_octave
def test_octave_reads_and_writes_it_back(tmp_path: Path) -> None:
    """Loaded, checked against the sidecar's words and saved again by Octave: our reader takes that file too."""
    given = component()
    write_component(given, tmp_path / "x.mat")
    text = "p = load('x.mat'); printf('%d ', p.boundary(7, :), size(p.R1), issparse(p.stiffness)); "
    text += "save('-v6', 'y.mat', '-struct', 'p')"
    done = subprocess.run(["octave", "-qf", "--eval", text], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["3", "1", "2", "15", "1"]
    shutil.copyfile(tmp_path / "x.yaml", tmp_path / "y.yaml")
    assert_same(read_component(tmp_path / "y.mat"), given)
