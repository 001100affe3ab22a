"""Tables as values: rows of text and numbers, and a text that reads well in a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """A titled table of text and numbers; `str(table)` aligns the columns."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]

    def __str__(self) -> str:
        return f"{self.title}\n{aligned([self.columns, *self.rows])}"


def cell(value: object) -> str:
    """Text of one table cell: numbers to 7 digits, the rest as it is."""
    if isinstance(value, bool) or not isinstance(value, (float, int)):
        return str(value)
    return f"{value:.7g}"


def aligned(rows: Sequence[Sequence[object]]) -> str:
    """Rows (the first is the heading) in aligned columns."""
    text = [[cell(v) for v in row] for row in rows]
    widths = [max(len(row[i]) for row in text) for i in range(len(text[0]))]
    lines = ["  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in text]
    rule = "-" * max(len(lines[0]), sum(widths) + 2 * (len(widths) - 1))
    return "\n".join([lines[0], rule, *lines[1:]])
