"""Universal files (UFF): their datasets, and the units that dataset 164 states.

Layout: SDRC universal file formats, published by the University of Cincinnati (SDRL). ASCII files.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.files import UNSTATED_NUMBERS, one_line
from flexplant.io.parse.number_text import read_lines
from flexplant.model.arrays import FloatArray
from flexplant.model.units import SI, UnitSystem, unit_system

DELIMITER = "    -1"
UNITS = "164"
LARGEST = 1e12  # more than any two units of length or force are apart
SAME = 1e-4  # relative: factors are written with as few as six digits


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


def numbers(path: Path, section: Section, start: int, stop: int | None = None) -> FloatArray:
    """The numbers in some lines of a dataset; ReadError for text."""
    fields = " ".join(section.lines[start:stop]).replace("D", "E").split()
    try:
        return np.array(fields, dtype=float)
    except ValueError:
        raise ReadError(path, "has text where numbers should be", record=f"line {section.first + start}") from None


def file_units(path: Path, found: Iterable[Section], asked: str | UnitSystem | tuple[float, float] | None) -> UnitSystem | None:
    """What dataset 164 states, or what was asked for where it states nothing; ReadError where the two contradict each other."""
    given = None if asked is None else unit_system(asked)
    for section in (s for s in found if s.number == UNITS):
        stated = _stated(path, section)
        if given is not None and not np.allclose([stated.length, stated.mass], [given.length, given.mass], rtol=SAME, atol=0):
            problem = f"dataset 164 says {stated.name}, which is not {given.name!r}"
            raise ReadError(path, problem, record=f"line {section.first}")
        given = stated if given is None else given
    return given


def _stated(path: Path, section: Section) -> UnitSystem:
    """Record 1: code, description. Record 2: what SI lengths and forces are multiplied by to be those of the file."""
    factors = numbers(path, section, 1, 2)
    if factors.size < 2 or not ((factors[:2] > 1 / LARGEST) & (factors[:2] < LARGEST)).all():
        raise ReadError(path, "dataset 164 has no factors of length and force", record=f"line {section.first + 1}")
    length, force = (float(1 / f) for f in factors[:2])
    if length == force == 1.0:
        return SI
    text = one_line(section.lines[0][10:30]).strip()
    return UnitSystem(f"{text or 'units'} (dataset 164: {length:.9g} m, {force:.9g} N)", length, force / length)


def said_units(units: UnitSystem | None) -> str:
    """What a provenance says of units: the file's system, whose numbers were converted to SI; or that none was stated."""
    return UNSTATED_NUMBERS if units is None else units.name


def is_si(units: UnitSystem | None) -> bool:
    """Whether numbers stay as they are."""
    return units is None or replace(units, name=SI.name) == SI
