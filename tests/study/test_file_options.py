"""Files of several parts, and models whose positions stand in a listing, in a study."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ansys_files import write_full

from flexplant.errors import InputError, StudyError
from flexplant.io import read_model
from flexplant.study.assemble import read_components
from flexplant.study.load import load_study

STUDY = """\
title: One part
components:
  bar: {file: FILE, reduce: {boundary: [[1, "123"]], n_modes: 3}, MORE}
plant: {inputs: [bar.1.1], outputs: [bar.1.2]}
"""
SPRINGS = np.kron(2 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1), np.eye(3)) + np.eye(9)


def study(folder: Path, file: str, more: str) -> Path:
    (folder / "study.yaml").write_text(STUDY.replace("FILE", file).replace("MORE", more))
    return folder / "study.yaml"


def read(path: Path) -> object:
    (component,) = read_components(load_study(path), path.parent)
    return component


def test_one_of_several_parts(tmp_path: Path) -> None:
    labels = [[n, d] for n in (1, 2, 3) for d in (1, 2, 3)]
    arrays = {f"{kind}{i}": i * m for kind, m in (("K", SPRINGS), ("M", np.eye(9))) for i in (1, 4)}
    np.savez(tmp_path / "parts.npz", **arrays, lab1=labels, lab4=labels)
    path = study(tmp_path, "parts.npz", "options: {part: 4}")
    found = read(path)
    one = read(study(tmp_path, "parts.npz", "options: {part: 1}"))
    np.testing.assert_allclose(np.trace(found.stiffness[:3, :3]), 4 * np.trace(one.stiffness[:3, :3]))
    with pytest.raises(StudyError, match="prt"):
        load_study(study(tmp_path, "parts.npz", "options: {prt: 4}"))
    with pytest.raises(InputError, match="no option 'node'"):
        read(study(tmp_path, "parts.npz", "options: {node: 4}"))


def test_a_full_file_with_its_listing_of_nodes(tmp_path: Path) -> None:
    write_full(tmp_path / "bar.full", {"stiffness": SPRINGS, "mass": np.eye(9)}, [1, 2, 3], [1, 2, 3])
    (tmp_path / "nodes.lis").write_text("".join(f"{n} {float(n)} 0.0 0.0 0. 0. 0.\n" for n in (1, 2, 3)))
    found = read(study(tmp_path, "bar.full", "geometry: nodes.lis"))
    assert found.nodes.position(1).tolist() == [1, 0, 0]
    assert read_model(tmp_path / "bar.full", geometry=tmp_path / "nodes.lis").nodes.position(3).tolist() == [3, 0, 0]
