"""Files that belong together by their names: the mass beside the stiffness, the nodes beside both."""

from __future__ import annotations

import re
from pathlib import Path

from flexplant.errors import ReadError


def partner(path: Path, given: str | Path | None, word: str, other: str, what: str) -> Path:
    """The file that was given, or the one whose name has `other` in place of `word`; ReadError says which was looked for."""
    if given is not None:
        return Path(given)
    found = maybe_partner(path, word, other)
    if found is None:
        name = _replaced(path.name, word, other)
        looked = f"; {name} is not beside it" if name else f" ({word!r} is not in its name)"
        raise ReadError(path, f"the {what} is another file{looked}; pass {what}=")
    return found


def maybe_partner(path: Path, word: str, other: str) -> Path | None:
    """The file beside `path` whose name has `other` in place of `word` (upper or lower case), or None."""
    name = _replaced(path.name, word, other)
    if not name:
        return None
    folder = path.parent
    wanted = name.lower()
    exact = folder / name
    return exact if exact.is_file() else next((p for p in sorted(folder.iterdir()) if p.name.lower() == wanted), None)


def _replaced(name: str, word: str, other: str) -> str | None:
    at = [m.start() for m in re.finditer(re.escape(word), name, re.IGNORECASE)]
    return name[: at[-1]] + other + name[at[-1] + len(word) :] if at else None
