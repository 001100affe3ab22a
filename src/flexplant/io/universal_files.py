"""Reference modes and responses from universal files (UFF): dataset 55 (mode shapes) and 58 (functions).

Layout: SDRC universal file formats, published by the University of Cincinnati (SDRL). ASCII files; of dataset 58 also the
binary variant 58b is refused with a message that says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import InputError, ReadError
from flexplant.io.parse.files import as_path, one_line, provenance
from flexplant.io.parse.number_text import integers
from flexplant.io.parse.universal import Section, file_units, is_si, numbers, said_units, sections
from flexplant.model.arrays import FloatArray
from flexplant.model.component import check_name
from flexplant.model.units import UnitSystem
from flexplant.verification import Reference

NORMAL_MODE, COMPLEX_MODE = 2, 3
TIME_RESPONSE, RESPONSE_FUNCTION = 1, 4
REAL_TYPES, COMPLEX_TYPES = (2, 4), (5, 6)
QUANTITIES = {0: "unknown", 1: "general", 2: "stress", 3: "strain", 5: "temperature", 6: "heat flux", 8: "displacement",
              9: "reaction force", 11: "velocity", 12: "acceleration", 13: "excitation force", 15: "pressure", 16: "mass",
              17: "time", 18: "frequency", 19: "rpm", 20: "order"}  # fmt: skip
MOTIONS = {"displacement": "receptance", "velocity": "mobility", "acceleration": "accelerance"}
FORCES = ("reaction force", "excitation force")
SI_UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2", **dict.fromkeys(FORCES, "N")}
ANGULAR_UNITS = {"displacement": "rad", "velocity": "rad/s", "acceleration": "rad/s^2", **dict.fromkeys(FORCES, "N m")}
Units = str | UnitSystem | tuple[float, float]


@dataclass(frozen=True)
class ResponseFunction:
    """A dataset 58: values over the abscissa (Hz for a frequency response), response and reference DOF (node, direction).

    attrs: what the file says of its axes, "abscissa", "ordinate" and "denominator", each with "quantity" ("acceleration", ...),
    "label" and "units" as in the file, or SI where numbers were converted. source: the file, its hash, the reader, its units.
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


def read_reference(path: str | Path, *, component: str | None = None, units: Units | None = None) -> Reference:
    """The modes of dataset 55: frequencies in Hz, and with `component` the shapes at "component.node.direction".

    Shapes are the real parts of three or six values a node. units: the file's unit system as in `read_component`; None takes
    what dataset 164 states; translations become metres beside radians. Raises ReadError where there is no dataset 55 of modes,
    where its modes have different nodes, or where units contradict the file's.
    """
    path = as_path(path)
    if component is not None:
        check_name(component, "component")
    found = list(sections(path))
    modes = [_mode(path, s) for s in found if s.number == "55"]
    if not modes:
        raise ReadError(path, "has no dataset 55 (mode shapes)")
    labels = modes[0][1]
    if any(mode[1] != labels for mode in modes):
        raise ReadError(path, "has modes with different nodes; give one mode set a file")
    chosen = file_units(path, found, units)
    order = np.argsort([hz for hz, _, _ in modes], kind="stable")
    hz = np.array([modes[i][0] for i in order])
    shapes = np.column_stack([modes[i][2] for i in order]) * _lengths(labels, chosen)[:, None]
    named = [f"{component}.{node}.{direction}" for node, direction in labels]
    record = _record(path, "universal file 55", chosen)
    try:
        if component is None:
            return Reference(hz, source=path.name, provenance=record)
        return Reference(hz, shapes, named, source=path.name, provenance=record)
    except InputError as error:
        raise ReadError(path, one_line(error)) from None


def read_response_functions(path: str | Path, *, units: Units | None = None) -> list[ResponseFunction]:
    """All functions of dataset 58; ReadError for binary ones and for counts that do not fit.

    units: the file's unit system as in `read_component`; None takes what dataset 164 states. Motions and forces become SI.
    """
    path = as_path(path)
    every = list(sections(path))
    found = [s for s in every if s.number.startswith("58")]
    if any(s.number != "58" for s in found):
        raise ReadError(path, "has binary datasets 58b; export them as ASCII (58)")
    chosen = file_units(path, every, units)
    source = _record(path, "universal file 58", chosen) if found else {}
    return [_in_si(replace(_function(path, s), source=source), chosen) for s in found]


def _record(path: Path, kind: str, units: UnitSystem | None) -> dict[str, Any]:
    return provenance(path, kind, __name__) | {"units": said_units(units)}


def _lengths(labels: list[tuple[int, int]], units: UnitSystem | None) -> FloatArray:
    """Metres in a unit of each translation, 1 for rotations."""
    length = 1.0 if units is None else units.length
    return np.array([length if direction <= 3 else 1.0 for _, direction in labels])


def _in_si(function: ResponseFunction, units: UnitSystem | None) -> ResponseFunction:
    """In SI: frequency responses of motions and forces, and their histories. Else the numbers of the file, as `source` says."""
    if is_si(units):
        return function
    assert units is not None
    over = _axis(function, "ordinate", function.response[1], units)
    under = _axis(function, "denominator", function.reference[1], units)
    if over is None or under is None or function.kind not in (TIME_RESPONSE, RESPONSE_FUNCTION):
        kept = f"{units.name}: not converted: a function of type {function.kind}, {function.quantity}"
        return replace(function, source={**function.source, "units": kept})
    attrs = {**function.attrs}
    for axis, (_, unit) in (("ordinate", over), ("denominator", under)):
        attrs[axis] = {**attrs[axis], "units": unit} if unit else attrs[axis]
    return replace(function, values=function.values * (over[0] / under[0]), attrs=attrs)


def _axis(function: ResponseFunction, axis: str, direction: int, units: UnitSystem) -> tuple[float, str] | None:
    """SI units in a unit of the file's axis, and the SI unit; (1, "") where a history has no denominator; None if not known."""
    quantity = function.attrs[axis]["quantity"]
    if axis == "denominator" and function.kind == TIME_RESPONSE and quantity in ("unknown", "general"):
        return 1.0, ""
    angular = abs(direction) > 3
    if quantity in FORCES:
        return units.force * (units.length if angular else 1.0), (ANGULAR_UNITS if angular else SI_UNITS)[quantity]
    if quantity in MOTIONS:
        return 1.0 if angular else units.length, (ANGULAR_UNITS if angular else SI_UNITS)[quantity]
    return None


def _integers(path: Path, section: Section, line: int, count: int) -> list[int]:
    values = numbers(path, section, line, line + 1) if line < len(section.lines) else np.zeros(0)
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
    reals = numbers(path, section, 7, 8)
    if reals.size < 1 + (kind == COMPLEX_MODE):
        raise ReadError(path, "a mode has no frequency", record=f"line {section.first + 7}")
    frequency = float(reals[0]) if kind == NORMAL_MODE else float(abs(reals[0] + 1j * reals[1]) / (2 * np.pi))
    width = each * (2 if data_type in COMPLEX_TYPES else 1)
    table = numbers(path, section, 8)
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
    first, step = [*numbers(path, section, 6, 7)[3:5].tolist(), 0.0, 0.0][:2]
    found = numbers(path, section, 11)
    parts = 2 if data_type in COMPLEX_TYPES else 1
    width = parts + (0 if even else 1)
    if data_type not in (*REAL_TYPES, *COMPLEX_TYPES) or found.size != count * width:
        problem = f"data type {data_type}, {count} values announced, {found.size} numbers found"
        raise ReadError(path, problem, record=f"line {section.first + 6}")
    table = found.reshape(count, width)
    abscissa = first + step * np.arange(count) if even else table[:, 0]
    ordinate = table[:, width - parts :]
    values = ordinate[:, 0] + 1j * ordinate[:, 1] if parts == 2 else ordinate[:, 0]
    return ResponseFunction(one_line(section.lines[0]), kind, response, reference, abscissa, values, _axes(section))
