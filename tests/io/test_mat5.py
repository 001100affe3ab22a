"""MAT-files: equal to scipy's reader and writer; corrupt ones end in ReadError (inside scipy they can end the interpreter)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flexplant.errors import ReadError
from flexplant.io.parse.mat5 import read_mat, read_mat_texts

RNG = np.random.default_rng(8)
SPARSE = sp.csc_matrix(RNG.standard_normal((6, 4)) * (RNG.random((6, 4)) < 0.4))
VARIABLES = {
    "M": RNG.standard_normal((5, 3)),
    "S": SPARSE,
    "whole": np.arange(6, dtype=np.int16).reshape(2, 3),
    "single": np.float32([[0.1, 0.2]]),
    "a_rather_long_variable_name": np.array([[1.0]]),
    "text": "not a matrix",
    "cell": np.array([[1, "a"]], dtype=object),
    "structure": {"inside": 1.0},
}


@pytest.mark.parametrize("packed", [True, False])
def test_equal_to_what_scipy_wrote(tmp_path: Path, packed: bool) -> None:
    path = tmp_path / "v.mat"
    scipy.io.savemat(path, VARIABLES, do_compression=packed)
    ours = read_mat(path)
    assert set(ours) == {"M", "S", "whole", "single", "a_rather_long_variable_name"}
    for name in ("M", "whole", "single", "a_rather_long_variable_name"):
        assert np.array_equal(ours[name], VARIABLES[name])
    assert np.array_equal(ours["S"].toarray(), SPARSE.toarray())


@pytest.mark.parametrize("folder", [Path(scipy.io.__file__).parent / "matlab" / "tests" / "data"])
def test_equal_to_scipy_on_matlabs_own_files(folder: Path) -> None:
    """Files that MATLAB 5 to 7.4 wrote on several machines (both byte orders), where scipy's tests are installed."""
    files = sorted(folder.glob("test*double_[567]*.mat")) + sorted(folder.glob("testsparse_[567]*.mat"))
    if not files:
        pytest.skip("scipy is installed without its test data")
    for path in files:
        theirs = scipy.io.loadmat(path)
        for name, matrix in read_mat(path).items():
            ours, other = (m.toarray() if sp.issparse(m) else m for m in (matrix, theirs[name]))
            assert np.array_equal(ours, other), path.name


def test_matlabs_own_texts() -> None:
    """Char arrays and cells of MATLAB's own files, both byte orders, as scipy reads them."""
    folder = Path(scipy.io.__file__).parent / "matlab" / "tests" / "data"
    files = sorted(folder.glob("teststring*_[567]*.mat")) + sorted(folder.glob("testunicode_[567]*.mat"))
    if not files:
        pytest.skip("scipy is installed without its test data")
    for path in files:
        theirs = scipy.io.loadmat(path, chars_as_strings=True)
        for name, rows in read_mat_texts(path).items():
            assert rows == [str(row).rstrip() for row in np.ravel(theirs[name])], path.name


def test_what_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "v.mat"
    scipy.io.savemat(path, {"z": np.array([[1j]])})
    with pytest.raises(ReadError, match=r"record z.*is complex"):
        read_mat(path)
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(600))
    with pytest.raises(ReadError, match=r"version 7\.3"):
        read_mat(path)
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(600))
    with pytest.raises(ReadError, match="not a version 5"):
        read_mat(path)
    scipy.io.savemat(path, {"zeros": np.zeros((1000, 1000))}, do_compression=True)
    assert read_mat(path)["zeros"].shape == (1000, 1000)
    with pytest.raises(ReadError, match=r"unpacks to more than 1e\+06 bytes"):
        read_mat(path, max_bytes=1e6)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.booleans(),
    st.lists(st.tuples(st.integers(126, 1500), st.integers(0, 255)), min_size=1, max_size=6),
    st.integers(100, 3000),
)
def test_mutated_files(tmp_path: Path, packed: bool, changes: list[tuple[int, int]], keep: int) -> None:
    path = tmp_path / "v.mat"
    scipy.io.savemat(path, {"names": np.array([["left"], ["up"]], dtype=object), **VARIABLES}, do_compression=packed)
    data = bytearray(path.read_bytes())
    for at, value in changes:
        data[at % len(data)] = value
    path.write_bytes(bytes(data[:keep]))
    for read in (read_mat, read_mat_texts):
        try:
            read(path)
        except ReadError as error:
            assert str(path) in str(error)  # noqa: PT017
