"""What a file format is to the registry: a name, a way to recognise it, and what it can read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Format:
    """A readable format.

    sniff(head, path): whether a file with these first bytes is of this format; must be quick and must not raise.
    read_component(path, **options) -> Component, read_model -> FiniteElementModel, read_geometry and
    read_display_mesh -> DisplayMesh; None where the format has none. A reader puts provenance into `source`, and the
    unit system that the file itself states into source["units"]; the registry converts.
    suffixes: tried in this order when a path without suffix is given. tested_against: for the table of formats.
    """

    name: str
    description: str
    sniff: Callable[[bytes, Path], bool]
    suffixes: tuple[str, ...] = ()
    tested_against: str = ""
    readers: dict[str, Callable[..., Any]] = field(default_factory=dict)


EXTRAS = ("recovery", "recovery rates", "interior", "structural_damping")  # of a component, beside what every format holds


def _alone(_: Path) -> tuple[Path, ...]:
    return ()


@dataclass(frozen=True, kw_only=True)
class Writer:
    """A writable format: write_component, write_model, write_plant, write_results, each (value, path) -> None.

    The path a writer gets is a temporary one; the registry puts the finished file in its place. Keyword-only parameters of
    a writer are options of the format, except `target`: the path where the file will be. tested_against: for the table.
    holds: those of `EXTRAS` that a component keeps in this format ("recovery" alone: displacement rows only).
    beside: the files that a target brings with it. written_as: what a file says we wrote it as (`io.write.ownership`), None for
    the general rule. apart: endings of files that, with the same stem, would take the target for a part of theirs.
    """

    name: str
    description: str
    suffixes: tuple[str, ...]
    writers: dict[str, Callable[..., None]]
    tested_against: str = ""
    holds: frozenset[str] = frozenset()
    beside: Callable[[Path], tuple[Path, ...]] = _alone
    written_as: Callable[[Path], str] | None = None
    apart: tuple[str, ...] = ()
