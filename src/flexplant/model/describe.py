"""How the project's values show themselves at a prompt: a headline and a few lines, never their matrices."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

MOST = 8  # names listed before the rest is counted
WIDTH = 110  # characters of a listed line


def count(number: int, one: str, many: str | None = None) -> str:
    """ "1 mode", "3 modes"; `many` where the plural is irregular."""
    return f"{number} {one if number == 1 else many or one + 's'}"


def listed(items: Iterable[object]) -> str:
    """The first names, and how many more there are."""
    names = [str(item) for item in items]
    shown = names[:MOST]
    while len(shown) > 1 and len(", ".join(shown)) > WIDTH:
        shown.pop()
    rest = len(names) - len(shown)
    return ", ".join(shown) + (f" and {rest} more" if rest else "") if names else "none"


def channels(names: Iterable[str], units: Iterable[str]) -> str:
    """Channel names with their units where they have one."""
    return listed(f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True))


def dof_text(pairs: Iterable[tuple[int, int]]) -> str:
    """Nodes with their directions, "9001.123456, 9201.123"."""
    by_node: dict[int, str] = {}
    for node, direction in pairs:
        by_node[node] = by_node.get(node, "") + str(direction)
    return listed(f"{node}.{directions}" for node, directions in by_node.items())


def paragraph(headline: str, rows: Mapping[str, str]) -> str:
    """The headline, and an indented line for each row that has something to say."""
    wide = max((len(key) for key, text in rows.items() if text), default=0)
    return "\n".join([headline, *(f"  {key:<{wide}}  {text}" for key, text in rows.items() if text)])
