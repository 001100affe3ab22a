"""Opening files that may be missing, empty or hostile; and where a model came from (provenance)."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from flexplant.errors import InputError, ReadError
from flexplant.model.units import UNSTATED

UNSTATED_NUMBERS = f"{UNSTATED}: numbers as in the file"  # units of a provenance that nobody stated
HEAD_BYTES = 4096  # what a format's sniff function sees


def as_path(path: str | Path) -> Path:
    """The path; InputError for what is no path at all."""
    try:
        return Path(path)
    except TypeError:
        raise InputError(f"a file's path is needed, text or pathlib.Path, got {type(path).__name__}") from None


def checked_file(path: str | Path) -> Path:
    """The path of an existing, non-empty, readable file; ReadError otherwise."""
    path = as_path(path)
    if not exists(path):
        raise ReadError(path, "no such file" + _beside(path))
    if path.is_dir():
        raise ReadError(path, "this is a folder; give a file in it")
    if path.stat().st_size == 0:
        raise ReadError(path, "the file is empty")
    return path


def exists(path: Path) -> bool:
    """Whether there is something at this path; ReadError for a path that the system refuses to look up."""
    try:
        return path.exists()
    except (OSError, ValueError) as error:  # a name too long, a NUL in it, no permission
        shown = f"{str(path)[:60]}..." if len(str(path)) > 300 else path
        raise ReadError(shown, f"cannot be looked up ({getattr(error, 'strerror', None) or error})") from None


def _beside(path: Path) -> str:
    if len(str(path)) > 300:
        return ""
    if not path.parent.is_dir():
        return f"; the folder {path.parent} does not exist"
    same = sorted(p.name for p in path.parent.iterdir() if p.stem == path.stem)[:8]
    return f"; beside it: {', '.join(same)}" if same else ""


def read_bytes(path: str | Path) -> bytes:
    """The whole content of a checked file."""
    path = checked_file(path)
    try:
        return path.read_bytes()
    except OSError as error:
        raise ReadError(path, f"cannot be read ({error.strerror})") from None


def one_line(text: object) -> str:
    """A text from an untrusted file or another library as one short printable line, for messages."""
    shown = " ".join(str(text).split())[:200]
    return "".join(c if c.isprintable() else "?" for c in shown)


def read_head(path: Path) -> bytes:
    """The first bytes of a checked file, for recognising its format."""
    try:
        with path.open("rb") as stream:
            return stream.read(HEAD_BYTES)
    except OSError as error:
        raise ReadError(path, f"cannot be read ({error.strerror})") from None


def sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a file's content."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def sibling(path: Path, suffix: str) -> Path | None:
    """The file beside `path` with the same stem and this suffix, in lower or upper case; None if there is none."""
    for candidate in (path.with_suffix(suffix), path.with_suffix(suffix.upper())):
        if candidate.is_file():
            return candidate
    return None


def provenance(path: Path, format_name: str, reader: str, others: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Where a model came from: path as given, SHA-256, format, reader, and the same of files read beside it."""
    out: dict[str, Any] = {"path": str(path), "sha256": sha256(path), "format": format_name, "reader": reader}
    if others:
        out["files"] = {str(other): sha256(other) for other in others}
    return out
