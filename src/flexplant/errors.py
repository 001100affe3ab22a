"""The exception types of flexplant: each message says what is wrong, with names and shapes, and what to do next."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from numbers import Integral
from pathlib import Path


class FlexplantError(Exception):
    """Base of every error that flexplant raises on purpose."""


class InputError(FlexplantError, ValueError):
    """An argument that cannot be used: wrong shape, unknown name, impossible value."""


class ModelError(InputError):
    """A model that contradicts itself: unsymmetric or NaN matrices, DOF that do not fit the matrices."""


class CouplingError(InputError):
    """Connections that cannot be made: missing or ambiguous nodes, contradictory constraints, clashing units."""


class DiagramError(InputError):
    """A block diagram that cannot run: unconnected ports, algebraic loops, unit kinds that clash."""


class StudyError(InputError):
    """A study file that cannot be used; the message gives the line and the allowed values."""


class ReadError(FlexplantError):
    """A file that cannot be read: names the file, and the record and byte offset where these are known."""

    def __init__(self, path: str | Path, problem: str, *, record: str | None = None, offset: int | None = None) -> None:
        where = str(path)
        if record is not None:
            where += f", record {record}"
        if offset is not None:
            where += f", byte {offset}"
        super().__init__(f"{where}: {problem}")
        self.path, self.record, self.offset = Path(path), record, offset


class WriteError(FlexplantError):
    """An output that cannot be written."""


class SolverError(FlexplantError):
    """A computation that did not reach its accuracy; the message says what to try next."""


class CheckFailedError(FlexplantError):
    """One or more checks of a `CheckReport` failed."""


class MissingExtraError(FlexplantError, ImportError):
    """An optional dependency is not installed; the message names the extra to install."""

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(f"this needs the package {package!r}: pip install 'flexplant[{extra}]'")


class PlausibilityWarning(UserWarning):
    """A file whose numbers are hardly those of a structure in the units that were given; nothing was changed."""


def expect(value: object, kind: type, what: str, remedy: str) -> None:
    """InputError unless `value` is a `kind`; `what` takes it, `remedy` says how one is made."""
    if not isinstance(value, kind):
        raise InputError(f"{what} takes a {kind.__name__}, got {type(value).__name__}; {remedy}")


def expect_count(value: object, what: str, *, least: int = 0) -> None:
    """InputError unless `value` is a whole number from `least`."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
        raise InputError(f"{what} must be a whole number from {least}, got {value!r:.60}")


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint such as " Did you mean 'bus.9001.1'?" (or the first few known names) for an unknown name."""
    known = list(known)
    close = difflib.get_close_matches(name, known, n=3, cutoff=0.6)
    if close:
        return " Did you mean " + " or ".join(repr(c) for c in close) + "?"
    shown = ", ".join(repr(k) for k in known[:8]) + (", ..." if len(known) > 8 else "")
    return f" Known: {shown}." if known else " There are none."
