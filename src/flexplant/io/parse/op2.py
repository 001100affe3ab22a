"""Nastran OUTPUT2 files: data blocks of records, tables and matrices; 32 and 64 bit, both byte orders.

Layout: Fortran records with 4-byte length marks. A record of one word is a key: it tells how many words the next record has;
negative keys number the records of a block, 0 ends it. Everything is checked against the bytes that are there.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.files import one_line, read_bytes
from flexplant.io.parse.op4_matrix import Budget, Op4Matrix
from flexplant.model.arrays import Matrix

TAPE = b"NASTRANFORTTAPEIDCODE"  # 64-bit files have blanks inside
COLUMN = 1  # kind of a record that holds a matrix column


@dataclass
class Block:
    """A data block: name, trailer (7 words), and its records after the first: (kind, parts, offset)."""

    name: str
    trailer: tuple[int, ...]
    offset: int
    records: list[tuple[int, list[memoryview], int]] = field(default_factory=list)


def _labelled(head: bytes) -> bool:
    return TAPE in head[:128].replace(b" ", b"")


def looks_like_op2(head: bytes) -> bool:
    """Whether a file begins as OUTPUT2 files do: with the tape label, or without it with the name and trailer of a block."""
    if head[:4] not in (b"\x04\0\0\0", b"\0\0\0\x04", b"\x08\0\0\0", b"\0\0\0\x08"):
        return False
    order, word = ("<" if head[0] else ">"), max(head[0], head[3])
    code = "i" if word == 4 else "q"
    name, no_label = struct.pack(order + "i", 2 * word), struct.pack(order + code, 2)
    return _labelled(head) or (head[4 : 4 + word] == no_label and head[8 + word : 12 + word] == name)


@dataclass
class Op2:
    """An OUTPUT2 file while it is read."""

    path: Path
    data: memoryview
    order: str
    word: int
    at: int = 0

    @classmethod
    def open(cls, path: Path) -> Op2:
        """A file with its byte order and word length; ReadError if it does not begin as OUTPUT2."""
        data = read_bytes(path)
        if not looks_like_op2(data[:128]):
            raise ReadError(path, "is not an OUTPUT2 file", offset=0)
        return cls(path, memoryview(data), "<" if data[0] else ">", max(data[0], data[3]))

    def fail(self, problem: str, at: int | None = None) -> ReadError:
        """The error to raise at an offset."""
        return ReadError(self.path, problem, offset=self.at if at is None else at)

    def record(self) -> memoryview:
        """The next Fortran record."""
        begin = self.at
        if begin + 8 > len(self.data):
            raise self.fail("the file ends where a record should begin")
        (length,) = struct.unpack_from(self.order + "i", self.data, begin)
        stop = begin + 4 + length
        if length < 0 or stop + 4 > len(self.data):
            raise self.fail(f"a record claims {length} bytes, {len(self.data) - begin - 8} are left")
        if struct.unpack_from(self.order + "i", self.data, stop)[0] != length:
            raise self.fail(f"a record of {length} bytes does not end with its length")
        self.at = stop + 4
        return self.data[begin + 4 : stop]

    def key(self) -> int:
        """The next key."""
        begin, body = self.at, self.record()
        if len(body) != self.word:
            raise self.fail(f"a key of {self.word} bytes is needed, the record has {len(body)}", begin)
        return int(struct.unpack(self.order + ("i" if self.word == 4 else "q"), body)[0])

    def sized(self, words: int) -> memoryview:
        """The next record, which must have this many words."""
        begin, body = self.at, self.record()
        if len(body) != words * self.word:
            raise self.fail(f"{words} words are announced, the record has {len(body)} bytes", begin)
        return body

    def string(self, words: int) -> memoryview:
        """The next record, a row number and words - 1 numbers of 4, 8 or 16 bytes."""
        begin, body = self.at, self.record()
        if len(body) not in {self.word + (words - 1) * size for size in (4, 8, 16)}:
            raise self.fail(f"{words} words are announced, the record has {len(body)} bytes", begin)
        return body

    def integers(self, body: memoryview) -> Any:
        """Integers of a record."""
        return np.frombuffer(body[: len(body) // self.word * self.word], f"{self.order}i{self.word}").astype(np.int64)

    def blocks(self) -> Iterator[Block]:
        """The data blocks in order."""
        if _labelled(bytes(self.data[:128])):
            for _ in range(3):
                self.sized(self.key())
            if (self.key(), self.key()) != (-1, 0):
                raise self.fail("the label of the file does not end as it should")
        while self.at < len(self.data):
            words = self.key()
            if words == 0:
                continue
            yield self._block(words)

    def _block(self, words: int) -> Block:
        offset = self.at
        name = one_line(bytes(self.sized(words)).decode("latin-1").replace(" ", ""))
        if self.key() != -1:
            raise self.fail(f"block {name!r} has no trailer")
        block = Block(name, tuple(self.integers(self.sized(self.key())).tolist()), offset)
        if len(block.trailer) < 7:
            raise self.fail(f"block {name!r} has a trailer of {len(block.trailer)} words")
        key = self.key()
        while key < 0:
            if self.key() != 1:
                raise self.fail(f"block {name!r}: a record does not begin with key 1")
            kind, at, parts = self.key(), self.at, []
            key = self.key()
            if key == 0:
                return block
            while key > 0:
                parts.append(self.string(key) if kind == COLUMN else self.sized(key))
                key = self.key()
            block.records.append((kind, parts, at))
        raise self.fail(f"block {name!r} does not end as it should")

    def matrix(self, block: Block, budget: Budget) -> Matrix:
        """The matrix that a block holds, its columns being the records of kind 1."""
        columns, rows, kind = block.trailer[1], block.trailer[2], block.trailer[4]
        out = Op4Matrix(self.path, block.name, rows, columns, kind, block.offset)
        item = 8 if out.double or self.word == 8 else 4
        listed = [r for r in block.records if r[0] == COLUMN]
        for number, (_, parts, at) in enumerate(listed, 1):
            if number > columns:
                raise self.fail(f"matrix {block.name!r} has more than its {columns} columns", at)
            for part in parts:
                numbers = part[self.word :]
                if len(part) < self.word or len(numbers) % item:
                    raise self.fail(f"matrix {block.name!r}: a string of {len(part)} bytes", at)
                row = int(self.integers(part[: self.word])[0])
                out.add(number, row, np.frombuffer(numbers, f"{self.order}f{item}"), at)
        return budget.array(out)


def read_op2_matrices(path: Path) -> dict[str, Matrix]:
    """The matrices of an OUTPUT2 file by name; of a name that occurs twice, the first. ReadError if there is none."""
    file = Op2.open(path)
    budget, out = Budget(len(file.data)), {}
    for block in file.blocks():
        if block.name not in out and any(kind == COLUMN for kind, _, _ in block.records):
            out[block.name] = file.matrix(block, budget)
    if not out:
        raise ReadError(path, "holds no matrix")
    return out
