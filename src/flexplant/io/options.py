"""Options of a format, checked once for all formats: by the names and the annotated kinds of its function's keywords."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexplant.errors import InputError, nearest
from flexplant.model.arrays import is_finite

# annotation -> what may be given; other kinds are looked at by the format itself
KINDS: dict[str, tuple[Callable[[object], bool], str]] = {
    "str": (lambda value: isinstance(value, str), "a text"),
    "str | Path": (lambda value: isinstance(value, (str, Path)), "a path"),
    "bool": (lambda value: isinstance(value, bool), "True or False"),
    "int": (lambda value: is_finite(value) and value % 1 == 0, "a whole number"),
    "float": (is_finite, "a finite number"),
}


class Written(str):
    """The value of an option as somebody wrote it on a command line: what kind it is, the format decides."""

    __slots__ = ()


def keywords(function: Callable[..., Any]) -> dict[str, str]:
    """Names and annotations of the options that a format's function has."""
    return {p.name: str(p.annotation) for p in inspect.signature(function).parameters.values() if p.kind is p.KEYWORD_ONLY}


def understood(function: Callable[..., Any], options: dict[str, Any]) -> dict[str, Any]:
    """The options with written values as the function's annotations want them; what cannot be understood stays a text."""
    kinds = {name: kind.removesuffix(" | None") for name, kind in keywords(function).items()}
    return {k: _value(v, kinds.get(k, "")) if isinstance(v, Written) else v for k, v in options.items()}


def _value(text: str, kind: str) -> Any:
    try:
        if kind in ("int", "float"):
            return int(text) if kind == "int" else float(text)
        if kind.endswith(("[int]", "[float, float, float]")):
            return [int(part) if kind.endswith("[int]") else float(part) for part in text.split(",")]
    except ValueError:
        return str(text)
    return text.lower() == "true" if kind == "bool" and text.lower() in ("true", "false") else str(text)


def check_options(function: Callable[..., Any], options: dict[str, Any], owner: str, hidden: str = "") -> None:
    """InputError for an option that the function has not, with the nearest it has, and for a value of another kind.

    hidden: a keyword that is no option.
    """
    known = keywords(function)
    known.pop(hidden, None)
    for option, value in options.items():
        if option not in known:
            raise InputError(f"{owner} has no option {option!r:.60}." + nearest(option, known))
        annotated = known[option]
        fits, wanted = KINDS.get(annotated.removesuffix(" | None"), (lambda _: True, ""))
        if not fits(value) and not (value is None and annotated.endswith("| None")):
            raise InputError(f"{owner}: {option} must be {wanted}, got {value!r:.60}")
