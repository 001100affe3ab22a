"""FMUs of both versions hold to the standard: misuse, prototypes, warnings, memory, archives."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported_plants import DT, GCC, kinds, needs_gcc, plant
from fmus import VERSIONS, Fmu, fmpy

from flexplant.errors import InputError, WriteError
from flexplant.io import write_plant
from flexplant.io.write import fmu_binary
from flexplant.plant.discretize import discretize
from flexplant.plant.state_space import StateSpace


@needs_gcc
@VERSIONS
def test_misuse_is_an_error_with_a_message(tmp_path: Path, options: dict) -> None:
    from fmpy.fmi1 import FMICallException

    def refused(call: Any, *arguments: Any, says: str) -> None:
        before = len(fmu.messages)
        with pytest.raises(FMICallException) as caught:
            call(*arguments)
        assert caught.value.status == 3  # error, in both versions
        assert re.search(says, fmu.messages[-1])
        assert len(fmu.messages) == before + 1

    fmu = Fmu(write_plant(plant(), tmp_path / "p.fmu", **options), tmp_path / "p")
    put, get = (fmu.fmu.setFloat64, fmu.fmu.getFloat64) if fmu.third else (fmu.fmu.setReal, fmu.fmu.getReal)
    refused(fmu.fmu.doStep, 0.0, DT, says="running simulation")
    refused(fmu.fmu.exitInitializationMode, says="order")
    fmu.start()
    refused(put, fmu.outputs[:1], [1.0], says="no input has this value reference")
    refused(put, [99], [1.0], says="no input has this value reference")
    refused(get, [99], says="has this value reference")
    refused(get, [2**32 - 1], says="has this value reference")
    for step in (-1e-3, float("nan"), float("inf")):
        refused(fmu.fmu.doStep, 0.0, step, says="finite number of seconds, not negative")
    if fmu.third:
        refused(put, fmu.inputs, [1.0] * 9, says="more values were given")
        refused(put, fmu.inputs, [], says="fewer values were given")
        refused(fmu.fmu.getFloat64, fmu.outputs, 1, says="room for fewer values")
        refused(fmu.fmu.getInt32, [1], says="no variables of this type")
        refused(fmu.fmu.enterEventMode, says="not provided")
    else:
        refused(fmu.fmu.getInteger, [0], says="no integers|no variables of this type")
    assert np.isfinite(fmu.run(np.ones((3, 5)), DT)).all()  # and it goes on
    fmu.close()


@needs_gcc
@pytest.mark.parametrize("version", [2, 3])
def test_a_sampled_plant_takes_whole_samples_only(tmp_path: Path, version: int) -> None:
    from fmpy.fmi1 import FMICallException

    given = discretize(plant(), DT)
    fmu = Fmu(write_plant(given, tmp_path / "p.fmu", version=version), tmp_path / "p")
    assert not fmu.about.coSimulation.canHandleVariableCommunicationStepSize
    assert float(fmu.about.defaultExperiment.stepSize) == DT
    if version == 3:
        assert float(fmu.about.coSimulation.fixedInternalStepSize) == DT
    fmu.start()
    for step in (0.4 * DT, 1.5 * DT, DT * (1 + 1e-4), 1e30):
        with pytest.raises(FMICallException):
            fmu.fmu.doStep(0.0, step)
        assert "0.001 s" in fmu.messages.pop() or step == 1e30
    fmu.fmu.doStep(0.0, 0.0)
    time = 1000.0
    for _ in range(5):  # steps with the round-off of a clock
        fmu.fmu.doStep(time, (time + DT) - time)
        time += DT
    fmu.close()


@needs_gcc
@pytest.mark.parametrize("version", [2, 3])
def test_another_fmu_and_no_instance_are_refused(tmp_path: Path, version: int) -> None:
    path = write_plant(plant(), tmp_path / "p.fmu", version=version)
    fmu = Fmu(path, tmp_path / "p")
    library = fmu.fmu.dll
    if version == 2:
        for function in ("fmi2Reset", "fmi2Terminate", "fmi2EnterInitializationMode", "fmi2CancelStep"):
            assert getattr(library, function)(None) == 3
        make = library.fmi2Instantiate
        make.restype = ctypes.c_void_p
        assert make(b"p", 1, b"another guid", None, ctypes.byref(fmu._callbacks()), 0, 0) is None
    else:
        for function in ("fmi3Reset", "fmi3Terminate", "fmi3ExitInitializationMode", "fmi3EnterStepMode"):
            assert getattr(library, function)(None) == 3
        make = library.fmi3InstantiateCoSimulation
        make.restype = ctypes.c_void_p
        log = fmu._logger()
        from fmpy.fmi3 import fmi3IntermediateUpdateCallback

        assert (
            make(b"p", b"another token", None, False, False, False, False, None, 0, None, log, fmi3IntermediateUpdateCallback())
            is None
        )
        assert "another FMU" in fmu.messages[-1]
    fmu.fmu.freeInstance()


@needs_gcc
@pytest.mark.parametrize("version", [2, 3])
def test_functions_are_those_of_the_standard(tmp_path: Path, version: int) -> None:
    """With the Modelica Association's headers in place of our restated interface every prototype fits; none is missing."""
    headers = Path(fmpy.__file__).parent / "c-code"
    with zipfile.ZipFile(write_plant(plant(), tmp_path / "p.fmu", version=version)) as archive:
        source = archive.read("sources/p.c").decode()
        library = next(archive.extract(m, tmp_path) for m in archive.namelist() if m.startswith("binaries/"))
    begin, end = source.index(f"typedef void *fmi{version}"), source.index("typedef struct {\n  Plant plant;")
    (tmp_path / "x.c").write_text(f'{source[:begin]}#include "fmi{version}Functions.h"\n{source[end:]}')
    subprocess.run([GCC, "-std=c99", "-Wall", "-Werror", "-fsyntax-only", "-I", headers, "x.c"], cwd=tmp_path, check=True)
    listed = set(
        re.findall(rf"#define (fmi{version}\w+)\s+fmi{version}FullName", (headers / f"fmi{version}Functions.h").read_text())
    )
    exported = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True).stdout
    ours = {name for name in re.findall(r" T (\w+)", exported) if name.startswith("fmi")}
    optional = {n for n in listed if version == 2 and n not in ours}  # functions of model exchange only
    assert ours == listed - optional
    assert all(
        "Continuous" in n
        or "Event" in n
        or "Derivatives" in n
        or n in ("fmi2SetTime", "fmi2NewDiscreteStates", "fmi2CompletedIntegratorStep")
        for n in optional
    )


@needs_gcc
@pytest.mark.parametrize(
    "compiler", ["gcc", *(pytest.param(c, marks=pytest.mark.slow) for c in ("clang", "x86_64-w64-mingw32-gcc"))]
)
@pytest.mark.parametrize("options", [{}, {"version": 3}])
def test_sources_compile_without_a_warning(tmp_path: Path, compiler: str, options: dict) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    for given in kinds().values():
        with zipfile.ZipFile(write_plant(given, tmp_path / "p.fmu", binary=False, **options)) as archive:
            (tmp_path / "p.c").write_bytes(archive.read("sources/p.c"))
        flags = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror", "-O2", "-c", "-o", "p.o"]
        done = subprocess.run([compiler, *flags, "p.c"], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")


SANITIZED = """
#include "p.c"
#include <stdio.h>
static void log_it(void *e, fmi3Status s, const char *c, const char *t) { (void)e, (void)s, (void)c; puts(t); }
#define CHECK(x) if (!(x)) return printf("failed: %s\\n", #x), 1
int main(void) {
  const uint32_t u = 1, y = 2, wrong = 7;
  double in[INPUTS] = {1}, out[OUTPUTS];
  fmi3Instance m[2]; void *saved = NULL; size_t size; uint8_t bytes[sizeof(State)]; fmi3String names[INPUTS];
  for (int i = 0; i < 2; i++) {
    CHECK(m[i] = fmi3InstantiateCoSimulation("p", TOKEN, NULL, 0, 0, 0, 0, NULL, 0, NULL, log_it, NULL));
    CHECK(fmi3EnterInitializationMode(m[i], 0, 0, 0, 0, 0) == fmi3OK && fmi3ExitInitializationMode(m[i]) == fmi3OK);
  }
  for (int k = 0; k < 50; k++) for (int i = 0; i < 2; i++) {
    CHECK(fmi3SetFloat64(m[i], &u, 1, in, INPUTS) == fmi3OK);
    CHECK(fmi3DoStep(m[i], k * 1e-3, k % 3 * 1e-3, 0, NULL, NULL, NULL, NULL) == fmi3OK);
    CHECK(fmi3GetFloat64(m[i], &y, 1, out, OUTPUTS) == fmi3OK);
  }
  CHECK(fmi3GetFMUState(m[0], &saved) == fmi3OK && fmi3SetFMUState(m[1], saved) == fmi3OK);
  CHECK(fmi3SerializedFMUStateSize(m[0], saved, &size) == fmi3OK && size == sizeof bytes);
  CHECK(fmi3SerializeFMUState(m[0], saved, bytes, size) == fmi3OK);
  CHECK(fmi3DeserializeFMUState(m[1], bytes, size, &saved) == fmi3OK);
  CHECK(fmi3DeserializeFMUState(m[1], bytes, size - 1, &saved) == fmi3Error);
  CHECK(fmi3GetFloat64(m[0], &wrong, 1, out, 1) == fmi3Error && fmi3GetFloat64(m[0], &y, 1, out, 0) == fmi3Error);
  CHECK(fmi3SetFMUState(m[0], NULL) == fmi3Error && fmi3GetFMUState(m[0], NULL) == fmi3Error);
  { const uint32_t text = 3; CHECK(fmi3GetString(m[0], &text, 1, names, INPUTS) == fmi3OK && names[0][0]); }
  CHECK(fmi3FreeFMUState(m[0], &saved) == fmi3OK && fmi3Reset(m[0]) == fmi3OK && fmi3Terminate(m[1]) == fmi3OK);
  fmi3FreeInstance(m[0]); fmi3FreeInstance(m[1]); fmi3FreeInstance(NULL);
  return 0;
}
"""


@needs_gcc
@pytest.mark.parametrize("kind", ["modal", "defective", "sampled", "no states"])
def test_the_source_runs_clean_under_sanitizers(tmp_path: Path, kind: str) -> None:
    with zipfile.ZipFile(write_plant(kinds()[kind], tmp_path / "p.fmu", version=3, binary=False)) as archive:
        (tmp_path / "p.c").write_bytes(archive.read("sources/p.c"))
    (tmp_path / "main.c").write_text(SANITIZED)
    flags = ["-std=c99", "-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    built = subprocess.run([GCC, *flags, "-o", "run", "main.c"], cwd=tmp_path, capture_output=True, text=True, check=False)
    if "cannot find" in built.stderr:
        pytest.skip("the compiler has no sanitizers")
    assert built.returncode == 0, built.stderr
    done = subprocess.run([tmp_path / "run"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_archive_is_the_same_each_time_and_builds_from_its_sources(tmp_path: Path) -> None:
    for version, extra in ((2, []), (3, ["sources/buildDescription.xml"])):
        path = write_plant(plant(), tmp_path / "bare.fmu", binary=False, version=version)
        with zipfile.ZipFile(path) as archive:
            assert archive.namelist() == ["modelDescription.xml", "sources/bare.c", *extra]
        first = path.read_bytes()
        assert write_plant(plant(), tmp_path / "bare.fmu", binary=False, version=version).read_bytes() == first
    build = fmpy.model_description.read_build_description(str(path), validate=True)
    assert build[0].sourceFileSets[0].sourceFiles == ["bare.c"]


@needs_gcc
@pytest.mark.parametrize("version", [2, 3])
def test_fmpy_compiles_the_sources(tmp_path: Path, version: int) -> None:
    """What an importer on another kind of computer does."""
    build = pytest.importorskip("fmpy.build")
    if shutil.which("cmake") is None:
        pytest.skip("no CMake, which FMPy builds with")
    given = plant(inputs=["a", "b", "c"], outputs=["x", "y"])
    path = write_plant(given, tmp_path / "p.fmu", version=version, arrays=False)
    bare = write_plant(given, tmp_path / "bare.fmu", version=version, arrays=False, binary=False, name="p")
    unzipped = fmpy.extract(str(bare), str(tmp_path / "bare"))
    (tmp_path / "build").mkdir()
    build.build_platform_binary(unzipped, tmp_path / "build")
    ours, theirs = (
        fmpy.simulate_fmu(str(f), output_interval=DT, stop_time=0.05, start_values={"a": 1.0}) for f in (path, unzipped)
    )
    np.testing.assert_allclose(theirs["x"], ours["x"], rtol=1e-12, atol=0)


def test_fmu_refuses_what_it_cannot_hold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="version=2 or version=3"):
        write_plant(plant(), tmp_path / "p.fmu", version=1)
    with pytest.raises(InputError, match="positive number of seconds"):
        write_plant(plant(), tmp_path / "p.fmu", dt=-1.0)
    with pytest.raises(InputError, match=r"discrete with dt = 0.001 s"):
        write_plant(discretize(plant(), DT), tmp_path / "p.fmu", dt=2e-3)
    with pytest.raises(InputError, match="at least one input and one output"):
        write_plant(StateSpace([[0.0]], np.zeros((1, 0)), [[1.0]], np.zeros((1, 0)), [], ["y"]), tmp_path / "p.fmu")
    monkeypatch.setattr(fmu_binary, "COMPILERS", ())
    with pytest.raises(WriteError, match="binary=False"):
        write_plant(plant(), tmp_path / "p.fmu", binary=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("options", [{}, {"version": 3, "arrays": False}, {"version": 3}], ids=repr)
def test_a_force_and_the_displacement_under_it_are_told_apart(tmp_path: Path, options: dict) -> None:
    names = {"inputs": ["bus.1.1", "bus.2.1"], "outputs": ["bus.1.1", "bus.3.1"]}
    collocated = StateSpace(-np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)), **names)
    path = write_plant(collocated, tmp_path / "p.fmu", binary=False, **options)
    about = fmpy.read_model_description(str(path), validate=True)  # refuses a name that is there twice
    if options.get("arrays", True) and options:
        return
    found = [v.name for v in about.modelVariables if v.causality in ("input", "output")]
    assert found == ["bus.1.1:in", "bus.2.1", "bus.1.1:out", "bus.3.1"]
