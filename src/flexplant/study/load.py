"""Reading a study file: YAML with line numbers, checked against the schema, errors that name line and allowed values."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from flexplant.errors import InputError, SolverError, StudyError, nearest
from flexplant.io.parse.files import as_path
from flexplant.study.schema import StudySpec

MAX_BYTES, MAX_VALUES = 1_000_000, 50_000  # a study is small; this stops alias bombs and wrong files
MAX_PROBLEMS = 12
Place = tuple[str | int, ...]


def load_study(path: str | Path, *, allow_outside: bool = False) -> StudySpec:
    """The checked study of a YAML file.

    Files that it names must exist in the study's folder, or anywhere with `allow_outside`. Raises StudyError with one line a
    problem: the file, the line, the key, what is wrong and what is allowed.
    """
    path = as_path(path)
    data, lines = _read_yaml(path)
    if not isinstance(data, dict):
        raise StudyError(f"{path}: a study file has keys such as title, components, plant; 'flexplant new' writes one")
    try:
        study = StudySpec.model_validate(data, context={"folder": path.parent, "allow_outside": allow_outside})
        problems = list(_unknown_components(study))
    except ValidationError as error:
        problems = list(_problems(error, data))
    if problems:
        told = sorted((_line(lines, place), text) for place, text in problems)
        raise StudyError(*(f"{path}, line {line}: {text}" for line, text in told[:MAX_PROBLEMS]))
    return study


@contextmanager
def lines_of(path: Path) -> Iterator[None]:
    """Errors inside that begin with a key of the study file, "components.bus.reduce: ...", are told with its line."""
    try:
        yield
    except (InputError, SolverError) as error:
        text = str(error)
        key = re.match(r"((?:components|connections)\.[^\s:]+)[:\s]", text)
        if key is None:
            raise
        place = tuple(int(part) if part.isdecimal() else part for part in key[1].split("."))
        raise type(error)(f"{path}, line {_line(_read_yaml(path)[1], place)}: {text}") from None


def _unknown_components(study: StudySpec) -> Iterator[tuple[Place, str]]:
    """Names of components that the study does not have, where connections, ground and plant use them."""
    used: list[tuple[Place, str]] = []
    for i, connection in enumerate(study.connections):
        used += [(("connections", i, "a"), connection.a), (("connections", i, "b"), connection.b)]
    used += [(("ground", i, "component"), ground.component) for i, ground in enumerate(study.ground)]
    used += [(("plant", "inputs", i), channel.partition(".")[0]) for i, channel in enumerate(study.plant.inputs)]
    for place, name in used:
        if name not in study.components:
            yield place, f"{'.'.join(map(str, place))}: the study has no component {name!r}.{nearest(name, study.components)}"


def _read_yaml(path: Path) -> tuple[Any, dict[Place, int]]:
    """Plain values and the line (from 1) of every key and item."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise StudyError(f"{path}: cannot read the study file ({error.strerror})") from None
    if len(raw) > MAX_BYTES:
        raise StudyError(f"{path}: {len(raw)} bytes is too large for a study file; is this the right file?")
    try:
        text = raw.decode("utf-8")
        yaml = YAML(typ="safe", pure=True)
        root = yaml.compose(text)
    except UnicodeDecodeError:
        raise StudyError(f"{path}: not a text file (UTF-8); is this the right file?") from None
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark else ""
        raise StudyError(f"{path}{line}: not valid YAML: {error.problem or error.context}") from None
    except (YAMLError, RecursionError) as error:
        raise StudyError(f"{path}: not valid YAML: {str(error).splitlines()[0]}") from None
    lines: dict[Place, int] = {}
    return (None if root is None else _plain(root, (), lines, path)), lines


def _plain(node: Node, place: Place, lines: dict[Place, int], path: Path) -> Any:
    lines.setdefault(place, node.start_mark.line + 1)
    if len(lines) > MAX_VALUES or len(place) > 40:
        raise StudyError(f"{path}: more than {MAX_VALUES} values or too deeply nested; is this the right file?")
    if isinstance(node, ScalarNode):
        return _scalar(node, path)
    if not str(node.tag).endswith((":seq", ":map")):
        raise _tag_error(node, path)
    if isinstance(node, SequenceNode):
        return [_plain(child, (*place, i), lines, path) for i, child in enumerate(node.value)]
    assert isinstance(node, MappingNode)
    out: dict[str, Any] = {}
    for key_node, value in node.value:
        key, line = str(key_node.value), key_node.start_mark.line + 1
        if key in out:
            raise StudyError(f"{path}, line {line}: key {key!r} is given twice (first in line {lines[(*place, key)]})")
        lines[(*place, key)] = line
        out[key] = _plain(value, (*place, key), lines, path)
    return out


def _scalar(node: ScalarNode, path: Path) -> Any:
    """Text, number, truth value or nothing; anything else that YAML knows (dates, tags) is text or an error."""
    kind, text = str(node.tag).rsplit(":", 1)[-1], node.value
    try:
        if kind == "int":
            return int(text.replace("_", ""), 0)
        if kind == "float":
            return float(text.replace("_", "").replace(".inf", "inf").replace(".nan", "nan").replace(".NaN", "nan"))
    except ValueError:
        return text
    if kind in {"bool", "null"}:
        return None if kind == "null" else text.lower() == "true"
    if kind in {"str", "timestamp"}:
        return _number_or_text(node)
    raise _tag_error(node, path)


def _tag_error(node: Node, path: Path) -> StudyError:
    return StudyError(f"{path}, line {node.start_mark.line + 1}: tag {node.tag} is not allowed in a study file")


def _number_or_text(node: ScalarNode) -> Any:
    """Plain 5e-6 is a number to an engineer, although YAML wants 5.0e-6; quoted text stays text."""
    if node.style is None and any(c.isdigit() for c in node.value):
        try:
            return float(node.value)
        except ValueError:
            pass
    return node.value


def _line(lines: Mapping[Place, int], place: Place) -> int:
    """Line of the deepest part of the place that is in the file."""
    while place not in lines:
        place = place[:-1]
    return lines[place]


def _problems(error: ValidationError, data: Any) -> Iterator[tuple[Place, str]]:
    """One text a place; the many errors of a value that may be several things are one."""
    seen: set[Place] = set()
    schema = _schema()
    items = error.errors(include_url=False)
    misspelt = {(*item["loc"][:-1], _guess(item["loc"], schema)) for item in items if item["type"] == "extra_forbidden"}
    for item in items:
        place, whole = _in_file(item["loc"], data)
        if (place in seen and not whole) or (item["type"] == "missing" and item["loc"] in misspelt):
            continue
        seen.add(place)
        name = ".".join(str(p) for p in place) or "study"
        yield place, _text(item, name, place, whole, schema)


@cache
def _schema() -> Mapping[str, Any]:
    return StudySpec.model_json_schema()


def _in_file(loc: Place, data: Any) -> tuple[Place, bool]:
    """The part of pydantic's location that exists in the file, and whether that is all of it."""
    place: list[str | int] = []
    for key in loc:
        inside = key in data if isinstance(data, dict) else isinstance(data, list) and key in range(len(data))
        if not inside:
            return tuple(place), False
        data = data[key]
        place.append(key)
    return tuple(place), True


def _text(item: Any, name: str, place: Place, whole: bool, schema: Mapping[str, Any]) -> str:
    allowed = _schema_at(schema, place[:-1] if item["type"] == "extra_forbidden" else place)
    if item["type"] == "extra_forbidden":
        known = list(allowed.get("properties", {}))
        guess = _guess(place, schema)
        hint = f"did you mean {guess!r}? " if guess else ""
        return f"unknown key {name!r}; {hint}allowed here: {', '.join(known)}"
    if item["type"] == "missing":
        return f"{name}: the key {item['loc'][-1]!r} is missing ({_described(_schema_at(schema, item['loc']))})"
    message = str(item["msg"]).removeprefix("Value error, ")
    message = message[:1].lower() + message[1:]
    if item["type"] == "literal_error":
        return f"{name}: {item['input']!r} is not allowed; {message}"
    around = (_described(_schema_at(schema, place[: len(place) - up])) for up in (1, 2))  # of a list's item, and of its items
    expected = _described(allowed) or next(filter(None, around), "")
    hint = f"; expected: {expected}" if expected and item["type"] != "value_error" else ""
    return f"{name}: {message if whole else 'not a possible value'}{hint}"


def _guess(place: Place, schema: Mapping[str, Any]) -> str:
    """The allowed key that an unknown one was probably meant to be, or nothing."""
    known = _schema_at(schema, place[:-1]).get("properties", {})
    return next(iter(difflib.get_close_matches(str(place[-1]), known, n=1)), "")


def _described(schema: Mapping[str, Any]) -> str:
    return str(schema.get("description", "")).strip()


def _schema_at(schema: Mapping[str, Any], place: Sequence[str | int]) -> Mapping[str, Any]:
    """The part of the JSON schema that a place of the file has to obey (empty if unknown)."""
    definitions, here = schema["$defs"], schema
    for key in place:
        here = _resolved(here, definitions)
        if isinstance(key, int):
            here = here.get("items", {})
        else:
            here = here.get("properties", {}).get(key) or here.get("additionalProperties") or {}
        if not isinstance(here, Mapping):
            return {}
    own = _described(here)
    resolved = _resolved(here, definitions)
    return {**resolved, "description": own} if own else resolved


def _resolved(schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> Mapping[str, Any]:
    """The schema with its reference followed; of "a section or nothing", the section."""
    for part in (schema, *schema.get("allOf", []), *schema.get("anyOf", [])):
        if "$ref" in part:
            target: Mapping[str, Any] = definitions[part["$ref"].rsplit("/", 1)[-1]]
            return target
        if part.get("type") == "array" and part is not schema:
            return {**part, "anyOf": schema["anyOf"]}
    return schema
