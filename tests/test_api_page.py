"""docs/api.md is what the package says of itself, whole."""

from __future__ import annotations

import re
from pathlib import Path

import flexplant as fp
from flexplant.cli.api_page import ROOMS, markdown

DOCS = Path(__file__).parents[1] / "docs"


def test_the_page_is_current_and_has_every_public_name_once() -> None:
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    assert text == markdown(), "refresh it with: python -m flexplant.cli.api_page > docs/api.md"
    entries = re.findall(r"^### (\w+)\n\n    \1[:(].*(?:\n    .*)*\n\n(.*)\n", text, flags=re.MULTILINE)
    assert sorted(name for name, _ in entries) == sorted(set(fp.__all__) - {"__version__"})
    assert all(sentence.endswith(".") for _, sentence in entries), [n for n, s in entries if not s.endswith(".")]
    assert not re.search(r"<\w+[> ]", text), "a default or a type that is no Python text"
    assert not {title.lower() for title in ROOMS.values()} & {name.lower() for name, _ in entries}, "one anchor twice"
    assert "](api.md)" in (DOCS / "guide.md").read_text(encoding="utf-8")
