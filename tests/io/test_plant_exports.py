"""Plants that run elsewhere: compiled C, Octave, Julia text. Each is compared with our own simulation or response."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from exported_plants import kinds
from stepwise_simulation import simulate

from flexplant.errors import InputError
from flexplant.io import write_plant
from flexplant.plant.discretize import discretize
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace, state_space
from flexplant.response.frequency import frequency_response

GCC, OCTAVE = shutil.which("gcc"), shutil.which("octave")
needs_gcc = pytest.mark.skipif(GCC is None, reason="no C compiler (gcc)")
needs_octave = pytest.mark.skipif(OCTAVE is None, reason="octave is not installed")
FLAGS = ["-O3", "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
DT = 1e-3


def plant(n: int = 20, *, seed: int = 2, **given: object) -> ModalPlant:
    rng = np.random.default_rng(seed)
    fields: dict = {
        "omega": np.r_[np.zeros(min(n, 2)), np.sort(rng.uniform(3, 5000, max(n - 2, 0)))],
        "zeta": 0.01,
        "shape_in": rng.standard_normal((n, 3)),
        "shape_out": rng.standard_normal((2, n)),
        "inputs": ["bus.101.1", "bus.101.2", 'odd "name" */ ??='],
        "outputs": ["optic.9.1", "optic.9.1:a"],
        "input_units": ["N", "N", "Nm"],
        "output_units": ["m", "m/s²"],
        "static_correction": rng.standard_normal((2, 3)),
        "shape_out_acceleration": rng.standard_normal((2, n)) * 1e-3,
        "name": "plate & <co>",
    }
    return ModalPlant(**(fields | given))


DRIVER = """
#include "p.h"
#include <stdio.h>
#include <string.h>
int main(int argc, char **argv) {
  p_state s; p_real u[P_INPUTS], y[P_OUTPUTS]; double x;
  if (argc > 1) { for (int j = 0; j < P_INPUTS; j++) puts(p_input_names[j]); return 0; }
  (void)argv; memset(&s, 1, sizeof s); p_reset(&s);
  for (;;) {
    for (int j = 0; j < P_INPUTS; j++) { if (scanf("%lf", &x) != 1) return 0; u[j] = (p_real)x; }
    p_step(&s, u, y);
    for (int k = 0; k < P_OUTPUTS; k++) printf("%.17g ", (double)y[k]);
  }
}
"""


def run_c(folder: Path, inputs: np.ndarray, *defines: str) -> np.ndarray:
    (folder / "main.c").write_text(DRIVER)
    subprocess.run([GCC, *FLAGS, *defines, "-o", "run", "main.c", "p.c"], cwd=folder, check=True)
    text = "\n".join(" ".join(map(repr, row)) for row in inputs.T.tolist())
    done = subprocess.run([folder / "run"], input=text, capture_output=True, text=True, check=True)
    return np.array(done.stdout.split(), dtype=float).reshape(inputs.shape[1], -1).T


def c_kinds() -> dict[str, object]:
    return kinds() | {"acceleration": plant(), "displacements only": plant(shape_out_acceleration=None)}


@needs_gcc
@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("kind", list(c_kinds()))
def test_c_source_equals_our_simulation(tmp_path: Path, kind: str, hold: str) -> None:
    given = c_kinds()[kind]
    sampled = getattr(given, "dt", None) is not None
    if sampled and hold == "first":
        with pytest.raises(InputError, match="discrete, so its inputs are held"):
            write_plant(given, tmp_path / "p.c", hold=hold)
        return
    write_plant(given, tmp_path / "p.c", **({} if sampled else {"dt": DT, "hold": hold}))
    u = np.random.default_rng(0).standard_normal((len(given.inputs), 400))
    before = np.hstack([np.zeros((len(u), 1)), u])  # linear inputs rise from zero over the step before the first
    expected = simulate(given, np.arange(401) * DT, before, hold=hold)["outputs"].values[:, 1:]
    ours = run_c(tmp_path, u)
    assert abs(ours - expected).max() < 1e-12 * abs(expected).max()
    single = run_c(tmp_path, u, "-DP_REAL=float")
    assert abs(single - expected).max() < 1e-3 * abs(expected).max()
    names = subprocess.run([tmp_path / "run", "names"], capture_output=True, text=True, check=True).stdout
    assert names.splitlines() == list(given.inputs)


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("define", ["-DP_REAL=double", "-DP_REAL=float"])
def test_c_source_compiles_without_a_warning(tmp_path: Path, compiler: str, define: str) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    for given in kinds().values():
        write_plant(given, tmp_path / "p.c", dt=DT)
        command = [compiler, *FLAGS, "-Wshadow", define, "-fsyntax-only", "p.c"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")


@needs_gcc
@pytest.mark.parametrize("kind", ["modal", "full damping", "defective", "no states"])
def test_c_source_runs_clean_under_sanitizers(tmp_path: Path, kind: str) -> None:
    write_plant(kinds()[kind], tmp_path / "p.c", dt=DT)
    (tmp_path / "main.c").write_text(DRIVER)
    flags = ["-std=c99", "-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    built = subprocess.run([GCC, *flags, "-o", "run", "main.c", "p.c"], cwd=tmp_path, capture_output=True, text=True, check=False)
    if "cannot find" in built.stderr:
        pytest.skip("the compiler has no sanitizers")
    assert built.returncode == 0, built.stderr
    done = subprocess.run([tmp_path / "run"], input="1 2 3 " * 40, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@needs_gcc
def test_c_header_is_for_cpp_too(tmp_path: Path) -> None:
    write_plant(plant(), tmp_path / "p.c", dt=DT)
    header = (tmp_path / "p.h").read_text()
    assert "P_INPUT_BUS_101_1 = 0" in header
    assert "malloc" not in (tmp_path / "p.c").read_text()
    (tmp_path / "x.cpp").write_text('#include "p.h"\nint main() { return P_OUTPUT_OPTIC_9_1 + sizeof(p_state) * 0; }\n')
    if shutil.which("g++"):
        subprocess.run(["g++", "-Wall", "-Werror", "-fsyntax-only", "x.cpp"], cwd=tmp_path, check=True)


def test_c_source_says_how_it_advances(tmp_path: Path) -> None:
    for kind, says in (("full damping", "20 independent modes or blocks"), ("defective", "6 states with a full matrix (6^2")):
        write_plant(kinds()[kind], tmp_path / "p.c", dt=DT)
        assert says in (tmp_path / "p.h").read_text()


def test_c_source_needs_a_sample_time(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="give dt="):
        write_plant(plant(), tmp_path / "p.c")
    with pytest.raises(InputError, match="positive number of seconds"):
        write_plant(plant(), tmp_path / "p.c", dt=-1)
    with pytest.raises(InputError, match=r"discrete with dt = 0.001 s"):
        write_plant(discretize(plant(), DT), tmp_path / "p.c", dt=2e-3)
    assert list(tmp_path.iterdir()) == []


def octave(folder: Path, command: str) -> np.ndarray:
    return np.array(re.findall(r"[-+.\deE]+", run_octave(folder, command)), dtype=float)


def run_octave(folder: Path, command: str) -> str:
    done = subprocess.run(
        [str(OCTAVE), "--no-gui", "-q", "--eval", f"pkg load control; {command}"],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if "package" in done.stderr and "control" in done.stderr:
        pytest.skip("octave has no control package")
    assert done.returncode == 0, done.stderr
    return done.stdout


@needs_octave
def test_octave_has_the_same_poles_and_response(tmp_path: Path) -> None:
    given = plant(8, omega=np.r_[0.0, 0.0, np.linspace(3, 300, 6)])
    write_plant(given, tmp_path / "plate.m")
    hz = [0.3, 7.0, 100.0]
    printed = octave(
        tmp_path,
        f"s = plate(); p = pole(s); printf('%.17g %.17g\\n', [real(p) imag(p)]'); "
        f"h = freqresp(s, 2*pi*{hz}); printf('%.17g %.17g\\n', [real(h(:)) imag(h(:))]'); printf('%d', numel(s.inname))",
    )
    poles, response, count = printed[:32].reshape(16, 2), printed[32:-1].reshape(-1, 2), printed[-1]
    assert count == 3
    ours = np.linalg.eigvals(state_space(given).A)
    key = lambda z: np.lexsort((np.round(z.imag, 6), np.round(abs(z), 6)))  # noqa: E731
    theirs = poles[:, 0] + 1j * poles[:, 1]
    np.testing.assert_allclose(theirs[key(theirs)], ours[key(ours)], atol=1e-9 * abs(ours).max())
    expected = frequency_response(given, hz).values
    seen = (response[:, 0] + 1j * response[:, 1]).reshape(expected.shape, order="F")
    np.testing.assert_allclose(seen, expected, rtol=1e-9, atol=1e-12 * abs(expected).max())


@needs_octave
def test_octave_reads_descriptors_discrete_plants_and_mechanical_matrices(tmp_path: Path) -> None:
    singular = Descriptor(sp.diags_array([2.0, 0.0]), -np.eye(2), np.ones((2, 1)), np.ones((1, 2)), [[0.5]], ["u"], ["y"])
    write_plant(singular, tmp_path / "d.m")
    write_plant(StateSpace([[0.5]], [[1.0]], [[2.0]], [[0.0]], ["u"], ["y"], dt=0.1), tmp_path / "z.m")
    given = plant(4, omega=[0.0, 1.0, 2.0, 3.0])
    write_plant(given, tmp_path / "q.m")
    text = "s = d(); printf('%.17g ', size(s.e), real(freqresp(s, 1))); z = z(); printf('%.17g ', get(z, 'tsam'), z.a);"
    at_1 = frequency_response(singular, [1 / (2 * np.pi)]).values.real.item()
    np.testing.assert_allclose(octave(tmp_path, text), [2, 2, at_1, 0.1, 0.5])
    text = "[~, p] = q(); m = p.mechanical; s = 2i; h = (m.F + s*m.G)*((s^2*m.M + s*m.C + m.K)\\m.B) + m.D; "
    printed = octave(tmp_path, text + "printf('%.17g ', real(h))")
    expected = frequency_response(given, [2 / (2 * np.pi)]).values.real[:, :, 0]
    np.testing.assert_allclose(printed.reshape(2, 3, order="F"), expected, rtol=1e-10)


@needs_octave
def test_octave_knows_the_channels_by_their_names(tmp_path: Path) -> None:
    """Letters of more than one byte too: each once cut one character off its name, so that two inputs had the same."""
    given = plant(3, inputs=["Kühler.1", "Kühler.2", "π 😀"], outputs=["Träger", "y"])
    square = Descriptor(
        sp.eye_array(3), -np.eye(3), np.ones((3, 3)), np.ones((2, 3)), np.zeros((2, 3)), given.inputs, given.outputs
    )
    plants = {"a": given, "b": discretize(given, DT), "c": square}
    for name, one in plants.items():
        write_plant(one, tmp_path / f"{name}.m")
    text = "; ".join(f"s = {name}(); n = [s.inname; s.outname]; printf('%s\\n', n{{:}})" for name in plants)
    done = run_octave(tmp_path, text)
    assert done.splitlines() == 3 * [*given.inputs, *given.outputs]


@needs_octave
def test_mechanical_matrices_give_the_response_with_full_damping_and_rates(tmp_path: Path) -> None:
    """mechss: M q'' + C q' + K q = B u, y = F q + G q' + D u."""
    damping = np.diag([0, 0.1, 0.1, 0.2, 0.3])
    damping[1:, 1:] += 0.02
    rates = np.random.default_rng(3).standard_normal((2, 5))
    given = plant(5, omega=[0.0, 1, 2, 3, 4], damping=damping, shape_out_velocity=rates)
    write_plant(given, tmp_path / "q.m")
    text = "[~, p] = q(); m = p.mechanical; s = 2i; h = (m.F + s*m.G)*((s^2*m.M + s*m.C + m.K)\\m.B) + m.D; "
    printed = octave(tmp_path, text + "printf('%.17g ', real(h), imag(h))")
    expected = frequency_response(given, [2 / (2 * np.pi)]).values[:, :, 0]
    seen = printed.reshape(2, 3, 2).transpose(2, 1, 0)
    np.testing.assert_allclose(seen[..., 0] + 1j * seen[..., 1], expected, rtol=1e-10)


def test_julia_file_keeps_every_digit(tmp_path: Path) -> None:
    """No Julia here: its literals are parsed, and must be the same doubles."""
    given = plant()
    text = write_plant(given, tmp_path / "plate.jl").read_text()
    direct = given.direct + given.shape_out_acceleration @ given.shape_in
    for key, values in (("omega", given.omega), ("shape_in", given.shape_in), ("direct", direct)):
        body = re.search(rf"plate_{key} = reshape\(\[(.*?)\], (\d+), (\d+)\)", text, re.DOTALL)
        numbers = np.array(body[1].replace(";", " ").split(), dtype=float).reshape(int(body[2]), int(body[3]))
        np.testing.assert_array_equal(numbers.reshape(values.shape), values)
    assert 'const plate_inputs = ["bus.101.1", "bus.101.2"' in text


def test_julia_grammar_takes_every_file(tmp_path: Path) -> None:
    """Julia itself cannot be installed everywhere; its grammar can (pip install tree-sitter tree-sitter-julia)."""
    tree_sitter, julia = pytest.importorskip("tree_sitter"), pytest.importorskip("tree_sitter_julia")
    parser = tree_sitter.Parser(tree_sitter.Language(julia.language()))
    for given in kinds().values():
        text = write_plant(given, tmp_path / "p.jl").read_bytes()
        assert not parser.parse(text).root_node.has_error


@needs_octave
@pytest.mark.parametrize("kind", ["modal", "full damping", "state space", "sampled"])
def test_julia_arithmetic_gives_the_state_space(tmp_path: Path, kind: str) -> None:
    """Octave reads Julia's matrices and operators alike; comprehension, zero(), const and strings are put into its words."""
    given = kinds()[kind]
    text = write_plant(given, tmp_path / "p.jl").read_text()
    lines = [line for line in text.splitlines() if not line.startswith(("#", "function", "end")) and "puts = [" not in line]
    body = "\n".join(lines).replace("const ", "").replace("return ss(", "s = ss(").replace("zero(", "0 * (")
    body = re.sub(r"\[i == j .*?\]", "eye(size(p_omega, 1))" if "p_omega" in body else "", body)
    (tmp_path / "run.m").write_text(
        f"{body};\nsave('-v7', 'out.mat', 'sa', 'sb', 'sc', 'sd');".replace("s = ss(", "[sa, sb, sc, sd] = deal4(")
    )
    (tmp_path / "deal4.m").write_text("function [a, b, c, d] = deal4(a, b, c, d, dt)\nend\n")
    run_octave(tmp_path, "run")
    seen, form = scipy.io.loadmat(tmp_path / "out.mat"), state_space(given)
    for name in "ABCD":
        np.testing.assert_array_equal(seen[f"s{name.lower()}"], getattr(form, name))


@pytest.mark.parametrize(("stem", "instead"), [("a-b", "a_b.m"), ("2nd", "p_2nd.m"), ("end", "end_model.m"), ("x" * 64, "xxx")])
def test_scripts_that_could_not_be_called_are_refused(tmp_path: Path, stem: str, instead: str) -> None:
    with pytest.raises(InputError, match=rf"cannot be called.*name it '{instead}"):
        write_plant(plant(3), tmp_path / f"{stem}.m")
    assert not list(tmp_path.iterdir())
