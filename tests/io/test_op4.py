"""OUTPUT4: equal to pyYeti's independent reader on real files of every layout; hostile files end quickly in ReadError."""

from __future__ import annotations

import struct
import time
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nx_files import OP4_FILES, TRUSS

from flexplant.errors import ReadError
from flexplant.io.parse.op4 import looks_like_op4, read_op4

QUICK = settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(scope="module")
def peer():
    """pyYeti's op4 module; its import changes numpy's print options, which are put back."""
    with np.printoptions(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from pyyeti.nastran import op4

        yield op4


def peer_matrices(peer, path: Path) -> dict[str, object]:
    sparse = True if "large_dim" in path.name else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return {k.upper(): v for k, v in peer.OP4().dctload(str(path), justmatrix=True, sparse=sparse).items()}


def largest_difference(a, b) -> float:
    if sp.issparse(a) or sp.issparse(b):
        difference = sp.coo_array(a).tocsr() - sp.coo_array(b).tocsr()
        return abs(difference).max() if difference.nnz else 0.0
    return abs(a - b).max()


@pytest.mark.parametrize("path", OP4_FILES, ids=lambda p: f"{p.parent.name}-{p.name}")
def test_equal_to_an_independent_reader(path: Path, peer) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        names = peer.OP4().dir(str(path), verbose=False)[0]
    if len(set(names)) < len(names):  # databases of several superelements
        with pytest.raises(ReadError, match="stored twice"):
            read_op4(path)
        return
    ours, theirs = read_op4(path), peer_matrices(peer, path)
    assert set(ours) == set(theirs)
    for name, matrix in ours.items():
        assert matrix.shape == theirs[name].shape
        assert largest_difference(matrix, theirs[name]) == 0.0


@pytest.mark.parametrize("binary", [True, False], ids=["binary", "ascii"])
@pytest.mark.parametrize("layout", ["dense", "bigmat", "nonbigmat"])
@pytest.mark.parametrize("endian", ["<", ">"])
def test_what_an_independent_writer_writes(tmp_path, peer, binary, layout, endian) -> None:
    rng = np.random.default_rng(3)
    real = rng.standard_normal((7, 5)) * (rng.random((7, 5)) < 0.5)
    matrices = {"real": real, "cplx": real + 1j * rng.standard_normal((7, 5)), "null": np.zeros((3, 2)), "one": np.ones((1, 1))}
    path = tmp_path / "m.op4"
    peer.write(str(path), matrices, binary=binary, sparse=layout, endian=endian, digits=16)
    ours = read_op4(path)
    for name, matrix in matrices.items():
        expected = pytest.approx(matrix, rel=1e-15, abs=0) if not binary else matrix
        assert np.array_equal(ours[name.upper()], matrix) if binary else ours[name.upper()] == expected


def measured(path: Path) -> tuple[ReadError, float, int]:
    """The ReadError of a file, the seconds until it came, and the peak of memory allocated."""
    tracemalloc.start()
    begin = time.perf_counter()
    with pytest.raises(ReadError) as caught:
        read_op4(path)
    seconds, peak = time.perf_counter() - begin, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return caught.value, seconds, peak


def record(body: bytes, order: str = "<") -> bytes:
    mark = struct.pack(order + "i", len(body))
    return mark + body + mark


def header64(columns: int, rows: int) -> bytes:
    return record(struct.pack("<4q", columns, rows, 2, 2) + b"KXX".ljust(16))


HUGE = {
    "rows64": header64(3, 10**12) + record(struct.pack("<3qd", 1, 1, 1, 1.0)),
    "columns64": header64(10**12, 3) + record(struct.pack("<3qd", 1, 1, 1, 1.0)),
    "rows32": record(struct.pack("<4i", 2, 2**31 - 1, 2, 2) + b"KXX     "),
    "words": record(struct.pack("<4i", 2, 2, 2, 2) + b"KXX     ") + record(struct.pack("<3id", 1, 1, 2**31 - 1, 1.0)),
    "record": record(struct.pack("<4i", 2, 2, 2, 2) + b"KXX     ") + struct.pack("<4id", 2**31 - 1, 1, 1, 2, 1.0),
    "rows beyond": record(struct.pack("<4i", 2, 2, 2, 2) + b"KXX     ") + record(struct.pack("<3i2d", 1, 2, 4, 1.0, 2.0)),
    "negative": record(struct.pack("<4i", 2, 2, 2, 2) + b"KXX     ") + struct.pack("<4i", -8, 1, 1, 2),
    "ascii": b"%16d%16d       2       2KXX     1P,3E23.16|I16\n" % (3, 10**12),
    "ascii numbers": b"       2       2       2       2KXX     1P,3E23.16\n       1       1 9999999\n 1.0\n",
    "ascii width": b"       2       2       2       2KXX     1P,3E999.16\n       1       1       2\n 1.0\n",
}


@pytest.mark.parametrize("case", HUGE)
def test_impossible_sizes_end_in_milliseconds(tmp_path, case) -> None:
    path = tmp_path / "hostile.op4"
    path.write_bytes(HUGE[case])
    error, seconds, peak = measured(path)
    assert str(path) in str(error)
    assert error.record is not None
    assert error.offset is not None
    assert seconds < 0.1
    assert peak < 10**6


def test_a_null_matrix_of_many_rows_stays_sparse(tmp_path) -> None:
    """10^8 rows are possible; they take no memory as long as nothing is in them."""
    body = struct.pack("<4i", 10**8, 10**8, 2, 2) + b"NULL    "
    path = tmp_path / "null.op4"
    path.write_bytes(record(body) + record(struct.pack("<3id", 10**8 + 1, 1, 2, 1.0)))
    matrix = read_op4(path)["NULL"]
    assert sp.issparse(matrix)
    assert matrix.nnz == 0
    assert matrix.shape == (10**8, 10**8)


@pytest.mark.parametrize("keep", [0, 3, 4, 20, 31, 40, 100, 1000, 20000, -1, -5])
def test_truncated(tmp_path, keep) -> None:
    path = tmp_path / "short.op4"
    path.write_bytes((TRUSS / "inboard.op4").read_bytes()[:keep])
    error, seconds, _ = measured(path)
    assert "short.op4" in str(error)
    assert seconds < 0.5


@pytest.mark.parametrize("name", ["binary", "ascii"])
def test_twice_the_same_name(tmp_path, peer, name) -> None:
    path = tmp_path / "twice.op4"
    peer.write(str(path), ["kxx", "kxx"], [np.eye(2), np.eye(2)], binary=name == "binary")
    with pytest.raises(ReadError, match="KXX is stored twice"):
        read_op4(path)


SOURCES = [
    (TRUSS / "inboard.op4").read_bytes()[:4000],
    *(
        (p.read_bytes()[:3000])
        for p in OP4_FILES
        if p.name in ("double_bigmat_be.op4", "cd.op4", "single_nonbigmat_ascii.op4", "csbin.op4")
    ),
]


@QUICK
@given(
    st.sampled_from(SOURCES),
    st.lists(st.tuples(st.integers(0, 3999), st.integers(0, 255)), min_size=1, max_size=8),
    st.integers(1, 4000),
)
def test_mutated_files_end_in_read_error_or_a_matrix(tmp_path, source, changes, keep) -> None:
    data = bytearray(source)
    for at, value in changes:
        data[at % len(data)] = value
    path = tmp_path / "mutated.op4"
    path.write_bytes(bytes(data[: max(1, keep)]))
    try:
        matrices = read_op4(path)
    except ReadError as error:
        assert str(path) in str(error)  # noqa: PT017
    else:
        assert all(not sp.issparse(m) or m.nnz <= len(data) for m in matrices.values())


@QUICK
@given(st.binary(min_size=1, max_size=400))
def test_noise_is_no_op4(tmp_path, data) -> None:
    looks_like_op4(data)
    path = tmp_path / "noise.op4"
    path.write_bytes(data)
    with pytest.raises(ReadError):
        read_op4(path)
