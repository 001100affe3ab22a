"""Long runs written piece by piece: the file is the whole run, interruptions keep what is finished, memory stays bounded."""

import importlib.util
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
import xarray as xr

from flexplant.errors import InputError, WriteError
from flexplant.io import read_results, write_results
from flexplant.loop.simulate import simulate
from flexplant.loop.stream import simulate_stream
from flexplant.plant.modal import ModalPlant

DT = 1e-3
PLANT = ModalPlant(
    omega=[0.0, 30.0, 200.0], zeta=[0.0, 0.01, 0.02], shape_in=np.eye(3, 2), shape_out=np.ones((2, 3)),
    inputs=["u", "w"], outputs=["y", "Träger"], output_units=["m", "rad"],
)  # fmt: skip


def signal(t):
    return {"u": np.sin(40 * t), "w": np.cos(7 * t)}


def pieces(samples=1000, piece=300, **more):
    return simulate_stream(PLANT, **{"dt": DT, "samples": samples, "inputs": signal, "piece": piece, **more})


@pytest.mark.parametrize("every", [1, 7])
def test_the_file_is_the_whole_run(tmp_path, every):
    listed = list(pieces(every=every))
    written = read_results(write_results(pieces(every=every), tmp_path / "long.nc"))
    assert np.array_equal(written.outputs, np.hstack([p.outputs for p in listed]))
    assert np.array_equal(written.time, np.hstack([p.time for p in listed]))
    assert np.array_equal(written.final_state, listed[-1].final_state)
    assert written.attrs == {"plant": "plant"}
    assert list(written.output_units.values) == ["m", "rad"]
    assert written.time.units == "s"
    whole = simulate(PLANT, DT * np.arange(1000), signal(DT * np.arange(1000)), every=every).outputs.values
    assert abs(written.outputs.values - whole).max() < 1e-12 * abs(whole).max()
    assert [p.name for p in tmp_path.iterdir()] == ["long.nc"]


C_LIBRARY = """
import sys, netCDF4
with netCDF4.Dataset(sys.argv[1]) as found:
    print(found["time"].units, found.dimensions["time"].isunlimited(), *found["output"][:], *found["output_units"][:])
    print(found["outputs"][:].tobytes().hex())
"""


def test_the_c_library_of_netcdf_reads_it(tmp_path):
    """In a process of its own: it brings another HDF5 than h5py's."""
    if importlib.util.find_spec("netCDF4") is None:
        pytest.skip("netCDF4 is not installed (extra test)")
    expected = read_results(write_results(pieces(), tmp_path / "long.nc")).outputs.values
    arguments = [sys.executable, "-X", "utf8", "-c", C_LIBRARY, str(tmp_path / "long.nc")]
    said = subprocess.run(arguments, capture_output=True, check=True, encoding="utf-8").stdout.splitlines()
    assert said == ["s True y Träger m rad", expected.tobytes().hex()]


class StopError(Exception):
    """What stands for Ctrl-C or a failing disk."""


def interrupted(listed, after):
    yield from listed[:after]
    raise StopError


def test_an_interrupted_run_goes_on_where_it_stopped(tmp_path):
    listed, path, partial = list(pieces()), tmp_path / "long.nc", tmp_path / "long.partial.nc"
    with pytest.raises(StopError) as error:
        write_results(interrupted(listed, 2), path)
    assert str(partial) in error.value.__notes__[0]
    assert [p.name for p in tmp_path.iterdir()] == ["long.partial.nc"]
    done = read_results(partial)
    assert done.sizes["time"] == 600
    left = 1000 - round(float(done.final_time) / DT)
    rest = pieces(samples=left, start=float(done.final_time), initial=done.final_state.values)
    whole = read_results(write_results(rest, path, append=True))
    expected = np.hstack([p.outputs for p in listed])
    assert abs(whole.outputs.values - expected).max() < 1e-12 * abs(expected).max()
    assert np.allclose(whole.time, DT * np.arange(1000), rtol=1e-14, atol=0)
    assert [p.name for p in tmp_path.iterdir()] == ["long.nc"]


def test_interrupted_twice_and_before_the_first_piece(tmp_path):
    listed, path = list(pieces()), tmp_path / "long.nc"
    with pytest.raises(StopError):
        write_results(interrupted(listed, 0), path)
    assert not list(tmp_path.iterdir())
    with pytest.raises(StopError):
        write_results(interrupted(listed, 1), path)
    with pytest.raises(StopError):
        write_results(interrupted(listed[1:], 2), path, append=True)
    assert read_results(tmp_path / "long.partial.nc").sizes["time"] == 900
    write_results(iter(listed[3:]), path, append=True)
    assert np.array_equal(read_results(path).outputs, np.hstack([p.outputs for p in listed]))


def test_memory_does_not_grow_with_the_run(tmp_path):
    def peak(samples):
        tracemalloc.start()
        write_results(pieces(samples, piece=2000), tmp_path / f"{samples}.nc")
        used = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return used

    peak(4000)
    assert peak(40_000) < 1.2 * peak(8000)


def test_progress_counts_the_samples_of_pieces_that_were_taken(tmp_path):
    calls = []
    write_results(pieces(progress=lambda done, of: calls.append((done, of))), tmp_path / "long.nc")
    assert calls == [(300, 1000), (600, 1000), (900, 1000), (1000, 1000)]


def other(**changed):
    return xr.Dataset({"outputs": (("output", "time"), np.ones((2, 3)))}, coords={"output": ["y", "z"]}).assign(changed)


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (other().rename(time="instant"), "no dimension 'time', only output, instant"),
        (other(more=("time", np.ones(3))), "has 'more', which those before it have not"),
        (other().isel(output=[0]), "has 1 entries along 'output', before 2"),
        (other().transpose(), r"is along \('time', 'output'\), before along \('output', 'time'\)"),
        (other().assign_coords(output=["y", "x"]), "names other channels"),
        (3.0, "takes a Dataset or DataArray"),
    ],
)
def test_pieces_that_do_not_fit(tmp_path, second, message):
    with pytest.raises(InputError, match=message) as error:
        write_results(iter([other(), second]), tmp_path / "long.nc")
    assert "\n" not in str(error.value)
    assert read_results(tmp_path / "long.partial.nc").equals(other())


def test_what_cannot_be_appended_to_or_is_someone_elses(tmp_path):
    with pytest.raises(InputError, match="no pieces"):
        write_results(iter([]), tmp_path / "long.nc")
    with pytest.raises(WriteError, match=r"nothing to append to: there is no long\.nc and no long\.partial\.nc"):
        write_results(iter([other()]), tmp_path / "long.nc", append=True)
    write_results(other(), tmp_path / "long.nc")
    with pytest.raises(InputError, match="append=True takes an iterator of pieces"):
        write_results(other(), tmp_path / "long.nc", append=True)
    other().to_netcdf(tmp_path / "far.partial.nc", engine="h5netcdf")
    for append in (False, True):
        with pytest.raises(WriteError, match="is not a file that this writes"):
            write_results(iter([other()]), tmp_path / "far.nc", append=append)
