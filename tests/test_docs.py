"""What the documentation names exists, its Python runs, and its links lead somewhere."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("examples/*/*.md"), *ROOT.glob("benchmarks/*.md")])
NAMES = {page.name: sorted(set(re.findall(r"`(flexplant(?:\.\w+)+)", page.read_text(encoding="utf-8")))) for page in PAGES}


def resolve(name: str) -> object:
    """The object behind a dotted name: the longest importable module, then attributes."""
    parts = name.split(".")
    for split in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:split]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[split:]:
            found = getattr(found, attribute)
        return found
    raise ModuleNotFoundError(name)


@pytest.mark.parametrize(("page", "name"), [(page, name) for page, names in NAMES.items() for name in names])
def test_every_name_resolves(page: str, name: str):
    resolve(name)


def test_the_theory_names_functions():
    assert len(NAMES["theory.md"]) > 30


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_runs_and_links_lead_somewhere(page: Path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # what a page writes goes there
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#:\s]+)\)", text):
        assert (page.parent / target).exists(), target
    if page.name != "README.md" or page.parent != ROOT:  # its example has a test of its own
        names: dict[str, object] = {}
        for block in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
            exec(compile(block, str(page), "exec"), names)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_commands_it_shows_exist(page: Path):
    import typer

    from flexplant.cli import app

    known = set(typer.main.get_command(app).commands)
    shown = re.findall(r"(?:^    |`)flexplant ([a-z]+)", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert set(shown) <= known, set(shown) - known
