"""The display mesh of a component stands in the same units as the component."""

from __future__ import annotations

from shutil import copy

import numpy as np

from flexplant.study.display import mesh_of
from flexplant.study.examples import example_study
from flexplant.study.schema import ComponentSpec


def test_a_mesh_in_millimetres_is_converted_with_its_component(tmp_path):
    data = example_study("shocksat").parent
    for name in ("bus.OU1", "bus_display.npz", "bus.bdf"):
        copy(data / name, tmp_path)
    lines = (data / "bus.yaml").read_text().splitlines()
    (tmp_path / "bus.yaml").write_text("\n".join(line for line in lines if not line.startswith("units")))
    metres, millimetres = (mesh_of(ComponentSpec(file="bus.OU1", units=u), tmp_path) for u in ("SI", "mm-tonne-s"))
    np.testing.assert_allclose(millimetres.positions, 1e-3 * metres.positions, rtol=1e-15)
