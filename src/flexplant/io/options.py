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


def check_options(function: Callable[..., Any], options: dict[str, Any], owner: str, hidden: str = "") -> None:
    """InputError for an option that the function has not, with the nearest it has, and for a value of another kind.

    hidden: a keyword that is no option.
    """
    keywords = {p.name: str(p.annotation) for p in inspect.signature(function).parameters.values() if p.kind is p.KEYWORD_ONLY}
    keywords.pop(hidden, None)
    for option, value in options.items():
        if option not in keywords:
            raise InputError(f"{owner} has no option {option!r:.60}." + nearest(option, keywords))
        annotated = keywords[option]
        fits, wanted = KINDS.get(annotated.removesuffix(" | None"), (lambda _: True, ""))
        if not fits(value) and not (value is None and annotated.endswith("| None")):
            raise InputError(f"{owner}: {option} must be {wanted}, got {value!r:.60}")
