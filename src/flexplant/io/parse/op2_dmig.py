"""DMIG entries inside OUTPUT2 files, as EXTSEOUT(DMIGOP2=unit) stores boundary matrices: in MATPOOL, or a data block a matrix.

Words of a record: 114, 1, 120; then for each matrix its name (2), 0, form, type in, type out, polar, 0, columns; for each column
grid and component of the column, then grid, component and value for each row, ended by -1, -1; another -1, -1 ends the matrix.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.bulk import Card
from flexplant.io.parse.files import one_line
from flexplant.io.parse.op2 import Op2

KEY = (114, 1, 120)
HEADER_WORDS = 9
SINGLE, DOUBLE = 1, 2


@dataclass
class _Words:
    """A record as integers and as bytes, with the place that is read next."""

    file: Op2
    where: str
    offset: int
    integers: Any
    data: bytes
    at: int = len(KEY)

    def fail(self, problem: str) -> ReadError:
        return ReadError(self.file.path, problem, record=self.where, offset=self.offset)

    def pair(self) -> tuple[int, int]:
        """The next two words; (-1, -1) at the end of the record."""
        left = self.integers[self.at : self.at + 2].tolist()
        self.at += 2
        return (left[0], left[1]) if len(left) == 2 else (-1, -1)

    def number(self, kind: int) -> float:
        """The next value, single or double precision."""
        word = self.file.word
        size = word if kind == SINGLE else 8
        begin = self.at * word
        if begin + size > len(self.data):
            raise self.fail("a DMIG entry ends within a value")
        self.at += size // word
        return float(np.frombuffer(self.data, f"{self.file.order}f{size}", 1, begin)[0])


def read_dmig_cards(path: Path) -> list[Card]:
    """The DMIG entries of all data blocks as cards; empty if there is none. ReadError for complex and broken ones."""
    file, out = Op2.open(path), []
    for block in file.blocks():
        for _, parts, offset in block.records:
            data = b"".join(parts)
            integers = file.integers(memoryview(data))
            if tuple(integers[:3].tolist()) == KEY:
                out += list(_cards(_Words(file, f"DMIG in {block.name}", offset, integers, data)))
    return out


def _cards(words: _Words) -> Iterator[Card]:
    while words.at + HEADER_WORDS <= words.integers.size:
        word = words.file.word
        text = words.data[words.at * word : (words.at + 2) * word].decode("latin-1")
        name = one_line(text.replace(" ", "").replace("\x00", ""))
        form, kind, _, _, _, columns = words.integers[words.at + 3 : words.at + HEADER_WORDS].tolist()
        words.at += HEADER_WORDS
        if kind not in (SINGLE, DOUBLE):
            raise words.fail(f"{name} is of type {kind}; real matrices (1, 2) are needed")
        yield _card(words, (name, "0", str(form), str(kind), "0", "", "", str(columns)))
        while (column := words.pair()) != (-1, -1):
            fields = [name, str(column[0]), str(column[1]), ""]
            while (row := words.pair()) != (-1, -1):
                fields += [str(row[0]), str(row[1]), repr(words.number(kind)), ""]
            yield _card(words, tuple(fields))


def _card(words: _Words, fields: tuple[str, ...]) -> Card:
    return Card(words.file.path, "DMIG", fields, 0, words.where)
