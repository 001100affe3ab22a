"""Names, units and row labels of recovery matrices as comments in a Nastran file, which has no entry for them.

    $ flexplant matrix "MREC1"
    $ flexplant recovery "displacement"
    $ flexplant units "m"
    $ flexplant row "20.1"

Texts are JSON strings in ASCII. A program other than ours reads the matrix by its name, and the comments not at all.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from flexplant.errors import ReadError
from flexplant.io.parse.files import read_bytes
from flexplant.model.arrays import Matrix
from flexplant.model.recovery import Recovery

LINE = re.compile(r'^\$ flexplant (matrix|recovery|units|row) (".*")\s*$', re.MULTILINE)


@dataclass(frozen=True)
class Note:
    """What the rows of one matrix are."""

    matrix: str
    name: str
    units: str
    labels: tuple[str, ...]

    def recovery(self, path: Path, rows: Matrix) -> Recovery:
        """The recovery of this matrix (rows, n); ReadError where there is not one label a row."""
        if rows.shape[0] != len(self.labels):
            raise ReadError(path, f"has {rows.shape[0]} rows, but {len(self.labels)} labels in the comments", record=self.matrix)
        return Recovery(name=self.name, labels=self.labels, displacement=rows, units=self.units)


def notes_text(notes: Iterable[Note]) -> str:
    """The comment lines."""
    lines = [
        (kind, text)
        for note in notes
        for kind, text in (
            ("matrix", note.matrix),
            ("recovery", note.name),
            ("units", note.units),
            *(("row", label) for label in note.labels),
        )
    ]
    return "".join(f"$ flexplant {kind} {json.dumps(text)}\n" for kind, text in lines)


def read_notes(*paths: Path) -> dict[str, Note]:
    """The notes of these files by matrix; ReadError for a line out of its place."""
    out: dict[str, Note] = {}
    for path in paths:
        parts: dict[str, str] = {}
        rows: list[str] = []
        for kind, quoted in LINE.findall(read_bytes(path).decode("utf-8", "replace")):
            if kind == "matrix":
                out |= _finished(path, parts, rows)
                parts, rows = {}, []
            text = _text(path, quoted)
            if kind == "row":
                rows.append(text)
            else:
                parts[kind] = text
        out |= _finished(path, parts, rows)
    return out


def _text(path: Path, quoted: str) -> str:
    try:
        return str(json.loads(quoted))
    except ValueError:
        raise ReadError(path, f"has a comment of ours that cannot be read: {quoted[:60]}") from None


def _finished(path: Path, parts: dict[str, str], rows: list[str]) -> dict[str, Note]:
    if not parts and not rows:
        return {}
    if missing := [kind for kind in ("matrix", "recovery", "units") if kind not in parts]:
        raise ReadError(path, f"has comments of ours on a recovery without its {missing[0]}")
    return {parts["matrix"]: Note(parts["matrix"], parts["recovery"], parts["units"], tuple(rows))}
