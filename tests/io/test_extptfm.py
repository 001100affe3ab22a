"""ExtPtfm superelements in the layout of OpenFAST's own regression test (ours in content: a small made-up jacket)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from structures import chain

from flexplant.errors import InputError, ReadError
from flexplant.io import read_component, write_component
from flexplant.modes import normal_modes
from flexplant.reduction import craig_bampton
from flexplant.verification import mass_properties

N = 8
MASS, HEIGHT = 9.6e5, 5.5


def jacket() -> dict[str, np.ndarray]:
    """Six rigid-body rows of a tower head below the reference point, clamped at the sea bed, and two modes."""
    rows = {k: np.zeros((N, N)) for k in ("Mass", "Stiffness", "Damping")}
    mass = rows["Mass"]
    mass[:3, :3] = MASS * np.eye(3)
    mass[3:6, 3:6] = np.diag([6.7e7, 6.7e7, 1.03e7])
    mass[0, 4] = mass[4, 0] = -MASS * HEIGHT
    mass[1, 3] = mass[3, 1] = MASS * HEIGHT
    mass[0, 6] = mass[6, 0] = 360.6
    mass[1, 7] = mass[7, 1] = 360.5
    mass[6:, 6:] = np.eye(2)
    rows["Stiffness"][:6, :6] = np.diag([8.4e7, 8.4e7, 9e8, 7.0e10, 7.0e10, 2e9])
    rows["Stiffness"][6:, 6:] = np.diag([90.0, 91.0])
    rows["Damping"] = 1e-3 * rows["Stiffness"]
    rows["Mass"][0, 1], rows["Mass"][1, 0] = 5.07e-11, 5.03e-11  # as unsymmetric as round-off leaves it
    return rows


def text(n: int = N) -> str:
    """Comments, sizes with several blanks, a title with a blank after it, blank lines between, a history with E+003."""
    lines = ["!Comment", "!Comment Flex 5 Format", f"!Dimension: {n}", "!Time increment in simulation:  0.05000"]
    lines += ["!Total simulation time in file:  0.10000", ""]
    for title, matrix in jacket().items():
        lines += [f"!{title} Matrix" + " " * (title == "Mass"), f"!Dimension:   {n}"]
        lines += ["".join(f" {v:15.8e}" for v in row) for row in matrix]
        lines += [""]
    lines += ["!Loading and Wave Elevation", f"!Dimension: 1 time column -  {n} force columns"]
    lines += [f"    {t:.4f}" + "  9.65000686E+001" * n for t in (0.0, 0.05, 0.1)]
    return "\n".join(lines) + "\n"


def test_the_layout_of_openfast_is_read_from_any_ending(tmp_path: Path) -> None:
    path = tmp_path / "ExtPtfm_SE.dat"
    path.write_text(text())
    read = read_component(path)
    assert (read.source["format"], read.n_modal, read.source["units"]) == ("extptfm", 2, "SI")
    assert read.source["unused"] == ["load history, 3 times"]
    for kind, matrix in jacket().items():
        np.testing.assert_allclose(getattr(read, kind.lower()), matrix, rtol=1e-8, atol=1e-10 * abs(matrix).max())
    found = mass_properties(read)
    assert found.mass == pytest.approx(MASS)
    assert found.center_of_gravity[2] == pytest.approx(-HEIGHT)
    omega = np.sqrt(np.linalg.eigvals(np.linalg.solve(read.mass, read.stiffness)).real.min())
    assert normal_modes(read, n_modes=1).frequency_hz[0] == pytest.approx(omega / (2 * np.pi), rel=1e-9)


def test_what_we_write_reads_back_through_the_same_layout(tmp_path: Path) -> None:
    path = tmp_path / "a.dat"
    path.write_text(text().replace("e+0", "D+0"))
    read = read_component(path)
    again = read_component(write_component(read, tmp_path / "b.extptfm"))
    np.testing.assert_array_equal(again.stiffness, read.stiffness)
    assert again.source["unused"] == ["load history, 2 times"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("!Stiffness Matrix", "!Stifness Matrix"), "has no stiffness matrix"),
        (("!Dimension: 8", "!Dimension: 4"), r"line 3.*dimension '4'"),
        (("!Dimension: 8", "!Dimension: 31"), r"is not 31 numbers"),
        ((" 1.00000000e+00", " 1.0000zz00e+00"), "is not 8 numbers"),
    ],
)
def test_malformed_files_name_the_line(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    assert change[0] in text()
    (tmp_path / "s.dat").write_text(text().replace(*change, 1))
    with pytest.raises(ReadError, match=message):
        read_component(tmp_path / "s.dat")


def test_another_reader_of_openfast_files_gets_our_matrices(tmp_path: Path) -> None:
    """weio (MIT; by an author of OpenFAST's own tools) reads what we write, bit by bit."""
    other = pytest.importorskip("weio.fast_input_file", reason="weio is not installed (pip install weio)")
    component = craig_bampton(chain(), [(1, "123456")], n_modes=4, damping_ratio=0.01)
    write_component(component, tmp_path / "platform.extptfm")
    found = other.FASTInputFileBase(str(tmp_path / "platform.extptfm"))
    for name, matrix in (("Mass", component.mass), ("Stiffness", component.stiffness), ("Damping", component.damping)):
        np.testing.assert_array_equal(np.array(found[f"{name}Matrix"], dtype=float), matrix)


def openfast_5(folder: Path) -> dict[str, object]:
    """The superelement as OpenFAST 5's own input package holds it after reading the file."""
    package = pytest.importorskip("openfast_io.FAST_reader", reason="openfast-io is not installed (pip install openfast-io)")
    reader = package.InputReader_OpenFAST()
    reader.fst_vt["ExtPtfm"]["FlexASCII"] = {}
    reader.read_Superelement(str(folder / "SE.extptfm"))
    return reader.fst_vt["ExtPtfm"]["FlexASCII"]


def test_openfast_5_reads_what_we_write_and_we_what_it_writes(tmp_path: Path) -> None:
    """There and back through the input package of the OpenFAST project: bit by bit there, in its nine digits back."""
    component = craig_bampton(chain(), [(1, "123456")], n_modes=4, damping_ratio=0.01)
    write_component(component, tmp_path / "SE.extptfm", openfast=5)
    held = openfast_5(tmp_path)
    for name in ("Mass", "Stiffness", "Damping"):
        np.testing.assert_array_equal(held[f"{name}Matrix"], getattr(component, name.lower()))
    assert held["nDOF"] == component.n
    writer = pytest.importorskip("openfast_io.FAST_writer").InputWriter_OpenFAST()
    writer.fst_vt, writer.FAST_namingOut, writer.FAST_runDirectory = {"ExtPtfm": {"FlexASCII": held}}, "theirs", str(tmp_path)
    held["WeightStiffness"] = np.eye(component.n)
    writer.write_Superelement()
    back = read_component(tmp_path / "theirs_ExtPtfm_SE.dat")
    assert (back.source["format"], back.source["unused"]) == ("extptfm", ["stiffness of the weight"])
    for kind in ("mass", "stiffness", "damping"):
        expected = getattr(component, kind)
        np.testing.assert_allclose(getattr(back, kind), expected, rtol=1e-8, atol=1e-12 * abs(expected).max())


def test_both_layouts_come_back_bit_equal(tmp_path: Path) -> None:
    component = craig_bampton(chain(), [(1, "123456")], n_modes=4, damping_ratio=0.01)
    for openfast, unused in ((4, ["load history, 2 times"]), (5, [])):
        back = read_component(write_component(component, tmp_path / f"v{openfast}.extptfm", openfast=openfast))
        assert back.source["unused"] == unused
        for kind in ("mass", "stiffness", "damping"):
            np.testing.assert_array_equal(getattr(back, kind), getattr(component, kind))
    with pytest.raises(InputError, match="openfast must be a whole number"):
        write_component(component, tmp_path / "x.extptfm", openfast="5")


def guyan(comment: str = "made up") -> str:
    """GuyanASCII as OpenFAST's manual gives it: fixed lines, mass, damping, stiffness, then loads."""
    m = {k: v[:6, :6] for k, v in jacket().items()}
    lines = [comment]
    for title in ("Mass", "Damping", "Stiffness"):
        lines += [f"#{title}", *("  ".join(f"{v:.9E}" for v in row) for row in m[title])]
    lines += ["# time-varying force", "# Time Fx Fy Fz Mx My Mz", "# s (N) (N) (N) (N-m) (N-m) (N-m)"]
    return "\n".join([*lines, *(f"{t} 1.0 0 0 0 0 0" for t in (0.0, 0.5))]) + "\n"


def test_the_guyan_layout_is_read(tmp_path: Path) -> None:
    (tmp_path / "Guyan.dat").write_text(guyan())
    read = read_component(tmp_path / "Guyan.dat")
    assert (read.source["format"], read.n_modal, read.source["unused"]) == ("extptfm", 0, ["load history, 2 times"])
    for kind, matrix in jacket().items():
        np.testing.assert_allclose(getattr(read, kind.lower()), matrix[:6, :6], rtol=1e-9, atol=1e-9 * abs(matrix).max())
    for text, message in (
        ("\n".join(guyan().splitlines()[:20]), "20 lines; the three matrices of GuyanASCII end in line 22"),
        (guyan().replace("#Stiffness\n", "#Stiffness\n\n"), r"stiffness matrix has 5 of 6 rows|line 1\d"),
        (guyan().replace("9.600000000E+05", "9.6e", 1), "line 3"),
    ):
        (tmp_path / "Guyan.dat").write_text(text)
        with pytest.raises(ReadError, match=message):
            read_component(tmp_path / "Guyan.dat")
