"""Everything read says where it came from: path, hash of the file, reader, and what became of its units."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nx_files import TRUSS
from structures import frame_model
from test_uff_reference import function, mode

import flexplant as fp
from flexplant.errors import ReadError
from flexplant.io import inspect

UNITS_IN_MM = "    -1\n   164\n         5mm (milli newton)            2\n  1.0D+03  1.0D+03  1.0D+00\n  2.7315D+02\n    -1\n"


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def plant() -> fp.ModalPlant:
    """Of two components that were read from files, one of them in millimetres."""
    parts = [fp.read_component(TRUSS / f"{name}.op4", units="mm-kg-s") for name in ("outboard", "inboard")]
    truss = fp.couple(parts, [fp.Connection("outboard", "inboard", pairs=[(n, n) for n in (3, 11, 19, 27)])])
    return fp.modal_plant(truss, inputs=["outboard.3.1"], outputs=["inboard.27.2"], n_modes=9, damping_ratio=0.01)


def sources(folder: Path) -> dict[str, tuple[Path, Any, str]]:
    """By kind: the file, its record, and what the record has to say of units."""
    deck = folder / "whole.dat"
    deck.write_text("INCLUDE 'part.blk'\nGRID,99,,0.,0.,1000.\n")
    (folder / "part.blk").write_text("GRID,1,,0.,0.,0.\nGRID,2,,1000.,0.,0.\nCBAR,1,1,1,2,0.,0.,1.\n")
    uff = folder / "test.uff"
    uff.write_text(UNITS_IN_MM + mode(20.0, np.ones((2, 3))) + function(np.ones(3, dtype=complex)))
    files = {e: fp.write_plant(plant(), folder / f"p.{e}") for e in ("npz", "h5", "mat")}
    model = fp.write_model(frame_model("beam", {1: np.zeros(3), 2: np.ones(3)}, [(1, 2)]), folder / "beam.npz")
    mm = "mm (milli newton) (dataset 164: 0.001 m, 0.001 N)"
    return {
        "component": (TRUSS / "outboard.op4", fp.read_component(TRUSS / "outboard.op4", units="mm-kg-s").source, "mm-kg-s"),
        "model": (model, fp.read_model(model).source, "SI"),
        "geometry": (deck, fp.read_geometry(deck, units="mm-tonne-s").source, "mm-tonne-s"),
        "modes": (uff, fp.read_reference(uff).provenance, mm),
        "functions": (uff, fp.read_response_functions(uff)[0].source, f"{mm}: not converted: a function of type 4, frequency"),
        **{e: (path, fp.read_plant(path).source, "of the channels, as in the file: N, m") for e, path in files.items()},
    }


def test_every_record_has_the_hash_of_its_file_and_says_what_became_of_units(tmp_path: Path) -> None:
    for kind, (path, record, units) in sources(tmp_path).items():
        assert (record["path"], record["sha256"]) == (str(path), digest(path)), kind
        assert record["reader"].startswith("flexplant.io"), kind
        assert record["format"], kind
        assert record["units"].startswith(units), kind
        if kind != "component":  # whose units are the argument's
            shown = dict(inspect(path).rows)
            assert shown["sha256"] == digest(path)[:16], kind
    geometry = fp.read_geometry(tmp_path / "whole.dat")
    assert geometry.source["files"] == {str(tmp_path / "part.blk"): digest(tmp_path / "part.blk")}
    assert dict(inspect(tmp_path / "whole.dat").rows)["with"] == "part.blk"


def test_geometry_in_metres_with_the_frames_of_its_grids() -> None:
    mesh, metres = (fp.read_geometry(TRUSS / "outboard.dat", units=u) for u in (None, "mm-kg-s"))
    np.testing.assert_allclose(metres.positions, mesh.positions / 1000, rtol=1e-15)
    assert mesh.source["units"] == "not stated: numbers as in the file"
    component = fp.read_component(TRUSS / "outboard.op4", units="mm-kg-s")
    for grid in (3, 11, 19, 27):
        at = mesh.nodes.tolist().index(grid)
        np.testing.assert_allclose(metres.frames[at], component.nodes.frame(grid), atol=1e-12)
        np.testing.assert_allclose(metres.positions[at], component.nodes.position(grid), atol=1e-12)


def test_a_plant_keeps_what_it_is_made_of_through_forms_and_files(tmp_path: Path) -> None:
    made = plant()
    part = made.source["components"]["outboard"]
    assert (part["file"], part["units"]) == ("outboard.op4", "mm-kg-s")
    assert part["files"]["outboard.pch"] == digest(TRUSS / "outboard.pch")
    assert str(TRUSS) not in str(made.source)
    forms = [fp.state_space(made), fp.discretize(made, 1e-3), fp.select(made, outputs=made.outputs)]
    for form in (*forms, fp.reduce_modes(made, keep=2)):
        assert form.source == made.source
    for ending in ("npz", "h5"):
        path = fp.write_plant(forms[1], tmp_path / f"p.{ending}")
        assert fp.read_plant(path).source["origin"] == made.source
        assert dict(inspect(path).rows)["made from"].startswith("outboard (outboard.op4, nastran_extseout)")


def test_universal_files_in_millimetres_become_metres(tmp_path: Path) -> None:
    """Receptance mm/mN is m/N; accelerance of a moment at a rotation, 1/(mN mm), is 1e6 times that in 1/(N m)."""
    shapes = np.arange(1.0, 7.0).reshape(2, 3)
    path = tmp_path / "test.uff"
    lines = function(np.ones(3, dtype=complex)).splitlines()
    lines[11 - 1] = f"{8:10d}{0:5d}{0:5d}{0:5d} {'Displacement':20} {'mm':20}"
    lines[12 - 1] = f"{13:10d}{0:5d}{0:5d}{0:5d} {'Force':20} {'mN':20}"
    turned = [*lines]
    turned[7] = turned[7].replace(f"{12:10d}{-3:4d}", f"{12:10d}{5:4d}").replace(f"{11:10d}{1:4d}", f"{11:10d}{-6:4d}")
    text = mode(20.0, shapes) + "\n".join(lines) + "\n" + "\n".join(turned) + "\n"
    path.write_text(text)
    plain, asked = fp.read_response_functions(path), fp.read_response_functions(path, units="mm-kg-s")
    np.testing.assert_allclose(fp.read_reference(path, component="bus").shapes[:, 0], shapes.ravel())
    assert (plain[0].values[0], plain[0].attrs["ordinate"]["units"]) == (1.0, "mm")
    for given in (asked, fp.read_response_functions(with_units(path, text))):
        assert (given[0].attrs["ordinate"]["units"], given[0].attrs["denominator"]["units"]) == ("m", "N")
        np.testing.assert_allclose(given[0].values, 1.0)
        assert (given[1].response, given[1].reference) == ((12, 5), (11, -6))
        np.testing.assert_allclose(given[1].values, 1e6)
        assert (given[1].attrs["ordinate"]["units"], given[1].attrs["denominator"]["units"]) == ("rad", "N m")
    np.testing.assert_allclose(fp.read_reference(path, component="bus").shapes[:, 0], shapes.ravel() / 1000)
    with pytest.raises(ReadError, match="dataset 164 says mm"):
        fp.read_reference(path, units="SI")
    path.write_text(text + UNITS_IN_MM.replace("1.0D+03  1.0D+03", "0.0D+00  1.0D+03"))
    with pytest.raises(ReadError, match="no factors of length and force"):
        fp.read_reference(path)


def with_units(path: Path, text: str) -> Path:
    path.write_text(UNITS_IN_MM + text)
    return path
