"""Records of Ansys' binary files: a count of 4-byte words, a word of flags, the words, and the count again.

Flags: integers or doubles, and whether zeros were left out ("bits": a mask of at most 32 places; "windows": pieces with their
places). Files of both byte orders are read. Layout: Ansys Programmer's Reference, "Format of binary data files".
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from flexplant.errors import ReadError
from flexplant.model.arrays import IntArray

KINDS = {2: ".emat", 4: ".full", 8: ".sub"}
STANDARD = 100  # words of the first record of every such file
INTEGERS, SINGLE, ZLIB, WINDOWS, BITS = (1 << k for k in (31, 30, 29, 28, 27))


def byte_order(head: bytes) -> str | None:
    """ "<" or ">" by the count of the first record; None if this is no Ansys binary file."""
    return next((o for o in "<>" if len(head) >= 12 and struct.unpack_from(o + "i", head)[0] == STANDARD), None)


def binary_kind(head: bytes) -> str | None:
    """The kind of an Ansys binary file, such as ".full", by the file's number at the front of its first record."""
    order = byte_order(head)
    return None if order is None else KINDS.get(struct.unpack_from(order + "i", head, 8)[0])


@dataclass(frozen=True, eq=False)
class AnsysFile:
    """The words of a file, mapped and not read: only what is asked for takes memory."""

    path: Path
    words: IntArray
    order: str

    @classmethod
    def of(cls, path: Path, head: bytes) -> AnsysFile:
        """The file with these first bytes; ReadError for one that is none."""
        order = byte_order(head)
        if order is None or path.stat().st_size < 4 * STANDARD:
            raise ReadError(path, "is no Ansys binary file: its first record is not one of 100 words")
        count = path.stat().st_size // 4
        return cls(path, np.asarray(np.memmap(path, dtype=f"{order}i4", mode="r", shape=(count,))), order)

    def record(self, at: int, what: str, most: int) -> tuple[Any, int]:
        """The numbers of the record at a word, at most `most`, and the word behind it; ReadError for anything inconsistent."""
        if not 0 <= at < len(self.words) - 3:
            self.fail(what, at, f"would begin at word {at}, but the file has {len(self.words)}")
        count, flags = int(self.words[at]), int(self.words[at + 1])
        stop = at + 2 + count
        if count < 1 or stop >= len(self.words):
            self.fail(what, at, f"has {count} words, but {max(len(self.words) - at - 3, 0)} are left")
        if self.words[stop] != count:
            self.fail(what, at, f"begins with length {count} and ends with {self.words[stop]}")
        body = self.words[at + 2 : stop]
        if flags & (SINGLE | ZLIB):
            self.fail(what, at, "is in single precision or zipped, which is not read; write it uncompressed (/FCOMP)")
        integers, most = bool(flags & INTEGERS), min(most, len(self.words))
        if flags & WINDOWS:
            return self._windows(body, integers, what, at, most), stop + 1
        found = self._bits(body, integers, what, at) if flags & BITS else self._numbers(body, integers)
        if found.size > most:
            self.fail(what, at, f"has {found.size} numbers; at most {most} are expected")
        return found, stop + 1

    def _numbers(self, body: IntArray, integers: bool) -> Any:
        return body if integers else body[: body.size // 2 * 2].view(f"{self.order}f8")

    def _bits(self, body: IntArray, integers: bool, what: str, at: int) -> Any:
        size, mask = (int(body[0]), int(body[1])) if body.size > 1 else (-1, 0)
        given = self._numbers(body[2:], integers)
        places = [k for k in range(max(min(size, 32), 0)) if mask >> k & 1]
        if not 0 <= size <= 32 or given.size < len(places):
            self.fail(what, at, f"is packed as {size} numbers, of which {given.size} are given")
        out = np.zeros(size, dtype=given.dtype)
        out[places] = given[: len(places)]
        return out

    def _windows(self, body: IntArray, integers: bool, what: str, at: int, most: int) -> Any:
        size, many = (int(body[0]), int(body[1])) if body.size > 1 else (-1, 0)
        if not 0 <= size <= most:
            self.fail(what, at, f"is packed as {size} numbers; at most {most} are expected")
        out = np.zeros(size, dtype=np.int32 if integers else np.float64)
        word = 2
        for _ in range(many):
            word = self._window(out, body, word, integers)
            if word < 0:
                self.fail(what, at, f"has a packed piece outside its {size} numbers")
        return out

    def _window(self, out: Any, body: IntArray, word: int, integers: bool) -> int:
        """Put one piece into its place; the word behind it, or -1 where it does not fit."""
        if word + 1 >= body.size:
            return -1
        place = int(body[word])
        alone = place > 0  # one number; otherwise minus the place, then the length, negative where one number fills it
        length = 1 if alone else int(body[word + 1])
        word += 1 if alone else 2
        place, given = abs(place), 1 if length < 0 else length
        values = self._numbers(body[word : word + given * (1 if integers else 2)], integers)
        if not length or values.size < given or place + abs(length) > out.size:
            return -1
        out[place : place + abs(length)] = values
        return word + given * (1 if integers else 2)

    def fail(self, what: str, at: int, problem: str) -> NoReturn:
        """ReadError naming the record and its byte."""
        raise ReadError(self.path, problem, record=what, offset=4 * at)
