"""Reference modes and responses from universal files (UFF): dataset 55 (mode shapes) and 58 (functions).

Layout: SDRC universal file formats, published by the University of Cincinnati (SDRL). ASCII files; of dataset 58 also the
binary variant 58b is refused with a message that says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import InputError, ReadError
from flexplant.io.parse.files import as_path, one_line, provenance
from flexplant.io.parse.number_text import integers, read_lines
from flexplant.model.arrays import FloatArray
from flexplant.model.component import check_name
from flexplant.verification import Reference

DELIMITER = "    -1"
NORMAL_MODE, COMPLEX_MODE = 2, 3
RESPONSE_FUNCTION = 4
REAL_TYPES, COMPLEX_TYPES = (2, 4), (5, 6)
QUANTITIES = {0: "unknown", 1: "general", 2: "stress", 3: "strain", 5: "temperature", 6: "heat flux", 8: "displacement",
              9: "reaction force", 11: "velocity", 12: "acceleration", 13: "excitation force", 15: "pressure", 16: "mass",
              17: "time", 18: "frequency", 19: "rpm", 20: "order"}  # fmt: skip
MOTIONS = {"displacement": "receptance", "velocity": "mobility", "acceleration": "accelerance"}
FORCES = ("reaction force", "excitation force")


@dataclass(frozen=True)
class ResponseFunction:
    """A dataset 58: values over the abscissa (Hz for a frequency response), response and reference DOF (node, direction).

    attrs: what the file says of its axes, "abscissa", "ordinate" and "denominator", each with "quantity" ("acceleration", ...),
    "label" and "units" as in the file, which are not converted. source: the file, its hash and the reader.
    """

    title: str
    kind: int
    response: tuple[int, int]
    reference: tuple[int, int]
    abscissa: FloatArray
    values: Any
    attrs: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    source: Mapping[str, Any] = field(default_factory=dict)

    @property
    def quantity(self) -> str:
        """What is over what: "receptance", "mobility" or "accelerance" of a force, else such as "strain / excitation force"."""
        over, under = (self.attrs.get(axis, {}).get("quantity", "unknown") for axis in ("ordinate", "denominator"))
        if under in FORCES and over in MOTIONS:
            return MOTIONS[over]
        return over if under in ("unknown", "general") else f"{over} / {under}"


@dataclass(frozen=True)
class Section:
    """A dataset: its number, its lines, and the number of the first of these in the file."""

    number: str
    lines: list[str]
    first: int


def sections(path: Path) -> Iterator[Section]:
    """The datasets between pairs of -1 lines."""
    lines, begin = read_lines(path), None
    for i, line in enumerate(lines):
        if line.rstrip() != DELIMITER:
            continue
        if begin is None:
            begin = i
        else:
            number = lines[begin + 1].split()[:1] if begin + 1 < i else []
            yield Section(number[0] if number else "", lines[begin + 2 : i], begin + 3)
            begin = None
    if begin is not None:
        raise ReadError(path, "ends within a dataset: no closing -1", record=f"line {begin + 1}")


def read_reference(path: str | Path, *, component: str | None = None) -> Reference:
    """The modes of dataset 55: frequencies in Hz, and with `component` the shapes at "component.node.direction".

    Shapes are the real parts of three or six values a node. Raises ReadError where there is no dataset 55 of modes, or where
    its modes have different nodes.
    """
    path = as_path(path)
    if component is not None:
        check_name(component, "component")
    modes = [_mode(path, s) for s in sections(path) if s.number == "55"]
    if not modes:
        raise ReadError(path, "has no dataset 55 (mode shapes)")
    labels = modes[0][1]
    if any(mode[1] != labels for mode in modes):
        raise ReadError(path, "has modes with different nodes; give one mode set a file")
    order = np.argsort([hz for hz, _, _ in modes], kind="stable")
    hz = np.array([modes[i][0] for i in order])
    shapes = np.column_stack([modes[i][2] for i in order])
    named = [f"{component}.{node}.{direction}" for node, direction in labels]
    try:
        return Reference(hz, source=path.name) if component is None else Reference(hz, shapes, named, source=path.name)
    except InputError as error:
        raise ReadError(path, one_line(error)) from None


def read_response_functions(path: str | Path) -> list[ResponseFunction]:
    """All functions of dataset 58; ReadError for binary ones and for counts that do not fit."""
    path = as_path(path)
    found = [s for s in sections(path) if s.number.startswith("58")]
    if any(s.number != "58" for s in found):
        raise ReadError(path, "has binary datasets 58b; export them as ASCII (58)")
    source = provenance(path, "universal file 58", __name__) if found else {}
    return [replace(_function(path, s), source=source) for s in found]


def _numbers(path: Path, section: Section, start: int, stop: int | None = None) -> FloatArray:
    fields = " ".join(section.lines[start:stop]).replace("D", "E").split()
    try:
        return np.array(fields, dtype=float)
    except ValueError:
        raise ReadError(path, "has text where numbers should be", record=f"line {section.first + start}") from None


def _integers(path: Path, section: Section, line: int, count: int) -> list[int]:
    values = _numbers(path, section, line, line + 1) if line < len(section.lines) else np.zeros(0)
    if values.size < count or not (abs(values[:count]) < 2**31).all() or (values[:count] % 1).any():
        shown = one_line(section.lines[line])[:40] if line < len(section.lines) else "nothing"
        raise ReadError(path, f"{count} integers are needed, found {shown!r}", record=f"line {section.first + line}")
    return [int(v) for v in values[:count]]


def _mode(path: Path, section: Section) -> tuple[float, list[tuple[int, int]], FloatArray]:
    """Frequency, (node, direction) labels and values of one mode."""
    _, kind, _, _, data_type, each = _integers(path, section, 5, 6)
    if kind not in (NORMAL_MODE, COMPLEX_MODE) or each not in (3, 6) or data_type not in (*REAL_TYPES, *COMPLEX_TYPES):
        problem = f"is analysis type {kind}, data type {data_type}, {each} values a node; modes have 2 or 3, 2 or 5, 3 or 6"
        raise ReadError(path, problem, record=f"line {section.first + 5}")
    reals = _numbers(path, section, 7, 8)
    if reals.size < 1 + (kind == COMPLEX_MODE):
        raise ReadError(path, "a mode has no frequency", record=f"line {section.first + 7}")
    frequency = float(reals[0]) if kind == NORMAL_MODE else float(abs(reals[0] + 1j * reals[1]) / (2 * np.pi))
    width = each * (2 if data_type in COMPLEX_TYPES else 1)
    table = _numbers(path, section, 8)
    if table.size % (width + 1):
        raise ReadError(
            path, f"{table.size} numbers are no rows of a node and {width} values", record=f"line {section.first + 8}"
        )
    rows = table.reshape(-1, width + 1)
    values = rows[:, 1:] if width == each else rows[:, 1::2]
    nodes = integers(path, rows[:, 0], "node")
    labels = [(node, d) for node in nodes.tolist() for d in range(1, each + 1)]
    return frequency, labels, values.ravel()


def _axes(section: Section) -> dict[str, dict[str, str]]:
    """Records 8 to 10: I10, 3I5, 1X, A20, 1X, A20. What is not there is "unknown" and ""."""
    out = {}
    for line, axis in enumerate(("abscissa", "ordinate", "denominator"), 7):
        text = section.lines[line]
        code = text[:10].strip()
        named = QUANTITIES.get(int(code), f"type {code}") if code.isdigit() else "unknown"
        words = [one_line(part) for part in (text[26:46], text[47:67])]
        out[axis] = {"quantity": named, **{k: "" if w == "NONE" else w for k, w in zip(("label", "units"), words, strict=True)}}
    return out


def _function(path: Path, section: Section) -> ResponseFunction:
    fields = section.lines[5].split() if len(section.lines) > 11 else []
    try:
        kind, response, reference = int(fields[0]), (int(fields[5]), int(fields[6])), (int(fields[8]), int(fields[9]))
    except (ValueError, IndexError):
        raise ReadError(path, "a dataset 58 has no usable record 6", record=f"line {section.first + 5}") from None
    data_type, count, even = _integers(path, section, 6, 3)
    first, step = [*_numbers(path, section, 6, 7)[3:5].tolist(), 0.0, 0.0][:2]
    numbers = _numbers(path, section, 11)
    parts = 2 if data_type in COMPLEX_TYPES else 1
    width = parts + (0 if even else 1)
    if data_type not in (*REAL_TYPES, *COMPLEX_TYPES) or numbers.size != count * width:
        problem = f"data type {data_type}, {count} values announced, {numbers.size} numbers found"
        raise ReadError(path, problem, record=f"line {section.first + 6}")
    table = numbers.reshape(count, width)
    abscissa = first + step * np.arange(count) if even else table[:, 0]
    ordinate = table[:, width - parts :]
    values = ordinate[:, 0] + 1j * ordinate[:, 1] if parts == 2 else ordinate[:, 0]
    return ResponseFunction(one_line(section.lines[0]), kind, response, reference, abscissa, values, _axes(section))
