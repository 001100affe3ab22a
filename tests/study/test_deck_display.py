"""A study whose components bring bulk data: their meshes move in the report, which says where they came from."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import numpy as np
import pytest

import flexplant as fp
from flexplant.study.assemble import assemble, read_components
from flexplant.study.display import shape_notes, structure_view
from flexplant.study.load import load_study
from flexplant.study.provenance import provenance

TRUSS = Path(pytest.importorskip("pyyeti").__file__).parent / "tests" / "nas2cam_extseout"
FILES = (
    "outboard.op4",
    "outboard.asm",
    "outboard.pch",
    "outboard.dat",
    "outboard.blk",
    "inboard.op4",
    "inboard.asm",
    "inboard.pch",
)
STUDY = """\
title: truss
components:
  outboard: {file: outboard.op4, units: mm-kg-s, geometry: outboard.dat}
  inboard: {file: inboard.op4, units: mm-kg-s}
connections: [{a: outboard, b: inboard, nodes: [3, 11, 19, 27]}]
damping: {ratio: 0.005}
plant: {inputs: [outboard.3.1], outputs: [inboard.27.2], max_frequency_hz: 20}
report: {mode_shapes: [7, 8]}
"""


def test_the_deck_of_a_vendors_component_is_drawn_and_recorded(tmp_path: Path) -> None:
    for name in FILES:
        shutil.copy(TRUSS / name, tmp_path / name)
    path = tmp_path / "study.yaml"
    path.write_text(STUDY)
    study = load_study(path)
    system = assemble(study, read_components(study, tmp_path))
    modes = fp.normal_modes(system, max_frequency_hz=20)
    view = structure_view(study, tmp_path, system, modes)
    mesh = fp.read_geometry(TRUSS / "outboard.dat", units="mm-kg-s")
    asked = fp.mode_view(system, modes, {"outboard": mesh}, numbers=[7, 8])
    assert view.mesh.nodes.tolist() == [3, 11, 19, 27, 45, 60]
    np.testing.assert_allclose(view.shapes, asked.shapes)
    assert "6 of 27 nodes" in view.caption
    assert shape_notes(study, tmp_path, system, modes) == (
        "report.mode_shapes: component 'inboard' brings no recovery 'display', so its motion cannot be drawn",
    )
    groups = provenance(study, path, system)
    assert groups["Geometry of outboard"]["units"] == "mm-kg-s"
    for name in ("outboard.dat", "outboard.blk"):
        assert groups["Files (SHA-256)"][name] == hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()
