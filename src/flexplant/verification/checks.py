"""Check results as values: named numbers with limits, tables, and a text that reads well in a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flexplant.errors import CheckFailedError


@dataclass(frozen=True)
class Check:
    """One verified property: it passes where `value` keeps to `limit`; `explanation` says what it means and what to do."""

    name: str
    value: float
    limit: float
    passed: bool
    unit: str = ""
    explanation: str = ""


@dataclass(frozen=True)
class Table:
    """A titled table of text and numbers; `str(table)` aligns the columns."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]

    def __str__(self) -> str:
        return f"{self.title}\n{aligned([self.columns, *self.rows])}"


@dataclass(frozen=True)
class CheckReport:
    """Checks, tables, and notes on what could not be checked."""

    checks: tuple[Check, ...]
    tables: tuple[Table, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """True where every check passed."""
        return all(c.passed for c in self.checks)

    @property
    def failed(self) -> tuple[Check, ...]:
        """The checks that did not pass."""
        return tuple(c for c in self.checks if not c.passed)

    def __getitem__(self, name: str) -> Check:
        return next(c for c in self.checks if c.name == name)

    def raise_if_failed(self) -> None:
        """Raise CheckFailedError that lists every failed check with its explanation."""
        if self.failed:
            lines = [f"{c.name}: {c.value:.6g} {c.unit} (limit {c.limit:.6g}). {c.explanation}" for c in self.failed]
            raise CheckFailedError(f"{len(lines)} of {len(self.checks)} checks failed:\n  " + "\n  ".join(lines))

    def __str__(self) -> str:
        rows: list[Sequence[object]] = [("check", "value", "limit", "unit", "", "explanation")]
        rows += [(c.name, c.value, c.limit, c.unit, "ok" if c.passed else "FAILED", c.explanation) for c in self.checks]
        parts = [aligned(rows), *(str(t) for t in self.tables), *(f"Note: {n}" for n in self.notes)]
        return "\n\n".join(parts)


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
