"""Ansys' binary .full: a layout of our own against the numbers it was made of, and a real file against Ansys' own reader."""

from __future__ import annotations

import struct
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from ansys_files import bits, framed, record, windows, write_full
from test_matrix_formats import IDS, NODES, PAIRS, model

from flexplant.errors import ReadError
from flexplant.io import inspect, read_component, read_model
from flexplant.io.parse.ansys_binary import AnsysFile
from flexplant.io.parse.files import read_head

PERMUTED = [20, 4, 19, 7]  # nodes in the order of the equations


def given(damped: bool = False) -> dict[str, np.ndarray]:
    m = model()
    return {"stiffness": m.stiffness, "mass": m.mass} | ({"damping": 0.1 * np.eye(12) + 0.01 * m.stiffness} if damped else {})


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("packed", [False, True])
def test_matrices_and_dof_come_back_bit_by_bit(tmp_path: Path, order: str, packed: bool) -> None:
    matrices = given(damped=True)
    path = write_full(tmp_path / "job.full", matrices, PERMUTED, [1, 2, 3], order=order, packed=packed)
    read = read_model(path)
    at = read.dofs.rows([(n, d) for n in PERMUTED for d in (1, 2, 3)])
    for kind, matrix in matrices.items():
        np.testing.assert_array_equal(getattr(read, kind).toarray()[np.ix_(at, at)], matrix)
    assert (read.source["format"], read.source["unused"], len(read.source["sha256"])) == ("ansys_full", [], 64)


def test_fixed_dof_are_left_out_and_named(tmp_path: Path) -> None:
    matrices = given()
    path = write_full(tmp_path / "job.full", matrices, IDS, [1, 2, 3], fixed=[0, 1, 2, 7])
    (tmp_path / "n.txt").write_text("".join(f"{n} {' '.join(map(repr, NODES.position(n).tolist()))}\n" for n in IDS))
    read = read_model(path, coordinates=tmp_path / "n.txt")
    keep = [k for k in range(12) if k not in (0, 1, 2, 7)]
    at = read.dofs.rows([PAIRS[k] for k in keep])
    np.testing.assert_array_equal(read.stiffness.toarray()[np.ix_(at, at)], matrices["stiffness"][np.ix_(keep, keep)])
    np.testing.assert_array_equal(read.mass.toarray()[np.ix_(at, at)], matrices["mass"][np.ix_(keep, keep)])
    assert read.source["unused"] == ["4 DOF fixed in the run, at nodes 4, 19"]
    np.testing.assert_array_equal(read.nodes.position(19), NODES.position(19))
    assert ("left out", "4 DOF fixed in the run, at nodes 4, 19") in inspect(path).rows


LISTING = """ LIST ALL SELECTED NODES.   DSYS=      0

    NODE        X             Y             Z           THXY     THYZ     THZX
        4   1.0000        0.0000        0.0000          0.00     0.00     0.00
        7   0.0000        2.0000        0.0000         90.00     0.00     0.00

    NODE        X             Y             Z           THXY     THYZ     THZX
       19   0.0000        0.0000       -0.10342E-01     0.00    90.00     0.00
       20   0.0000        0.0000        3.0000         90.00    90.00     0.00
"""


def test_positions_and_axes_of_a_listing_of_nodes(tmp_path: Path) -> None:
    """NLIST as Ansys prints it: x toward y about z first, then y toward z about the new x (rows are the axes)."""
    (tmp_path / "nodes.lis").write_text(LISTING)
    path = write_full(tmp_path / "job.full", given(), IDS, [1, 2, 3])
    read = read_model(path, coordinates=tmp_path / "nodes.lis")
    np.testing.assert_array_equal(read.nodes.position(19), [0, 0, -0.010342])
    x, y, z = np.eye(3)
    for node, axes in ((4, [x, y, z]), (7, [y, -x, z]), (19, [x, z, -y]), (20, [y, z, x])):
        np.testing.assert_allclose(read.nodes.frame(node), axes, atol=1e-15)


@pytest.mark.parametrize(("model_dof", "numbers", "directions"), [([1, 2, 6], None, [1, 2, 6]), ([1, 2, 6], [1, 2, 3], [1, 2, 6]),
                                                                  ([4, 5, 6], None, [4, 5, 6])])  # fmt: skip
def test_dof_are_known_by_number_or_by_place(
    tmp_path: Path, model_dof: list[int], numbers: list[int] | None, directions: list[int]
) -> None:
    read = read_model(write_full(tmp_path / "job.full", given(), IDS, model_dof, numbers=numbers))
    assert sorted(read.dofs.pairs) == [(n, d) for n in IDS for d in directions]


def test_a_lumped_mass_is_its_diagonal(tmp_path: Path) -> None:
    matrices = given()
    read = read_model(write_full(tmp_path / "job.full", matrices, IDS, [1, 2, 3], lumped=True))
    np.testing.assert_array_equal(read.mass.toarray(), matrices["mass"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"extra": {14: 1}}, r"record header, byte 412.*unsymmetric"),
        ({"extra": {21: 3}}, r"constraint equations.*\*SMAT and \*EXPORT"),
        ({"extra": {63: 1}}, "distributed solution"),
        ({"extra": {1: 4}}, "frontal assembly"),
        ({"extra": {15: 4}}, "extraction method 4"),
        ({"extra": {2: 100_000_000}}, "announces 100000000 equations, but"),
        ({"extra": {9: 5}}, r"stiffness matrix, row \d+, byte \d+: has \d+ (numbers|words)"),
        ({"extra": {9: 99}}, r"stiffness matrix, byte \d+: holds \d+ terms; the header announces 99"),
        ({"extra": {9: 2**30}}, "would hold 1073741824 terms"),
        ({"extra": {27: 0}}, "holds no mass matrix; a modal analysis"),
        ({"extra": {7: 3}}, "nodes, byte .*has 4 numbers; at most 3"),
        ({"extra": {36: 10**6}}, r"numbers of DOF, byte 4000000: would begin at word"),
        ({"numbers": [1, 2, 9]}, "names DOF 1 to 9; the model has"),
        ({"scale": 2.0}, "scales the equations"),
    ],
)
def test_what_is_not_read_is_refused_by_record_and_byte(tmp_path: Path, change: dict[str, object], message: str) -> None:
    path = write_full(tmp_path / "job.full", given(), IDS, [1, 2, 3], **change)
    with pytest.raises(ReadError, match=message):
        read_model(path)


def test_temperatures_and_ambiguous_dof_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ReadError, match="DOF 20, which is no displacement"):
        read_model(write_full(tmp_path / "hot.full", given(), IDS, [1, 2, 20]))
    with pytest.raises(ReadError, match="numbers or places"):
        read_model(write_full(tmp_path / "odd.full", given(), IDS, [3, 1, 2]))


def test_a_column_left_of_the_diagonal_is_refused(tmp_path: Path) -> None:
    path = write_full(tmp_path / "job.full", given(), IDS, [1, 2, 3])
    data = bytearray(path.read_bytes())
    at = struct.unpack_from("<100i", data, 4 * 105)[26] * 4  # the first row of the mass: one column
    struct.pack_into("<i", data, at + 8, 13)
    path.write_bytes(data)
    with pytest.raises(ReadError, match=r"mass matrix, row 1.*has column 13; 1 to 12"):
        read_model(path)
    struct.pack_into("<i", data, at + 16, 3)
    path.write_bytes(data)
    with pytest.raises(ReadError, match=r"mass matrix, row 1, byte \d+: has 3 words|begins with length 3 and ends"):
        read_model(path)


def packed_records() -> dict[str, tuple[bytes, list[float]]]:
    """A mask of bits, or pieces: alone, in a row, or one number many times; and the numbers they stand for."""
    pieces = [(0, np.array([7.0]), 3), (4, np.array([2.5]), 1), (6, np.array([1.0, -1.0]), 2)]
    return {
        "bits": (bits(np.array([0.0, 1.5, 0.0, -2.0])), [0.0, 1.5, 0.0, -2.0]),
        "integers": (bits(np.array([0, 3, 0, 0, 9])), [0, 3, 0, 0, 9]),
        "windows": (windows(9, pieces), [7, 7, 7, 0, 2.5, 0, 1, -1, 0]),
        "places": (windows(5, [(2, np.array([4]), 1), (3, np.array([5, 6]), 2)]), [0, 0, 4, 5, 6]),
    }


def test_packed_records_come_apart(tmp_path: Path) -> None:
    """As Ansys packs since release 19."""
    head = record(np.zeros(100, dtype=int))
    for name, (body, expected) in packed_records().items():
        (tmp_path / name).write_bytes(head + body)
        found, after = AnsysFile.of(tmp_path / name, read_head(tmp_path / name)).record(103, "r", 100)
        np.testing.assert_array_equal(found, expected)
        assert 4 * after == len(head + body)


@pytest.mark.parametrize(
    "body",
    [
        framed(struct.pack("<2i", 2**30, 1) + struct.pack("<2id", 0, -(2**30), 1.0), "<", 1 << 28),
        framed(struct.pack("<2i", 8, 1) + struct.pack("<2id", -5, 4, 1.0), "<", 1 << 28),
        framed(struct.pack("<2i", 8, 2**30) + struct.pack("<id", 5, 1.0), "<", 1 << 28),
        framed(struct.pack("<2i", 40, -1), "<", 1 << 27),
        framed(struct.pack("<2i", 4, 15) + struct.pack("<d", 1.0), "<", 1 << 27),
        framed(struct.pack("<2i", 1, 1), "<", 1 << 29),
    ],
)
def test_packed_records_take_no_more_than_the_file(tmp_path: Path, body: bytes) -> None:
    (tmp_path / "p").write_bytes(record(np.zeros(100, dtype=int)) + body)
    file = AnsysFile.of(tmp_path / "p", read_head(tmp_path / "p"))
    tracemalloc.start()
    with pytest.raises(ReadError, match="record r, byte 412"):
        file.record(103, "r", 2**31)
    assert tracemalloc.get_traced_memory()[1] < 1e5
    tracemalloc.stop()


def test_it_is_a_model_and_no_component(tmp_path: Path) -> None:
    path = write_full(tmp_path / "job.full", given(), IDS, [1, 2, 3])
    with pytest.raises(ReadError, match=r"it is ansys_full, which read_component cannot use"):
        read_component(path)


def test_a_real_file_is_what_ansys_reads(tmp_path: Path) -> None:
    """The file of ansys-mapdl-reader (MIT), written by ANSYS 15: a clamped block of solids, read by both, bit by bit."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        reader = pytest.importorskip("ansys.mapdl.reader", reason="pip install ansys-mapdl-reader for a real .full file")
        dof, stiffness, mass = reader.read_binary(reader.examples.fullfile).load_km()
    read = read_model(reader.examples.fullfile)
    assert len(read.dofs) == 900
    assert read.source["unused"][0].startswith("63 DOF fixed")
    keep = [k for k, (node, place) in enumerate(dof.tolist()) if (node, place + 1) in read.dofs]
    at = read.dofs.rows([(int(dof[k][0]), int(dof[k][1]) + 1) for k in keep])
    for ours, theirs in ((read.stiffness, stiffness), (read.mass, mass)):
        whole = theirs + theirs.T - sp.diags_array(theirs.diagonal())
        np.testing.assert_array_equal(ours.toarray()[np.ix_(at, at)], whole.toarray()[np.ix_(keep, keep)])


def test_ansys_reads_what_our_test_files_hold(tmp_path: Path) -> None:
    """The layout of these tests' own writer, and its packed records, through Ansys' reader."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        reader = pytest.importorskip("ansys.mapdl.reader", reason="pip install ansys-mapdl-reader")
        matrices = given()
        path = write_full(tmp_path / "job.full", matrices, PERMUTED, [1, 2, 3])
        dof, stiffness, mass = reader.read_binary(str(path)).load_km()
    assert [(int(n), int(d) + 1) for n, d in dof] == [(n, d) for n in PERMUTED for d in (1, 2, 3)]
    np.testing.assert_array_equal(stiffness.toarray(), np.triu(matrices["stiffness"]))
    np.testing.assert_array_equal(mass.toarray(), np.triu(matrices["mass"]))
    for body, expected in packed_records().values():
        (tmp_path / "packed").write_bytes(record(np.zeros(100, dtype=int)) + body)
        np.testing.assert_array_equal(reader._binary_reader.c_read_record(str(tmp_path / "packed"), 103), expected)
