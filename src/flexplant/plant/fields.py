"""Checks shared by the plant types: channel names, and arrays whose shapes must fit together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flexplant.errors import ModelError
from flexplant.model.arrays import FloatArray, checked_matrix, dense, frozen, items_of


def checked_names(names: Sequence[str], what: str, owner: str) -> tuple[str, ...]:
    """Distinct channel names as a tuple; ModelError lists the repeated ones."""
    if isinstance(names, str):
        raise ModelError(f"{owner}: {what} must be a list of names, got the text {names!r:.60}; write [{names!r:.60}]")
    listed = items_of(names)
    if listed is None:
        raise ModelError(f"{owner}: {what} must be a list of names, got {type(names).__name__}")
    out = tuple(listed)
    if not all(isinstance(name, str) and name and name.isprintable() for name in out):
        raise ModelError(f"{owner}: {what} must be names, each a text in one line that is not empty, got {list(out)!r:.60}")
    if len(set(out)) < len(out):
        twice = sorted({name for name in out if out.count(name) > 1})
        raise ModelError(f"{owner}: {what} listed twice: {', '.join(twice[:8])}")
    return out


def checked_units(units: Sequence[str], count: int, what: str, owner: str) -> tuple[str, ...]:
    """One unit text a channel; nothing given means all empty."""
    given = items_of(units)
    if given is None or not all(isinstance(unit, str) and unit.isprintable() for unit in given):
        raise ModelError(f"{owner}: {what} must be a list of texts, one a channel, got {units!r:.60}")
    out = tuple(given) or ("",) * count
    if len(out) != count:
        raise ModelError(f"{owner}: {len(out)} {what} for {count} channels")
    return out


def check_mapping(given: Any, what: str) -> None:
    """ModelError for what is no mapping of names to values."""
    if not isinstance(given, Mapping):
        raise ModelError(f"{what} must be a mapping, got {type(given).__name__}")


def checked_dense(matrix: Any, shape: tuple[int | None, int | None], what: str) -> FloatArray:
    """A read-only finite (rows, columns) ndarray; ModelError names both shapes."""
    out = dense(checked_matrix(matrix, shape, what))
    out.setflags(write=False)
    return out


def checked_vector(values: Any, count: int | None, what: str) -> FloatArray:
    """A read-only finite vector that is nowhere negative; ModelError names the first bad entry."""
    out: FloatArray = frozen(values, what=what)
    if out.ndim != 1 or (count is not None and out.size != count):
        raise ModelError(f"{what} has shape {out.shape}, but ({'n' if count is None else count},) is needed")
    bad = np.flatnonzero(~np.isfinite(out) | (out < 0))
    if bad.size:
        raise ModelError(f"{what}: entry {bad[0]} (counted from 0) is {out[bad[0]]}; it must be finite and not negative")
    return out
