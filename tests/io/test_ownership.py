"""What is written replaces nothing but what was written there before: sources, partners and strangers stay as they are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import xarray as xr

from flexplant.errors import ReadError, WriteError
from flexplant.io import (
    convert,
    read_component,
    read_plant,
    write_component,
    write_model,
    write_plant,
    write_results,
)
from flexplant.io.output import writers
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.geometry import Nodes
from flexplant.plant.modal import ModalPlant

PAIRS = [(27, d) for d in range(1, 7)] + [(3, d) for d in range(1, 7)]  # nodes not ascending


def component(name: str = "panel") -> Component:
    rng = np.random.default_rng(4)
    half = rng.normal(size=(15, 15))
    nodes = Nodes(ids=[3, 27], positions=rng.normal(size=(2, 3)))
    K = half @ half.T
    return Component(name=name, mass=np.eye(15) + 0.01 * K, stiffness=K, boundary=PAIRS, nodes=nodes, modal_ids=[90, 91, 92])


def jacket() -> Component:
    return Component(name="jacket", mass=np.eye(7), stiffness=np.eye(7), boundary=[(1, d) for d in range(1, 7)])


def model() -> FiniteElementModel:
    return FiniteElementModel(name="m", mass=np.eye(3), stiffness=np.eye(3), dofs=[(1, 1), (1, 2), (1, 3)])


def plant(gain: float = 1.0) -> ModalPlant:
    return ModalPlant(omega=[3.0], zeta=0.1, shape_in=[[gain]], shape_out=[[1.0]], inputs=["u"], outputs=["y"])


def content(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir()}


WRITES = [(kind, suffix) for w in writers().values() for kind in w.writers for suffix in w.suffixes if kind != "write_results"]


def written(kind: str, path: Path) -> Path:
    if kind == "write_component":
        return write_component(jacket() if path.suffix == ".extptfm" else component(), path)
    if kind == "write_model":
        return write_model(model(), path)
    return write_plant(plant(), path, **{".c": {"dt": 1e-3}, ".fmu": {"binary": False}}.get(path.suffix, {}))


@pytest.mark.parametrize(("kind", "suffix"), WRITES)
def test_own_files_are_replaced_and_strangers_are_not(kind: str, suffix: str, tmp_path: Path) -> None:
    target = tmp_path / f"x{suffix}"
    written(kind, target)
    made = sorted(p.name for p in tmp_path.iterdir())
    written(kind, target)  # a script that runs twice
    assert sorted(p.name for p in tmp_path.iterdir()) == made
    for name in made:  # each of the files in turn is somebody else's
        whole = content(tmp_path)
        (tmp_path / name).write_bytes(b"somebody else's work")
        before = content(tmp_path)
        with pytest.raises(WriteError, match=rf"{name} exists.*overwrite=True \(--force\)|x{suffix} exists"):
            written(kind, target)
        assert content(tmp_path) == before
        for file, data in whole.items():
            (tmp_path / file).write_bytes(data)


@pytest.mark.parametrize(("first", "second"), [("op4", "pch"), ("pch", "op4")])
def test_superelement_and_dmig_of_one_stem(first: str, second: str, tmp_path: Path) -> None:
    """The `.pch` beside a `.op4` says which DOF its rows are; DMIG entries in its place would permute them."""
    given = component()
    write_component(given, tmp_path / f"x.{first}")
    before = content(tmp_path)
    with pytest.raises(WriteError, match=r"x\.pch"):
        write_component(given, tmp_path / f"x.{second}")
    assert content(tmp_path) == before
    assert_same(read_component(tmp_path / f"x.{first}"), given)


def assert_same(back: Component, given: Component, tolerance: float = 1e-8) -> None:
    at = [back.dofs.row(*pair) for pair in given.dofs.pairs]
    for kind in ("mass", "stiffness"):
        np.testing.assert_allclose(getattr(back, kind)[np.ix_(at, at)], getattr(given, kind), atol=tolerance)


def test_boundary_that_is_not_ascending_keeps_its_order_in_op4(tmp_path: Path) -> None:
    given = component()
    back = read_component(write_component(given, tmp_path / "x.op4"))
    assert back.dofs.pairs == given.dofs.pairs
    assert np.array_equal(back.stiffness, given.stiffness)
    interleaved = replace(given, boundary=[*PAIRS[1:9], PAIRS[0], *PAIRS[9:]])
    again = read_component(write_component(interleaved, tmp_path / "y.op4"))
    assert again.dofs.pairs == interleaved.dofs.pairs


def test_a_punch_file_of_dmig_says_nothing_about_an_op4(tmp_path: Path) -> None:
    given = component()
    write_component(given, tmp_path / "x.op4")
    write_component(given, tmp_path / "x.pch", overwrite=True)
    with pytest.raises(ReadError, match=r"DMIG.*no EXTRN.*format='nastran_dmig'"):
        read_component(tmp_path / "x.op4")
    assert_same(read_component(tmp_path / "x.pch", format="nastran_dmig"), given)


def test_what_was_read_is_never_replaced(tmp_path: Path) -> None:
    """Neither the file nor the files beside it, whatever was asked for, and by whatever name."""
    op4 = write_component(component(), tmp_path / "bus.op4")
    read = read_component(op4)
    before = content(tmp_path)
    for target in ("bus.op4", "bus.pch"):
        with pytest.raises(WriteError, match="belongs to the source of what is to be written"):
            write_component(read, tmp_path / target, overwrite=True)
    with pytest.raises(WriteError, match="belongs to"):
        convert(op4, tmp_path / "bus.pch", overwrite=True)
    (tmp_path / "link.pch").hardlink_to(tmp_path / "bus.pch")
    with pytest.raises(WriteError, match="belongs to"):
        write_component(read, tmp_path / "link.pch", overwrite=True)
    assert content(tmp_path) == before | {"link.pch": before["bus.pch"]}
    own = write_model(model(), tmp_path / "m.npz")
    with pytest.raises(WriteError, match=r"m\.npz exists, and is not a file that this writes \(flexplant_npz, component\)"):
        write_component(component(), own)
    path = write_plant(plant(), tmp_path / "p.mat")
    with pytest.raises(WriteError, match="belongs to"):
        convert(path, tmp_path / "p.m", overwrite=True)


def test_data_of_a_matlab_script(tmp_path: Path) -> None:
    """The `.mat` beside a script is a plant of ours or free; anybody else's stays, unless it was asked for."""
    scipy.io.savemat(tmp_path / "p.mat", {"measured": np.eye(2)})
    before = content(tmp_path)
    with pytest.raises(WriteError, match=r"p\.mat exists"):
        write_plant(plant(), tmp_path / "p.m")
    assert content(tmp_path) == before
    write_plant(plant(), tmp_path / "p.m", overwrite=True)
    write_plant(plant(2.0), tmp_path / "p.mat")
    write_plant(plant(3.0), tmp_path / "p.m")
    assert np.asarray(read_plant(tmp_path / "p.mat").shape_in) == 3.0


def test_an_op4_that_came_later_is_not_ours(tmp_path: Path) -> None:
    """The `.pch` vouches for the bytes that it was written with, not for whatever has the name."""
    write_component(component(), tmp_path / "x.op4")
    other = write_component(component("other"), tmp_path / "other.op4").read_bytes()
    (tmp_path / "x.op4").write_bytes(other[:-8] + bytes(8))
    with pytest.raises(WriteError, match=r"x\.op4 exists"):
        write_component(component(), tmp_path / "x.op4")


def test_results_replace_results(tmp_path: Path) -> None:
    data = xr.Dataset({"a": ("t", [1.0, 2.0])}, attrs={"title": "mine"})
    path = tmp_path / "r.nc"
    data.to_netcdf(path, engine="h5netcdf")
    with pytest.raises(WriteError, match=r"r\.nc exists"):
        write_results(data, path)
    write_results(data, path, overwrite=True)
    write_results(data, path)
    from flexplant.io import read_results

    assert read_results(path).attrs == {"title": "mine"}


@pytest.mark.parametrize(("first", "second"), [("op4", "mat"), ("mat", "op4")])
def test_a_sidecar_is_not_put_beside_a_superelement(first: str, second: str, tmp_path: Path) -> None:
    """A `.yaml` of the same stem says what plain matrices are, and would be read for the `.op4` too."""
    write_component(component(), tmp_path / f"x.{first}")
    before = content(tmp_path)
    with pytest.raises(WriteError, match="parts of one model"):
        write_component(component(), tmp_path / f"x.{second}")
    assert content(tmp_path) == before
    assert read_component(tmp_path / f"x.{first}").boundary.pairs == component().boundary.pairs


def test_a_path_that_cannot_be_looked_up_is_told_as_such() -> None:
    for path in ("x" * 5000 + ".op4", "x" * 300 + ".mat"):
        with pytest.raises(WriteError, match="cannot write"):
            write_component(component(), path)


READABLE = [s for k, s in WRITES if k == "write_component" and s not in (".m", ".hdf5")]


@pytest.mark.parametrize("first", READABLE)
def test_two_formats_of_one_stem_are_both_read_or_the_second_is_refused(tmp_path: Path, first: str) -> None:
    here = replace(jacket(), nodes=Nodes(ids=[1], positions=[[0.0, 0, 0]]))
    for second in (s for s in READABLE if s != first):
        folder = tmp_path / second[1:]
        folder.mkdir()
        write_component(here, folder / f"bus{first}")
        try:
            write_component(replace(here, stiffness=2 * np.eye(7)), folder / f"bus{second}")
        except WriteError:
            assert {first, second} & {".op4", ".pch"}, "only files that one Nastran run would write together"
        else:
            assert read_component(folder / f"bus{second}").stiffness[6, 6] == 2.0
        assert read_component(folder / f"bus{first}").stiffness[6, 6] == 1.0


def test_a_sidecar_is_only_for_the_file_that_it_names(tmp_path: Path) -> None:
    """Plain matrices beside our `.mat` are not what its sidecar speaks of, unless the reader says so; both can be renamed."""
    write_component(jacket(), tmp_path / "bus.mat")
    np.savez(tmp_path / "bus.npz", mass=np.eye(7), stiffness=3 * np.eye(7))
    with pytest.raises(ReadError, match="not recognised"):
        read_component(tmp_path / "bus.npz")
    with pytest.raises(ReadError, match=r"bus\.yaml says that it is another file's"):
        read_component(tmp_path / "bus.npz", format="npz_matrices")
    assert read_component(tmp_path / "bus.npz", format="npz_matrices", sidecar=tmp_path / "bus.yaml").stiffness[0, 0] == 3.0
    for ending in (".mat", ".yaml"):
        (tmp_path / f"bus{ending}").rename(tmp_path / f"new{ending}")
    assert read_component(tmp_path / "new.mat").name == "jacket"
    (tmp_path / "own.yaml").write_text("boundary: [[1, 1]]\n")  # a sidecar that names no file, beside a file that needs none
    assert read_component(write_component(jacket(), tmp_path / "own.npz")).name == "jacket"
