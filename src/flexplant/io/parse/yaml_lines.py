"""YAML that remembers on which line each key stands; plain data only."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from flexplant.errors import ReadError, nearest
from flexplant.io.parse.files import one_line, read_bytes

LARGEST_YAML = 16 * 10**6


@dataclass(frozen=True)
class LinedYaml:
    """A YAML mapping and the line (from 1) of each key, by its path of keys."""

    path: Path
    data: dict[str, Any]
    lines: dict[tuple[str, ...], int] = field(default_factory=dict)

    def fail(self, problem: str, *keys: str) -> NoReturn:
        """Raise ReadError at the line of a key (or of the nearest key above it)."""
        while keys and keys not in self.lines:
            keys = keys[:-1]
        raise ReadError(self.path, problem, record=f"line {self.lines[keys]}" if keys else None)

    def check_keys(self, mapping: Any, allowed: tuple[str, ...], *at: str) -> dict[str, Any]:
        """A mapping with only these keys; errors name the line and the nearest allowed key."""
        if not isinstance(mapping, dict):
            self.fail(f"{'.'.join(at) or 'the file'} must be a mapping with keys {', '.join(allowed)}", *at)
        for key in mapping:
            if key not in allowed:
                where = f" in {'.'.join(at)}" if at else ""
                self.fail(f"unknown key {key!r}{where}." + nearest(str(key), allowed), *at, str(key))
        return mapping


def read_yaml(path: str | Path) -> LinedYaml:
    """A YAML mapping from a file; ReadError with the line for anything that is not YAML, or no mapping."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError
    from ruamel.yaml.events import AliasEvent

    path = Path(path)
    content = read_bytes(path)
    if len(content) > LARGEST_YAML:
        raise ReadError(path, f"is {len(content)} bytes long; more than {LARGEST_YAML} is no description of a model")
    try:
        text = content.decode("utf-8")
        node = YAML(typ="safe", pure=True).compose(text)
        if any(isinstance(event, AliasEvent) for event in YAML(typ="safe", pure=True).parse(text)):
            raise ReadError(path, "uses an alias (*name); write the value out")  # nested aliases blow up
        data = YAML(typ="safe", pure=True).load(text)
    except (YAMLError, UnicodeDecodeError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or str(error)
        raise ReadError(path, f"is not YAML: {one_line(problem)}", record=f"line {mark.line + 1}" if mark else None) from None
    if not isinstance(data, dict):
        raise ReadError(path, "must be a YAML mapping (key: value)")
    return LinedYaml(path, data, _lines(node))


def _lines(node: Any) -> dict[tuple[str, ...], int]:
    """Lines of the keys of the mapping and of the mappings directly in it."""
    out: dict[tuple[str, ...], int] = {}
    for key, value in node.value:
        out[(str(key.value),)] = key.start_mark.line + 1
        if hasattr(value, "value") and type(value).__name__ == "MappingNode":
            out |= {(str(key.value), str(k.value)): k.start_mark.line + 1 for k, _ in value.value}
    return out
