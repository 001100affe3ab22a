"""The project's own files: what was written comes back bit-equal; hostile archives end in ReadError before they are unpacked."""

from __future__ import annotations

import io
import json
import struct
import time
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexplant.errors import InputError, ReadError
from flexplant.io import read_component, read_model, write_component, write_model
from flexplant.io.parse.npz import read_npz
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes
from flexplant.model.recovery import Recovery

ENDINGS = (".npz", ".h5")
FUZZ = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def symmetric(rng: np.random.Generator, n: int) -> np.ndarray:
    half = rng.standard_normal((n, n))
    return half + half.T


def a_component(seed: int = 1, *, sparse: bool = False, bare: bool = False) -> Component:
    rng = np.random.default_rng(seed)
    matrices = [sp.csr_array(m * (abs(m) > 0.8)) if sparse else m for m in (symmetric(rng, 9) for _ in range(3))]
    frames = Rotation.random(3, random_state=seed).as_matrix()
    nodes = None if bare else Nodes(ids=[7, 5, 2000000001], positions=rng.standard_normal((3, 3)), frames=frames)
    rows = Recovery(
        name="eye", labels=["a.1", "ü 2"], displacement=rng.random((2, 9)), acceleration=sp.csr_array(np.eye(2, 9)), units="µm"
    )
    return Component(
        name="part",
        mass=matrices[0],
        stiffness=matrices[1],
        damping=None if bare else matrices[2],
        boundary=[(7, "123"), (5, 2)],
        modal_ids=[11, 13, 12, 99, 98],
        nodes=nodes,
        recovery={} if bare else {"eye": rows},
        source={} if bare else {"path": "x", "n": 3, "list": [1, 2.5], "deep": {"q": None}, "array": np.arange(3)},
        units="SI" if seed % 2 else "mm-kg-s",
    )


def same(a, b) -> bool:
    """Bit-equal, and of the same kind (dense or sparse, or None)."""
    if a is None or b is None:
        return a is b
    if sp.issparse(a) != sp.issparse(b):
        return False
    if sp.issparse(a):
        return all(np.array_equal(getattr(a, p), getattr(b, p)) for p in ("data", "indices", "indptr")) and a.shape == b.shape
    return np.asarray(a).tobytes() == np.asarray(b).tobytes() and a.dtype == b.dtype


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("kind", [{}, {"sparse": True}, {"bare": True}, {"seed": 2}])
def test_component_comes_back_bit_equal(tmp_path: Path, ending: str, kind: dict[str, object]) -> None:
    before = a_component(**kind)
    after = read_component(write_component(before, tmp_path / f"file{ending}"))
    for name in ("mass", "stiffness", "damping"):
        assert same(getattr(after, name), getattr(before, name))
    assert after.boundary.pairs == before.boundary.pairs
    assert same(after.modal_ids, before.modal_ids)
    assert (after.name, after.units) == (before.name, before.units)
    assert set(after.recovery) == set(before.recovery)
    for name, rows in before.recovery.items():
        assert (after.recovery[name].labels, after.recovery[name].units) == (rows.labels, rows.units)
        assert all(same(getattr(after.recovery[name], k), getattr(rows, k)) for k in ("displacement", "velocity", "acceleration"))
    if before.nodes is None:
        assert after.nodes is None
    else:
        assert all(same(getattr(after.nodes, k), getattr(before.nodes, k)) for k in ("ids", "positions", "frames"))


@pytest.mark.parametrize("seed", range(1, 200, 2))
def test_frames_are_not_turned_again_by_reading(tmp_path: Path, seed: int) -> None:
    before = a_component(seed)
    assert same(read_component(write_component(before, tmp_path / "f.npz")).nodes.frames, before.nodes.frames)


@pytest.mark.parametrize("ending", ENDINGS)
def test_source_is_kept_as_origin(tmp_path: Path, ending: str) -> None:
    before = a_component()
    source = read_component(write_component(before, tmp_path / f"file{ending}")).source
    assert source["path"] == str(tmp_path / f"file{ending}")
    assert len(source["sha256"]) == 64
    assert source["origin"] == {"path": "x", "n": 3, "list": [1, 2.5], "deep": {"q": None}, "array": [0, 1, 2]}


@pytest.mark.parametrize("ending", ENDINGS)
def test_model_comes_back_bit_equal(tmp_path: Path, ending: str) -> None:
    part = a_component(sparse=True)
    before = FiniteElementModel(
        name="fem", mass=part.mass, stiffness=part.stiffness, dofs=DofSet.of([(i, 1) for i in range(9)]), source={"a": 1}
    )
    after = read_model(write_model(before, tmp_path / f"file{ending}"))
    assert same(after.mass, before.mass)
    assert same(after.stiffness, before.stiffness)
    assert after.dofs.pairs == before.dofs.pairs
    with pytest.raises(ReadError, match="holds a model, not a component"):
        read_component(tmp_path / f"file{ending}")


@pytest.mark.parametrize("ending", ENDINGS)
def test_every_prefix_of_a_file_is_refused(tmp_path: Path, ending: str) -> None:
    path = write_component(a_component(), tmp_path / f"file{ending}")
    data = path.read_bytes()
    format_name = {".npz": "flexplant_npz", ".h5": "flexplant_h5"}[ending]
    for keep in np.linspace(0, len(data) - 30, 25).astype(int):
        path.write_bytes(data[:keep])
        with pytest.raises(ReadError):
            read_component(path, format=format_name)


@pytest.mark.parametrize("ending", ENDINGS)
def test_mutated_files_end_in_read_error_or_a_component(tmp_path: Path, ending: str) -> None:
    path = write_component(a_component(), tmp_path / f"file{ending}")
    original = path.read_bytes()
    format_name = {".npz": "flexplant_npz", ".h5": "flexplant_h5"}[ending]

    @FUZZ
    @given(st.lists(st.tuples(st.integers(0, len(original) - 1), st.integers(0, 255)), min_size=1, max_size=6))
    def mutate(changes: list[tuple[int, int]]) -> None:
        data = bytearray(original)
        for at, value in changes:
            data[at] = value
        path.write_bytes(bytes(data))
        try:
            read_component(path, format=format_name)
        except ReadError as error:
            assert str(path) in str(error)  # noqa: PT017

    mutate()


def npy(shape: tuple[int, ...], descr: str = "<f8", body: bytes = b"") -> bytes:
    header = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape!r}, }}".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + body


def archive(path: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(name, data)
    return path


def pickled() -> bytes:
    stream = io.BytesIO()
    np.save(stream, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    return stream.getvalue()


HOSTILE = {
    "10^12 rows": ({"m.npy": npy((10**12, 3))}, r"claims shape \(1000000000000, 3\)"),
    "overflow": ({"m.npy": npy((2**40, 2**40))}, "claims shape"),
    "negative": ({"m.npy": npy((-1, 8), body=b"")}, "claims shape|is corrupt"),
    "short": ({"m.npy": npy((3, 3), body=bytes(64))}, "72 bytes, but has 64"),
    "pickle": ({"m.npy": pickled()}, "pickled Python objects"),
    "no array": ({"m.txt": b"hello"}, "not an array"),
    "bad magic": ({"m.npy": b"\x93NUMPX" + bytes(100)}, "is corrupt"),
    "bad header": ({"m.npy": npy((3,)).replace(b"'descr'", b"'descx'")}, "is corrupt"),
    "code in header": ({"m.npy": npy((3,), "__import__('os')")}, "is corrupt"),
    "deep header": ({"m.npy": npy((), "[" * 3000)}, "is corrupt"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_archives(tmp_path: Path, case: str) -> None:
    members, message = HOSTILE[case]
    path = archive(tmp_path / "hostile.npz", members)
    tracemalloc.start()
    begin = time.perf_counter()
    with pytest.raises(ReadError, match=message) as caught:
        read_npz(path)
    assert time.perf_counter() - begin < 0.5
    assert tracemalloc.get_traced_memory()[1] < 5 * 10**6
    tracemalloc.stop()
    assert caught.value.record in ("m", "m.txt")


def test_a_zip_bomb_is_not_unpacked(tmp_path: Path) -> None:
    """512 MB of zeros in half a megabyte: more than 500 times the file."""
    stream = npy((1 << 26,))
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file, file.open("m.npy", "w", force_zip64=True) as member:
        member.write(stream)
        for _ in range(64):
            member.write(bytes(1 << 23))
    begin = time.perf_counter()
    with pytest.raises(ReadError, match="times the file's size, more than max_ratio"):
        read_npz(path)
    with pytest.raises(ReadError, match="more than max_bytes = 1e\\+06"):
        read_npz(path, max_bytes=1e6)
    assert time.perf_counter() - begin < 0.1


def test_a_later_version_is_told(tmp_path: Path) -> None:
    path = write_component(a_component(), tmp_path / "c.npz")
    arrays = dict(np.load(path))
    header = json.loads(str(arrays["flexplant"]))
    arrays["flexplant"] = json.dumps(header | {"version": 99})
    np.savez(path, **arrays)
    with pytest.raises(ReadError, match="version 99; this flexplant reads up to 2"):
        read_component(path)
    del arrays["stiffness"]
    arrays["flexplant"] = json.dumps(header)
    np.savez(path, **arrays)
    with pytest.raises(ReadError, match="stiffness"):
        read_component(path)


def test_h5_that_claims_more_than_it_stores_or_points_elsewhere(tmp_path: Path) -> None:
    import h5py

    path = write_component(a_component(), tmp_path / "c.h5")
    with h5py.File(path, "a") as file:
        del file["mass"]
        file.create_dataset("mass", shape=(10**6, 10**6), dtype="f8", chunks=(100, 100))
    with pytest.raises(ReadError, match="claims shape") as caught:
        read_component(path)
    assert caught.value.record == "mass"
    other = write_component(a_component(), tmp_path / "other.h5")
    with h5py.File(path, "a") as file:
        del file["mass"]
        file["mass"] = h5py.ExternalLink(other.name, "/mass")
    with pytest.raises(ReadError, match="not a data set of this file"):
        read_component(path)


def test_endings_choose_the_format(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"has none of the endings .*\.h5, \.hdf5, \.npz"):
        write_component(a_component(), tmp_path / "c.txt")
