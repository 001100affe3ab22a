"""Whose file is it: what we write says so, so that nothing else is ever replaced without being asked.

Text files say "written by flexplant as <format>" in a comment near their top, MATLAB files in their header, NetCDF in an
attribute; an FMU names its tool, and our own files have their header. A rewritten script finds its own files and goes on.
"""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from flexplant.errors import WriteError
from flexplant.io.formats import Writer
from flexplant.io.parse.files import as_path, read_head
from flexplant.io.parse.h5 import SIGNATURE, attribute_of, header_of
from flexplant.io.parse.names import WRITTEN_BY
from flexplant.io.parse.npz import BROKEN

OWN_HEADER = "flexplant"  # the array that holds the JSON header of our own files
PHRASE = re.compile(rb"(?i)written by flexplant as (\w+)")
OWN_KINDS = {
    "write_component": {"component"},
    "write_model": {"model"},
    "write_plant": {"modal_plant", "state_space", "descriptor"},
    "write_system": {"system"},
}


def mark(format_name: str) -> str:
    """What a file of ours says about itself."""
    return f"written by flexplant as {format_name}"


def written_as(path: Path) -> str:
    """The format (or, of our own files, the kind: "component", ...) that a file says we wrote it as; "" for any other file."""
    head = read_head(path)
    if head.startswith(b"PK"):
        return _in_zip(path)
    if head.startswith(SIGNATURE):
        return _kind(header_of(path, OWN_HEADER)) or _phrase(attribute_of(path, WRITTEN_BY).encode())
    return _phrase(head)


def _phrase(text: bytes) -> str:
    found = PHRASE.search(text)
    return found[1].decode() if found else ""


def _kind(header: str | None) -> str:
    try:
        return str(json.loads(header or "{}").get("kind", ""))
    except (ValueError, AttributeError, RecursionError):
        return ""


def _in_zip(path: Path) -> str:
    """Of an archive: the kind in our own header, or "fmu" where the model description names us as its tool."""
    import numpy as np

    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            if "modelDescription.xml" in names:
                return "fmu" if b'generationTool="flexplant"' in archive.read("modelDescription.xml") else ""
            if f"{OWN_HEADER}.npy" not in names:
                return ""
            with archive.open(f"{OWN_HEADER}.npy") as stream:
                return _kind(str(np.lib.format.read_array(stream, allow_pickle=False)))
    except BROKEN:
        return ""


def files_of(value: Any) -> list[Path]:
    """The files that a component or model was read from."""
    source = getattr(value, "source", {})
    others = source.get("files", ()) if isinstance(source, Mapping) else ()
    first = source.get("path") if isinstance(source, Mapping) else None
    return [Path(p) for p in (first, *(others if isinstance(others, Mapping) else ())) if isinstance(p, str)]


def is_file(path: Path) -> bool:
    """Whether a file is there; False for a path that the system refuses to look up, which opening it will tell."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _either_case(target: Path, ending: str) -> tuple[Path, Path]:
    return target.with_suffix(ending), target.with_suffix(ending.upper())


def check_replaced(writer: Writer, what: str, target: Path, sources: Iterable[str | Path], overwrite: bool) -> None:
    """WriteError where writing would replace a file of the sources, or (unless overwrite) one that is not ours of this kind."""
    files = [file for file in (target, *writer.beside(target)) if is_file(file)]
    read = [as_path(source) for source in sources]
    for file in files:
        if any(is_file(source) and source.samefile(file) for source in read):
            raise WriteError(f"{file} belongs to the source of what is to be written, and is never replaced; name another target")
    if overwrite:
        return
    partner = next((p for ending in writer.apart for p in _either_case(target, ending) if is_file(p)), None)
    if partner is not None:
        text = f"{target.name!r} and {partner.name}, which stands there, would be taken for parts of one model"
        raise WriteError(f"{text}; name another target, or pass overwrite=True (--force)")
    expected = {writer.name, *OWN_KINDS.get(what, ())}
    for file in files:
        if (writer.written_as or written_as)(file) not in expected:
            text = f"{file} exists, and is not a file that this writes ({writer.name}, {what.removeprefix('write_')})"
            raise WriteError(f"{text}; name another target, or pass overwrite=True (--force) to replace it")
