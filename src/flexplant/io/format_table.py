"""The table of formats for the documentation, generated from the registry."""

from __future__ import annotations

from pathlib import Path

from flexplant.errors import InputError
from flexplant.io.output import writers
from flexplant.io.registry import formats

BEGIN, END = "<!-- table of formats: begin", "<!-- table of formats: end"
READS = {"read_component": "component", "read_model": "model", "read_geometry": "geometry"}
WRITES = {"write_component": "component", "write_model": "model", "write_plant": "plant", "write_results": "results"}


def markdown() -> str:
    """A Markdown table: name, what the format is, what is read and written, and what it was tested against."""
    readable, writable = formats(), writers()
    lines = ["| format | what it is | reads | writes | tested against |", "|---|---|---|---|---|"]
    for name in sorted(readable | writable):
        reader, writer = readable.get(name), writable.get(name)
        description = (reader or writer).description  # type: ignore[union-attr]
        able = [] if reader is None else [word for key, word in READS.items() if key in reader.readers]
        reads = ", ".join(able + ["plant"] * name.startswith("flexplant"))
        writes = "" if writer is None else ", ".join(word for key, word in WRITES.items() if key in writer.writers)
        against = "; ".join(dict.fromkeys(f.tested_against for f in (reader, writer) if f is not None and f.tested_against))
        lines.append(f"| `{name}` | {description} | {reads or '-'} | {writes or '-'} | {against or '-'} |")
    return "\n".join(lines) + "\n"


def update(page: str | Path) -> None:
    """Put the current table between the markers of a page; InputError where they are not there."""
    page = Path(page)
    before, begin, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not end:
        raise InputError(f"{page} has no lines {BEGIN!r} ... and {END!r}")
    head = rest.split("\n", 1)[0]
    page.write_text(f"{before}{begin}{head}\n\n{markdown()}\n{end}{after}", encoding="utf-8")
