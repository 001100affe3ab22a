"""Nastran bulk data cards: small, large and free fields, continuations, Nastran's number spellings, THRU lists.

Layout: MSC Nastran Quick Reference Guide, "Format of Bulk Data Entries". Counts are bounded by the file's length.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from flexplant.errors import ReadError
from flexplant.io.parse.files import read_bytes

LONGEST_THRU = 10**6
LARGEST_REAL = 1e30  # no length or angle is larger
SHORT_EXPONENT = re.compile(r"(?<=[\d.])([+-]\d+)$")  # 1.5-3 means 1.5e-3
INCLUDE = re.compile(r"\s*INCLUDE\s*[ '\"]\s*([^'\"]+?)\s*['\"]?\s*$", re.IGNORECASE)


@dataclass(frozen=True)
class Card:
    """One bulk data entry: name in upper case, fields after it (blanks stripped), the line where it starts.

    where: said instead of the line, for entries that are not from a text file.
    """

    path: Path
    name: str
    fields: tuple[str, ...]
    line: int
    where: str = ""

    def fail(self, problem: str) -> ReadError:
        """The error to raise for this card."""
        return ReadError(self.path, f"{self.name} {problem}", record=self.where or f"line {self.line}")

    def text(self, index: int) -> str:
        """Field by its place (0 is the first after the name), empty if it is not there."""
        return self.fields[index] if index < len(self.fields) else ""

    def integer(self, index: int, default: int | None = None) -> int:
        """An integer field; ReadError names card and field."""
        text = self.text(index)
        if not text and default is not None:
            return default
        if not text.lstrip("+-").isdigit() or len(text) > 18:
            raise self.fail(f"field {index + 2} is {text!r}; an integer is needed")
        return int(text)

    def real(self, index: int, default: float = 0.0) -> float:
        """A real field, in any of Nastran's spellings (1.5-3, 1.D3)."""
        text = self.text(index)
        try:
            value = float(SHORT_EXPONENT.sub(r"e\1", text.lower().replace("d", "e"))) if text else default
        except ValueError:
            value = math.nan
        if not abs(value) < LARGEST_REAL:
            raise self.fail(f"field {index + 2} is {text!r}; a number is needed")
        return value

    def ids(self, start: int = 0) -> list[int]:
        """The ids from a field on, "a THRU b" expanded; blanks skipped."""
        out: list[int] = []
        index = start
        while index < len(self.fields):
            if self.text(index + 1).upper() == "THRU":
                first, last = self.integer(index), self.integer(index + 2)
                if not 0 <= last - first <= LONGEST_THRU:
                    raise self.fail(f"lists {first} THRU {last}")
                out.extend(range(first, last + 1))
                index += 3
                continue
            if self.text(index):
                out.append(self.integer(index))
            index += 1
        return out


def read_cards(path: str | Path) -> list[Card]:
    """The cards of a bulk data file; of a whole deck, those after BEGIN BULK. Comments and ENDDATA are left out."""
    path = Path(path)
    text = read_bytes(path).decode("utf-8", "replace")
    if "\x00" in text[:4096]:
        raise ReadError(path, "is binary, not bulk data", offset=text.index("\x00"))
    lines = text.splitlines()
    begin = next((i + 1 for i, line in enumerate(lines) if re.match(r"\s*BEGIN\s+BULK", line, re.IGNORECASE)), 0)
    return list(_cards(lines, begin, path))


def _cards(lines: list[str], begin: int, path: Path) -> Iterator[Card]:
    name, fields, where = "", [""], 0
    for number, raw in enumerate(lines[begin:], begin + 1):
        line = raw.split("$", 1)[0].rstrip().expandtabs(8)
        if not line.strip():
            continue
        included = INCLUDE.match(line)
        head, rest = ("INCLUDE", [included[1]]) if included else _fields(line)
        if not head or head[0] in "+*":
            fields += rest
            continue
        if name:
            yield Card(path, name, tuple(fields), where)
        name, fields, where = head.rstrip("*").upper(), rest, number
        if name == "ENDDATA":
            return
    if name:
        yield Card(path, name, tuple(fields), where)


def _fields(line: str) -> tuple[str, list[str]]:
    """Name field and the data fields of one line: 8 (small), 4 (large), or up to 8 (free field)."""
    if "," in line:
        head, *rest = [part.strip() for part in line.split(",")]
        per_line = 4 if head.endswith("*") else 8
        return head, (rest + [""] * per_line)[:per_line]
    head = line[:8].strip()
    width, count = (16, 4) if head.endswith("*") or head.startswith("*") else (8, 8)
    return head, [line[8 + width * i : 8 + width * (i + 1)].strip() for i in range(count)]
