"""Writing is all or nothing; plants and results come back."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
import xarray as xr

from flexplant.errors import InputError, ReadError, WriteError
from flexplant.io import read_plant, read_results, write_plant, write_results
from flexplant.io.write.atomic import replacing
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace, state_space

RNG = np.random.default_rng(5)
MODAL = ModalPlant(
    omega=[0.0, 10.0, 1 / 3],
    zeta=[0.0, 0.01, 0.02],
    shape_in=RNG.standard_normal((3, 2)),
    shape_out=RNG.standard_normal((1, 3)),
    shape_out_acceleration=RNG.standard_normal((1, 3)),
    static_correction=RNG.standard_normal((1, 2)),
    inputs=["bus.1.1", "bus.1.2"],
    outputs=["optic.9.4:a"],
    input_units=["N", "N"],
    output_units=["rad/s²"],
    name="plate",
    report={"dropped": [1, 2]},
)
DISCRETE = StateSpace(np.eye(2) / 3, np.ones((2, 1)), np.ones((1, 2)), np.zeros((1, 1)), ["u"], ["y"], dt=0.001)
SINGULAR = Descriptor(
    sp.diags_array([1.0, 0.0]), np.eye(2), np.ones((2, 1)), sp.csr_array(np.ones((1, 2))), np.zeros((1, 1)), ["u"], ["y"]
)


class StopError(Exception):
    """Something that goes wrong while writing."""


def listed(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


@pytest.mark.parametrize("error", [KeyboardInterrupt, StopError, SystemExit])
def test_an_interrupted_write_leaves_what_was_there(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "out.npz"
    path.write_text("before")

    def write_half() -> None:
        with replacing(path) as work:
            assert work.suffix == ".npz"
            work.write_text("half")
            raise error

    with pytest.raises(error):
        write_half()
    assert listed(tmp_path) == ["out.npz"]
    assert path.read_text() == "before"


def test_a_finished_write_replaces(tmp_path: Path) -> None:
    path = tmp_path / "out.txt"
    path.write_text("before")
    with replacing(path) as work:
        work.write_text("after")
        assert path.read_text() == "before"
    assert path.read_text() == "after"
    assert listed(tmp_path) == ["out.txt"]


def test_ctrl_c_inside_a_writer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*args: object, **kwargs: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_plant(MODAL, tmp_path / "p.npz")
    assert listed(tmp_path) == []


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(WriteError, match=r"there is no folder .*nowhere"):
        write_plant(MODAL, tmp_path / "nowhere" / "p.npz")
    (tmp_path / "taken.npz").mkdir()
    with pytest.raises(WriteError, match="this is a folder"):
        write_plant(MODAL, tmp_path / "taken.npz")
    with pytest.raises(WriteError, match="/proc/self"):
        write_plant(MODAL, Path("/proc/self/p.npz"))
    with pytest.raises(InputError, match=r"none of the endings"):
        write_plant(MODAL, tmp_path / "p.xlsx")
    with pytest.raises(InputError, match="not dict"):
        write_plant({}, tmp_path / "p.npz")  # type: ignore[arg-type]


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_without_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(WriteError, match="Permission denied"):
        write_plant(MODAL, tmp_path / "p.npz")
    tmp_path.chmod(0o700)


def fields(plant: object) -> dict[str, object]:
    return {k: v for k, v in vars(plant).items() if not k.startswith("_") and k != "source"}  # which names the file itself


def equal(a: object, b: object) -> bool:
    if sp.issparse(a):
        return sp.issparse(b) and (a != b).nnz == 0
    return np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b


@pytest.mark.parametrize("ending", [".npz", ".h5"])
@pytest.mark.parametrize("plant", [MODAL, DISCRETE, SINGULAR], ids=["modal", "discrete", "descriptor"])
def test_plants_come_back_equal(tmp_path: Path, plant: object, ending: str) -> None:
    after = read_plant(write_plant(plant, tmp_path / f"p{ending}"))
    assert type(after) is type(plant)
    for name, value in fields(plant).items():
        assert equal(value, getattr(after, name)), name


def test_mat_has_the_state_space_and_the_modes(tmp_path: Path) -> None:
    stored = scipy.io.loadmat(write_plant(MODAL, tmp_path / "p.mat"))
    form = state_space(MODAL)
    for name in "ABCD":
        assert np.array_equal(stored[name], getattr(form, name))
    assert np.array_equal(stored["omega"].ravel(), MODAL.omega)
    assert np.array_equal(stored["shape_out_acceleration"], MODAL.shape_out_acceleration)
    assert [str(cell[0]) for cell in stored["InputName"].ravel()] == list(MODAL.inputs)
    assert stored["OutputName"].shape == (1, 1)
    assert stored["dt"].item() == 0.0
    assert scipy.io.loadmat(write_plant(DISCRETE, tmp_path / "d.mat"))["dt"].item() == 0.001
    singular = scipy.io.loadmat(write_plant(SINGULAR, tmp_path / "e.mat"))
    assert np.array_equal(singular["E"].toarray(), [[1, 0], [0, 0]])


def test_files_that_are_no_plant(tmp_path: Path) -> None:
    for name, content in (
        ("a.npz", b"PK\x03\x04" + b".npy" * 9),
        ("b.h5", b"\x89HDF\r\n\x1a\n" + bytes(99)),
        ("c.npz", b"hello"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ReadError, match=name):
            read_plant(tmp_path / name)
    np.savez(tmp_path / "d.npz", a=np.ones(3))
    with pytest.raises(ReadError, match="no usable flexplant header"):
        read_plant(tmp_path / "d.npz")


def a_result() -> xr.Dataset:
    frequency = np.array([1.0, 2.5, 1 / 3])
    response = RNG.standard_normal((2, 3)) + 1j * RNG.standard_normal((2, 3))
    return xr.Dataset(
        {
            "response": (("output", "frequency"), response, {"units": "m/N", "settings": {"method": "modal", "n": (1, 2)}}),
            "settled": ("output", np.array([True, False])),
            "limit": ((), 3.5),
        },
        coords={"output": ["bus.1.1", "optic.9.x°"], "frequency": ("frequency", frequency, {"units": "Hz"})},
        attrs={"title": "t", "checked": True, "nothing": None, "sizes": [1, 2], "number": 0.1},
    )


def test_results_come_back_equal(tmp_path: Path) -> None:
    before = a_result()
    after = read_results(write_results(before, tmp_path / "r.nc"))
    for name in before.variables:
        assert np.array_equal(after[name].values, before[name].values)
    assert after["response"].dtype == np.complex128
    assert after["response"].attrs == {"units": "m/N", "settings": {"method": "modal", "n": [1, 2]}}
    assert after.attrs == before.attrs
    assert after["frequency"].attrs == {"units": "Hz"}
    assert "settings" in before["response"].attrs  # the given result is as it was
    assert np.iscomplexobj(before["response"])


def test_results_are_plain_netcdf(tmp_path: Path) -> None:
    """No HDF5 types beyond NetCDF's: complex numbers are two real variables."""
    import h5netcdf

    write_results(a_result()["response"], tmp_path / "r.nc")
    with h5netcdf.File(tmp_path / "r.nc", "r") as file:
        assert {"response__real", "response__imag", "frequency"} <= set(file.variables)
        assert file.variables["response__real"].dtype == np.float64


def test_results_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "r.nc").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(200))
    with pytest.raises(ReadError, match=r"r\.nc"):
        read_results(tmp_path / "r.nc")
    with pytest.raises(ReadError, match="no such file"):
        read_results(tmp_path / "s.nc")
