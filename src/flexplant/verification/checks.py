"""Check results as values: named numbers with limits, tables, and a text that reads well in a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flexplant.errors import CheckFailedError, InputError, expect, nearest
from flexplant.model.arrays import checked_switch, is_number, items_of
from flexplant.model.table import Table, aligned


@dataclass(frozen=True)
class Check:
    """One verified property: it passes where `value` keeps to `limit`; `explanation` says what it means and what to do."""

    name: str
    value: float
    limit: float
    passed: bool
    unit: str = ""
    explanation: str = ""

    def __post_init__(self) -> None:
        for kind in ("name", "unit", "explanation"):
            expect(getattr(self, kind), str, f"check: {kind}", "write a text")
        for kind in ("value", "limit"):
            if not is_number(getattr(self, kind)):
                raise InputError(f"check {self.name!r}: {kind} must be a number, got {getattr(self, kind)!r:.60}")
        checked_switch(self.passed, f"check {self.name!r}: passed")


@dataclass(frozen=True)
class CheckReport:
    """Checks, tables, and notes on what could not be checked."""

    checks: tuple[Check, ...]
    tables: tuple[Table, ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for field, kind in (("checks", Check), ("tables", Table), ("notes", str)):
            listed = items_of(getattr(self, field))
            if listed is None or not all(isinstance(item, kind) for item in listed):
                raise InputError(f"check report: {field} must be a list of {kind.__name__}, got {getattr(self, field)!r:.60}")
            object.__setattr__(self, field, tuple(listed))

    @property
    def passed(self) -> bool:
        """True where every check passed."""
        return all(c.passed for c in self.checks)

    @property
    def failed(self) -> tuple[Check, ...]:
        """The checks that did not pass."""
        return tuple(c for c in self.checks if not c.passed)

    def __getitem__(self, name: str) -> Check:
        for check in self.checks:
            if isinstance(name, str) and check.name == name:
                return check
        raise InputError(f"there is no check {name!r:.60}." + nearest(name, [c.name for c in self.checks]))

    def raise_if_failed(self) -> None:
        """Raise CheckFailedError that lists every failed check with its explanation."""
        if self.failed:
            lines = [f"{c.name}: {c.value:.6g} {c.unit} (limit {c.limit:.6g}). {c.explanation}" for c in self.failed]
            raise CheckFailedError(f"{len(lines)} of {len(self.checks)} checks failed:", *(f"  {line}" for line in lines))

    def __str__(self) -> str:
        rows: list[Sequence[object]] = [("check", "value", "limit", "unit", "", "explanation")]
        rows += [(c.name, c.value, c.limit, c.unit, "ok" if c.passed else "FAILED", c.explanation) for c in self.checks]
        parts = [aligned(rows), *(str(t) for t in self.tables), *(f"Note: {n}" for n in self.notes)]
        return "\n\n".join(parts)
