"""Files of several parts, and models whose positions stand in a listing, in a study."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from ansys_files import write_full
from small_study import write_study

from flexplant.errors import InputError, StudyError, WriteError
from flexplant.io import read_component, read_model
from flexplant.study.assemble import read_components
from flexplant.study.load import load_study
from flexplant.study.pipeline import run_study

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


def test_options_of_a_components_format(tmp_path: Path) -> None:
    """Which part, which sidecar: by the names the readers have, paths inside the study's folder."""
    path = write_study(tmp_path)
    left = read_component(tmp_path / "left.npz")
    np.savez(tmp_path / "plain.npz", mass=left.mass, stiffness=left.stiffness)
    nodes = [[int(i), *map(float, left.nodes.position(i))] for i in left.nodes.ids]
    sidecar = {"boundary": [[int(n), str(d)] for n, d in left.boundary.pairs], "nodes": nodes, "units": "SI"}
    (tmp_path / "words").mkdir()
    (tmp_path / "words" / "left.yaml").write_text(json.dumps(sidecar))
    text = path.read_text()

    def given(options: str) -> Path:
        path.write_text(text.replace("{file: left.npz}", f"{{file: plain.npz, format: npz_matrices, options: {options}}}"))
        return path

    result = run_study(given("{sidecar: words/left.yaml}"))
    assert result.checks.passed
    np.testing.assert_allclose(result.system.component("left").mass, left.mass)
    (tmp_path / "tables.txt").hardlink_to(tmp_path / "words" / "left.yaml")
    with pytest.raises(WriteError, match=r"tables\.txt is a file that this study reads"):
        run_study(path, output=tmp_path)
    for options, error, said in (
        ("{sidecar: words/none.yaml}", StudyError, "options: there is no file 'words/none.yaml'"),
        ("{sidecar: ../left.yaml}", StudyError, "lies outside the study's folder"),
        ("{units: SI}", StudyError, "'units' is no option of a format"),
        ("{sidcar: words/left.yaml}", StudyError, "no format has an option 'sidcar'. Did you mean 'sidecar'"),
        ("{sidecar: words/left.yaml, max_bytes: much}", InputError, "max_bytes must be a finite number"),
    ):
        with pytest.raises(error, match=said):
            run_study(given(options))
