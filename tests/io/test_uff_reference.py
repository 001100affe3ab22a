"""Universal files as references: modes for `verify`, functions for comparison."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexplant.errors import ReadError
from flexplant.io import read_reference, read_response_functions
from flexplant.verification import Reference

HEAD = ["model", "NONE", "22-Nov-26", "NONE", "NONE"]


def mode(hz: float, shape: np.ndarray, *, kind: int = 2, data_type: int = 2) -> str:
    """A dataset 55 of three values a node."""
    lines = ["    -1", "    55", *HEAD, f"{1:10d}{kind:10d}{2:10d}{8:10d}{data_type:10d}{3:10d}", f"{2:10d}{4:10d}{0:10d}{1:10d}"]
    if kind == 2:
        lines.append(f"{hz:13.6e}{1.0:13.6e}{0.0:13.6e}{0.0:13.6e}")
    else:
        lines.append("".join(f"{v:13.6e}" for v in (-1.0, 2 * np.pi * hz, 1.0, 0.0, 0.0, 0.0)))
    for node, row in zip((11, 12), shape, strict=True):
        values = row if data_type == 2 else np.column_stack([row, 0 * row]).ravel()
        lines += [f"{node:10d}", "".join(f"{v:13.5e}" for v in values)]
    return "\n".join([*lines, "    -1"]) + "\n"


def function(values: np.ndarray, *, even: bool = True) -> str:
    """A dataset 58, complex double precision."""
    name = "      NONE"
    lines = ["    -1", "    58", *HEAD, f"{4:5d}{1:10d}{1:5d}{0:10d} {name}{12:10d}{-3:4d} {name}{11:10d}{1:4d}"]
    lines.append(f"{6:10d}{len(values):10d}{int(even):10d}{2.0:13.5e}{0.5:13.5e}{0.0:13.5e}")
    lines += [f"{18:10d}{0:5d}{0:5d}{0:5d} {name} {name}"] * 4
    for k, v in enumerate(values):
        row = [v.real, v.imag] if even else [2.0 + 0.5 * k, v.real, v.imag]
        lines.append("".join(f"{x:20.12e}" for x in row))
    return "\n".join([*lines, "    -1"]) + "\n"


@pytest.mark.parametrize(("kind", "data_type"), [(2, 2), (3, 5), (2, 5)])
def test_modes_come_sorted_with_labels(tmp_path: Path, kind: int, data_type: int) -> None:
    shapes = np.random.default_rng(0).integers(-9, 9, (2, 2, 3)).astype(float)
    path = tmp_path / "test.uff"
    options = {"kind": kind, "data_type": data_type}
    path.write_text(mode(20.0, shapes[1], **options) + mode(12.5, shapes[0], **options))
    reference = read_reference(path, component="bus")
    assert isinstance(reference, Reference)
    np.testing.assert_allclose(reference.frequency_hz, [12.5, 20.0], rtol=2e-3 if kind == 3 else 1e-6)
    assert reference.labels[:4] == ["bus.11.1", "bus.11.2", "bus.11.3", "bus.12.1"]
    np.testing.assert_allclose(reference.shapes, shapes.reshape(2, 6).T)
    assert read_reference(path).shapes is None


@pytest.mark.parametrize("even", [True, False])
def test_frequency_responses(tmp_path: Path, even: bool) -> None:
    values = np.random.default_rng(1).standard_normal(7) + 1j * np.random.default_rng(2).standard_normal(7)
    path = tmp_path / "frf.unv"
    path.write_text(function(values, even=even) + mode(3.0, np.ones((2, 3))))
    (found,) = read_response_functions(path)
    assert (found.kind, found.response, found.reference) == (4, (12, -3), (11, 1))
    assert (found.source["path"], len(found.source["sha256"])) == (str(path), 64)
    np.testing.assert_allclose(found.abscissa, 2.0 + 0.5 * np.arange(7))
    np.testing.assert_allclose(found.values, values, rtol=1e-11)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nothing", "has no dataset 55"),
        (mode(1.0, np.ones((2, 3)))[:-8], "ends within a dataset"),
        (mode(1.0, np.ones((2, 3))).replace("        11", "        1x"), "text where numbers should be"),
        (mode(1.0, np.ones((2, 3))).replace("        11", "    11  12"), "no rows of a node"),
        (mode(1.0, np.ones((2, 3)), data_type=9), "data type 9"),
        (mode(1.0, np.ones((2, 3))) + mode(2.0, np.ones((2, 3))).replace("        11", "        19"), "different nodes"),
    ],
)
def test_malformed_files_say_where(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.uff"
    path.write_text(text)
    with pytest.raises(ReadError, match=message):
        read_reference(path)


KINDS = {
    (12, 13): "accelerance",
    (8, 13): "receptance",
    (11, 9): "mobility",
    (3, 13): "strain / excitation force",
    (12, 0): "acceleration",
    (12, 12): "acceleration / acceleration",
    (77, 13): "type 77 / excitation force",
}


@pytest.mark.parametrize(("codes", "said"), KINDS.items())
def test_what_a_function_is_of_what(tmp_path: Path, codes: tuple[int, int], said: str) -> None:
    """Records 9 and 10: a receptance and an accelerance are a factor of omega squared apart, and the numbers do not say."""
    over, under = codes
    lines = function(np.ones(3, dtype=complex)).splitlines()
    lines[10] = f"{over:10d}{0:5d}{0:5d}{0:5d} {'Acceleration':20} {'mm/s^2':20}"
    lines[11] = f"{under:10d}{0:5d}{0:5d}{0:5d} {'Force':20} {'NONE':20}"
    (tmp_path / "f.uff").write_text("\n".join(lines) + "\n")
    (found,) = read_response_functions(tmp_path / "f.uff")
    assert found.quantity == said
    assert (found.attrs["ordinate"]["label"], found.attrs["ordinate"]["units"]) == ("Acceleration", "mm/s^2")
    assert (found.attrs["denominator"]["label"], found.attrs["denominator"]["units"]) == ("Force", "")
    assert found.attrs["abscissa"]["quantity"] == "frequency"
