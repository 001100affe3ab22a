"""Sierra/SD reductions with the names and types that SEACAS's superelement reader takes; positions from the file."""

from __future__ import annotations

from pathlib import Path

import h5netcdf
import numpy as np
import pytest
import scipy.io

from flexplant.errors import InputError, ReadError
from flexplant.io import read_component

RNG = np.random.default_rng(5)
XYZ = RNG.standard_normal((2, 3))


def reduction(
    path: Path, cbmap: list[tuple[int, int]], ids: list[int], modal: int = 2, kind: str = "d"
) -> tuple[Path, np.ndarray]:
    n = len(cbmap) + modal
    half = RNG.standard_normal((n, n))
    matrix = half @ half.T + n * np.eye(n)
    with scipy.io.netcdf_file(path, "w") as file:
        sizes = {"NumDof": n, "NumEig": modal, "NumConstraints": n - modal, "num_nodes": len(ids), "pairs": len(cbmap), "two": 2}
        for name, size in sizes.items():
            file.createDimension(name, size)
        for key in ("Kr", "Mr"):
            file.createVariable(key, "d", ("NumDof", "NumDof"))[:] = matrix
        file.createVariable("cbmap", kind, ("pairs", "two"))[:] = cbmap
        file.createVariable("node_num_map", kind, ("num_nodes",))[:] = ids
        for key, column in zip(("coordx", "coordy", "coordz"), XYZ.T, strict=True):
            file.createVariable(key, "d", ("num_nodes",))[:] = column
    return path, matrix


def pairs(*nodes: int) -> list[tuple[int, int]]:
    return [(n, d) for n in nodes for d in (1, 2, 3)]


@pytest.mark.parametrize("kind", ["d", "i"])
def test_ids_and_places_give_the_same_component(tmp_path: Path, kind: str) -> None:
    for name, cbmap in (("ids.nc4", pairs(47, 19)), ("places.nc4", pairs(1, 2))):
        path, matrix = reduction(tmp_path / name, cbmap, [47, 19], kind=kind)
        read = read_component(path)
        assert read.boundary.pairs == pairs(47, 19)
        np.testing.assert_array_equal(read.nodes.position(19), XYZ[1])
        order = [2, 3, 4, 5, 6, 7, 0, 1]  # modal rows come first where cbmap leaves them out
        np.testing.assert_array_equal(read.stiffness, matrix[np.ix_(order, order)])


def test_numbers_that_could_be_both_are_asked_for(tmp_path: Path) -> None:
    path, _ = reduction(tmp_path / "r.nc4", pairs(1, 2), [2, 1])
    with pytest.raises(ReadError, match="ids or places"):
        read_component(path)
    np.testing.assert_array_equal(read_component(path, numbers="ids").nodes.position(1), XYZ[1])
    assert read_component(path, numbers="places").boundary.pairs == pairs(2, 1)
    same, _ = reduction(tmp_path / "s.nc4", pairs(1, 2), [1, 2])
    assert read_component(same).boundary.pairs == pairs(1, 2)
    with pytest.raises(InputError, match="'ids' or 'places'"):
        read_component(path, numbers="global")


def test_netcdf_4_gives_the_same_component(tmp_path: Path) -> None:
    """The same variables in HDF5, as newer programs write them, with compression and a text beside."""
    path, _ = reduction(tmp_path / "r.nc4", pairs(47, 19), [47, 19])
    with scipy.io.netcdf_file(path, mmap=False) as old, h5netcdf.File(tmp_path / "s.nc4", "w") as new:
        new.dimensions = dict(old.dimensions)
        for name, variable in old.variables.items():
            values = np.array(variable.data, dtype=variable.data.dtype.newbyteorder("="))
            new.create_variable(name, variable.dimensions, values.dtype, data=values, compression="gzip")
        new.attrs["title"] = "a reduction"
    ours, theirs = read_component(tmp_path / "s.nc4"), read_component(path)
    assert ours.source["format"] == "sierra_netcdf"
    assert ours.dofs.pairs == theirs.dofs.pairs
    np.testing.assert_array_equal(ours.stiffness, theirs.stiffness)
    np.testing.assert_array_equal(ours.nodes.positions, theirs.nodes.positions)
    data = bytearray((tmp_path / "s.nc4").read_bytes())
    data[len(data) // 2 :] = b""
    (tmp_path / "t.nc4").write_bytes(bytes(data))
    with pytest.raises(ReadError, match=r"t\.nc4"):
        read_component(tmp_path / "t.nc4")


def test_nodes_that_are_not_there_are_an_error(tmp_path: Path) -> None:
    path, _ = reduction(tmp_path / "r.nc4", pairs(7, 8), [1, 2])
    with pytest.raises(ReadError, match=r"cbmap.*nodes \[7, 8\]"):
        read_component(path)
    path, _ = reduction(tmp_path / "t.nc4", [(1, 1), (2, 1)], [1, 2])
    path.write_bytes(path.read_bytes().replace(np.array([2.0], ">f8").tobytes(), np.array([2.5], ">f8").tobytes()))
    with pytest.raises(ReadError, match=r"cbmap.* 2\.5.*not an integer"):
        read_component(path)
