"""Mutated vendor files end in ReadError or in a model, never in anything else, quickly and without large memory.

FLEXPLANT_FUZZ sets the number of mutations a reader (default 25); run this file as a script for a count of outcomes.
"""

from __future__ import annotations

import collections
import os
import shutil
import struct
import sys
import tempfile
import time
import tracemalloc
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from ansys_files import write_full
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nx_files import TRUSS
from op2_files import dmig_words, write_op2
from test_abaqus_substructure import substructure
from test_component_writers import component
from test_external_superelements import as_op2
from test_extptfm import guyan
from test_extptfm import text as jacket_text
from test_harwell_boeing import folder_of
from test_matrix_formats import LAYOUTS, PAIRS, model
from test_mechss_matrices import PLANT
from test_sierra_netcdf import pairs, reduction
from test_uff_reference import function, mode

from flexplant.errors import PlausibilityWarning, ReadError
from flexplant.io import (
    read_component,
    read_geometry,
    read_model,
    read_plant,
    read_reference,
    read_response_functions,
    write_component,
    write_plant,
)
from flexplant.model.component import Component
from flexplant.model.geometry import Nodes

HERE = Path(__file__).parent
COUNT = int(os.environ.get("FLEXPLANT_FUZZ", "25"))
SECONDS, MEGABYTES = 5.0, 100.0
NASTY = [b"0", b"-1", b"999999999", b"99999999999999999999", b"1e308", b"-1e999", b"nan", b"inf", b"", b"x", b"\x00", b"*", b"$",
         b",", b"!", b"\n", b"1.5-3", b"\xff\xfe"]  # fmt: skip

LINES = [
    "1 1 2.0\n",
    "DMIG",
    "GRID",
    "!Dimension: 9\n",
    "    -1\n",
    "    55\n",
    "%%MatrixMarket matrix coordinate real general\n",
]


def sierra_netcdf(folder: Path) -> Path:
    path = folder / "r.nc4"
    with scipy.io.netcdf_file(path, "w") as file:
        for name, size in (("n", 12), ("two", 2), ("rows", 9)):
            file.createDimension(name, size)
        for key in ("Kr", "Mr"):
            file.createVariable(key, "d", ("n", "n"))[:] = model().stiffness
        file.createVariable("cbmap", "i", ("rows", "two"))[:] = PAIRS[:9]
    return path


def extptfm(folder: Path) -> Path:
    one = Nodes(ids=[1], positions=np.zeros((1, 3)))
    return write_component(
        Component(name="j", mass=np.eye(7), stiffness=np.eye(7), boundary=[(1, "123456")], nodes=one),
        folder / "j.extptfm",
        overwrite=True,
    )


def nas2cam(folder: Path) -> Path:
    for ending in (".op2", ".op4"):
        shutil.copyfile(TRUSS / f"nas2cam{ending}", folder / f"nas2cam{ending}")
    return folder / "nas2cam.op2"


def copied(*names: str) -> Callable[[Path], Path]:
    """Real files, copied; the first is the one to read."""

    def make(folder: Path) -> Path:
        for name in names:
            shutil.copyfile(HERE / name, folder / Path(name).name)
        return folder / Path(names[0]).name

    return make


def substructure_file(folder: Path) -> Path:
    (folder / "s.mtx").write_text(substructure({"STIFFNESS": np.eye(8), "MASS": np.eye(8)}))
    return folder / "s.mtx"


def hbmat(folder: Path) -> Path:
    return folder_of(folder, model(), np.arange(12))


def ansys_full(folder: Path, packed: bool = False) -> Path:
    m = model()
    matrices = {"stiffness": m.stiffness, "mass": m.mass, "damping": 0.1 * m.stiffness}
    return write_full(folder / "job.full", matrices, [20, 4, 19, 7], [1, 2, 3], fixed=[0, 5], packed=packed, scale=1.0)


def universal(folder: Path) -> Path:
    stated = "    -1\n   164\n         5mm (milli newton)            2\n  1.0D+03  1.0D+03  1.0D+00\n    -1\n"
    (folder / "u.uff").write_text(stated + mode(1.0, np.ones((2, 3))) + function(np.ones(4) + 0j))
    return folder / "u.uff"


def both_references(path: Path) -> object:
    return read_reference(path, component="a"), read_response_functions(path)


def bulk(folder: Path) -> Path:
    for name in ("inboard.dat", "inboard.blk"):
        shutil.copyfile(TRUSS / name, folder / name)
    return folder / "inboard.dat"


def op2_dmig(folder: Path) -> Path:
    columns = {(n, d): [(n, d, 2.0)] for n in (3, 4) for d in (1, 2, 3)} | {(90, 0): [(90, 0, 5.0)]}
    words = struct.pack("<3i", 114, 1, 120) + dmig_words("KAAX", columns) + dmig_words("MAAX", columns)
    (folder / "d.pch").write_text("GRID,3,,1.,2.,3.\nGRID,4,,0.,2.,3.\nASET1,123,3,4\nSPOINT,90\nQSET1,0,90\n")
    return write_op2(folder / "d.op2", {}, {"MATPOOL": words})


def openfast(folder: Path) -> Path:
    (folder / "SE.dat").write_text(jacket_text())
    return folder / "SE.dat"


def old_openfast(folder: Path) -> Path:
    (folder / "Guyan.dat").write_text(guyan())
    return folder / "Guyan.dat"


def mat_plant(folder: Path) -> Path:
    return write_plant(PLANT, folder / "p.mat", overwrite=True)


SAMPLES: dict[str, tuple[Callable[[Path], Path], Callable[[Path], object]]] = {
    **{name: (lambda folder, make=make: make(folder, model()), read_model) for name, make in LAYOUTS.items()},
    "nastran_dmig": (lambda folder: write_component(component(), folder / "p.pch", overwrite=True),
                     lambda p: read_component(p, format="nastran_dmig")),
    "nastran_op2": (nas2cam, lambda p: read_component(p, format="nastran_op2", superelement=101)),
    "sierra_netcdf": (sierra_netcdf, lambda p: read_component(p, format="sierra_netcdf")),
    "extptfm": (extptfm, lambda p: read_component(p, format="extptfm")),
    "universal file": (universal, both_references),
    "calculix of ccx": (copied(*(f"calculix/rigid{e}" for e in (".sti", ".mas", ".dof", ".inp"))), read_model),
    "abaqus_substructure": (substructure_file, lambda p: read_component(p, format="abaqus_substructure")),
    "ansys_hbmat": (hbmat, lambda p: read_model(p, format="ansys_hbmat")),
    "ansys_full": (ansys_full, lambda p: read_model(p, format="ansys_full")),
    "ansys_full packed": (lambda folder: ansys_full(folder, True), lambda p: read_model(p, format="ansys_full")),
    "mystran_sparse": (copied(*(f"mystran/panel{e}" for e in (".L1L", ".L1R", ".bdf"))),
                       lambda p: read_model(p, format="mystran_sparse")),
    "mystran_output4": (copied(*(f"mystran/beam{e}" for e in (".OU1", ".bdf"))),
                        lambda p: read_component(p, format="mystran_output4")),
    "nastran_op2 + cards": (as_op2, lambda p: read_component(p, format="nastran_op2")),
    "nastran_op2 DMIG": (op2_dmig, lambda p: read_component(p, format="nastran_op2")),
    "extptfm of OpenFAST": (openfast, lambda p: read_component(p, format="extptfm")),
    "extptfm of Guyan": (old_openfast, lambda p: read_component(p, format="extptfm")),
    "sierra_netcdf nodes": (lambda folder: reduction(folder / "r.nc4", pairs(47, 19), [47, 19])[0],
                            lambda p: read_component(p, format="sierra_netcdf")),
    "mat plant": (mat_plant, read_plant),
    "nastran_bulk": (bulk, lambda p: read_geometry(p, format="nastran_bulk", units="mm-kg-s")),
    "npz plant": (lambda folder: write_plant(PLANT, folder / "p.npz", overwrite=True), read_plant),
}  # fmt: skip


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """One to three changes: a cut, flipped bytes, a token or line replaced, doubled or dropped."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        if not out:
            break
        at = int(rng.integers(len(out)))
        kind = int(rng.integers(6))
        if kind == 0:
            del out[at:]
        elif kind == 1:
            out[at] = int(rng.integers(256))
        elif kind == 2:
            out[at : at + int(rng.integers(1, 12))] = NASTY[int(rng.integers(len(NASTY)))]
        elif kind == 3:
            stop = min(len(out), at + int(rng.integers(1, 200)))
            out[at:at] = out[at:stop]
        elif kind == 4:
            del out[at : at + int(rng.integers(1, 200))]
        else:
            out[at : at + 4] = int(rng.choice([0, -1, 2**31 - 1, -(2**31), 65536])).to_bytes(4, "little", signed=True)
    return bytes(out)


def outcome(name: str, folder: Path, seed: int) -> str:
    """Mutate one of the sample's files and read it: "read" or "refused"; anything else is raised."""
    make, read = SAMPLES[name]
    path = make(folder)
    files = sorted(p for p in folder.iterdir() if p.is_file())
    rng = np.random.default_rng(seed)
    victim = files[int(rng.integers(len(files)))]
    victim.write_bytes(mutated(victim.read_bytes(), rng))
    try:
        read(path)
    except ReadError as error:
        return "refused" if str(folder) in str(error) else f"refused without the file: {error}"
    return "read"


@pytest.mark.parametrize("name", list(SAMPLES))
def test_mutated_files_end_in_a_model_or_a_read_error(tmp_path: Path, name: str) -> None:
    tracemalloc.start()
    began = time.perf_counter()
    for seed in range(COUNT):
        folder = tmp_path / str(seed)
        folder.mkdir()
        assert outcome(name, folder, seed) in ("read", "refused")
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    assert time.perf_counter() - began < SECONDS * COUNT
    assert peak < MEGABYTES


@pytest.mark.parametrize("name", ["matrix_market", "calculix", "nastran_dmig", "sierra_text", "extptfm", "universal file",
                                  "abaqus_substructure", "ansys_hbmat", "mystran_sparse"])  # fmt: skip
@settings(max_examples=COUNT, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_text_instead_of_a_file(tmp_path: Path, name: str, data: st.DataObject) -> None:
    make, read = SAMPLES[name]
    path = make(tmp_path)
    words = st.sampled_from([w.decode("latin-1") for w in NASTY] + LINES)
    path.write_bytes("".join(data.draw(st.lists(words, max_size=30))).encode("latin-1") or b" ")
    assert told(read, path)


def told(read: Callable[[Path], object], path: Path) -> bool:
    """Whether reading gives a value, or a ReadError whose message begins with the file."""
    try:
        return read(path) is not None
    except ReadError as error:
        return str(error).startswith(str(path.parent))


def main() -> None:
    """Print how many mutated files were read and how many were refused, by reader."""
    warnings.simplefilter("ignore", PlausibilityWarning)
    total: collections.Counter[str] = collections.Counter()
    for name in SAMPLES:
        counts: collections.Counter[str] = collections.Counter()
        slowest = 0.0
        for seed in range(COUNT):
            with tempfile.TemporaryDirectory() as folder:
                began = time.perf_counter()
                counts[outcome(name, Path(folder), seed)] += 1
                slowest = max(slowest, time.perf_counter() - began)
        total += counts
        print(f"{name:20} {dict(counts)} slowest {slowest:.2f} s")
    print("total", dict(total))


if __name__ == "__main__":
    sys.exit(main())
