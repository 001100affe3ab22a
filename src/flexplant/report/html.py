"""One self-contained HTML page from a `Report`: no file beside it, no request to anywhere."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, TypeAlias

import plotly.graph_objects as go
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from flexplant.errors import InputError
from flexplant.io.write.atomic import replacing
from flexplant.model.table import Table
from flexplant.report.cells import is_digest, number_columns, number_text
from flexplant.report.structure import StructureView
from flexplant.verification.checks import CheckReport


@dataclass(frozen=True, eq=False)
class Plot:
    """A figure with a caption in plain words."""

    figure: go.Figure
    caption: str = ""


@dataclass(frozen=True)
class Tile:
    """A key number at the top of the page; `passed` colours it."""

    label: str
    value: object
    unit: str = ""
    note: str = ""
    passed: bool | None = None


Item: TypeAlias = str | Plot | go.Figure | StructureView | Table | CheckReport


@dataclass(frozen=True, eq=False)
class Section:
    """A heading and, in reading order, what stands under it: paragraphs (str), plots, tables, checks, the 3-D view."""

    heading: str
    items: Sequence[Item] = ()
    anchor: str = ""


@dataclass(frozen=True, eq=False)
class Report:
    """Everything the page shows. All text is shown literally: markup in it is escaped.

    summary: paragraphs in plain words, at the top; checks: the overall verdict, shown with the summary (their details belong into
    a section); provenance: group -> name -> value (files and their hashes, versions, settings).
    """

    title: str
    summary: Sequence[str] = ()
    tiles: Sequence[Tile] = ()
    sections: Sequence[Section] = ()
    provenance: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    checks: CheckReport | None = None
    subtitle: str = ""


def render(report: Report) -> str:
    """The page as one HTML text; scripts, styles and data inside. Raises InputError for an item that cannot be shown."""
    environment = Environment(
        loader=PackageLoader("flexplant.report", "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(number_text=number_text, number_columns=number_columns, embedded=embedded_json)
    environment.tests["digest"] = is_digest
    return environment.get_template("report.html.j2").render(
        report=report,
        sections=_anchored(report.sections),
        style=_asset("report.css"),
        scripts=[Markup(get_plotlyjs()), _asset("viewer.js"), _asset("report.js")],
    )


def write_report(report: Report, path: str | Path) -> Path:
    """Write the page as UTF-8, whole or not at all; returns the path. Raises WriteError where it cannot be written."""
    page = render(report)
    with replacing(path) as work:
        # a file name may hold bytes that are no text; it must not cost the report
        work.write_bytes(page.encode("utf-8", errors="replace"))
    return Path(path)


def embedded_json(value: object) -> Markup:
    """JSON that is safe inside a <script> element: no character in it can end the element or open a comment."""
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=True, allow_nan=False)
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)


@dataclass(frozen=True)
class _Shown:
    """An item as the template wants it."""

    kind: Literal["text", "plot", "view", "table", "checks"]
    value: Any


def _anchored(sections: Sequence[Section]) -> list[dict[str, Any]]:
    """Sections with unique anchors and shown items."""
    taken: set[str] = {"summary", "provenance"}
    out = []
    for section in sections:
        anchor = next(name for name in _candidates(section.anchor or section.heading) if name not in taken)
        taken.add(anchor)
        out.append(
            {"heading": section.heading, "anchor": anchor, "items": [_shown(item, section.heading) for item in section.items]}
        )
    return out


def _candidates(text: str) -> Iterator[str]:
    slug = re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "section"
    yield slug
    number = 2
    while True:
        yield f"{slug}-{number}"
        number += 1


def _shown(item: Item, heading: str) -> _Shown:
    match item:
        case str():
            return _Shown("text", item)
        case go.Figure():
            return _Shown("plot", _plot(Plot(item)))
        case Plot():
            return _Shown("plot", _plot(item))
        case StructureView():
            return _Shown("view", item)
        case CheckReport():
            return _Shown("checks", item)
        case Table():
            return _Shown("table", item)
    raise InputError(
        f"report section {heading!r}: cannot show a {type(item).__name__}; give text, a figure, a table, checks or a view"
    )


def _plot(plot: Plot) -> dict[str, object]:
    height = plot.figure.layout.height or 420
    return {"json": plot.figure.to_json(), "height": int(height), "caption": plot.caption}


def _asset(name: str) -> Markup:
    """A file of the page, put in as it stands: it is ours."""
    return Markup((files("flexplant.report") / "page" / name).read_text(encoding="utf-8"))
