"""The exception types of flexplant: each message says what is wrong, with names and shapes, and what to do next."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Iterable
from numbers import Integral
from pathlib import Path

LONGEST, END = 400, 130  # characters of a message, and how many of them are its end, where the next thing to try stands


class FlexplantError(Exception):
    """Base of every error that flexplant raises on purpose.

    Its message is one line (several findings are a line each), and the middle of a line is left out where what the user gave,
    and is told again, is very long.
    """

    def __init__(self, *lines: object) -> None:
        super().__init__(*(_bounded(str(line)) for line in lines))

    def __str__(self) -> str:
        return "\n".join(self.args)


def _bounded(text: str) -> str:
    if "\n" in text or "\r" in text:
        text = " ".join(text.split())
    return text if len(text) <= LONGEST else f"{text[: LONGEST - END - 5]} ... {text[-END:]}"


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


class LeftOutWarning(UserWarning):
    """A result that lacks a part which its form cannot hold; the message names it, and the form that holds it."""


def expect(value: object, kind: type, what: str, remedy: str) -> None:
    """InputError unless `value` is a `kind`; `what` takes it, `remedy` says how one is made."""
    if not isinstance(value, kind):
        raise InputError(f"{what} takes a {kind.__name__}, got {type(value).__name__}; {remedy}")


def expect_count(value: object, what: str, *, least: int = 0, most: int = sys.maxsize) -> None:
    """InputError unless `value` is a whole number from `least` to `most`."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not least <= int(value) <= most:
        limit = f" to {most}" if most < sys.maxsize else ""
        raise InputError(f"{what} must be a whole number from {least}{limit}, got {value!r:.60}")


def expect_choice(value: object, choices: Iterable[str], what: str) -> None:
    """InputError with the nearest of the words unless `value` is one of them."""
    if not isinstance(value, str) or value not in choices:
        raise InputError(f"{what}={value!r:.60} is not a choice." + nearest(value, choices))


def expect_text(value: object, what: str, *, empty: bool = False) -> None:
    """InputError unless `value` is a text in one line, not empty unless that is allowed."""
    if not isinstance(value, str) or not value.isprintable() or not (value or empty):
        raise InputError(f"{what} must be a text in one line{'' if empty else ', not empty'}, got {value!r:.60}")


def expect_function(value: object, what: str, arguments: str) -> None:
    """InputError unless `value` can be called, with these arguments, or is None."""
    if not (value is None or callable(value)):
        raise InputError(f"{what} must be a function of ({arguments}), or None, got {value!r:.60}")


def nearest(name: object, known: Iterable[str]) -> str:
    """A hint such as " Did you mean 'bus.9001.1'?" (or the first few known names) for an unknown name."""
    known = list(known)
    close = difflib.get_close_matches(name[:200], known, n=3, cutoff=0.6) if isinstance(name, str) else []
    if close:
        return " Did you mean " + " or ".join(repr(c) for c in close) + "?"
    shown = ", ".join(repr(k) for k in known[:8]) + (", ..." if len(known) > 8 else "")
    return f" Known: {shown}." if known else " There are none."
