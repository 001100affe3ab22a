"""The study file's own documentation, made from the schema: JSON schema for editors, reference page, starter file."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from flexplant.study.schema import StudySpec

STARTER = """\
# A flexplant study. Paths are relative to this file. Every key: docs/study-file.md or `flexplant schema --markdown`.
title: My structure

components:                       # name: its file and what the file does not say
  bus:
    file: bus.op4                 # Nastran .op4 + .asm + .pch, MYSTRAN .OU1, .npz, .mat, .h5 ...
    units: SI                     # or mm-tonne-s, mm-kg-s, inch-slinch-s, inch-lbf, ft-slug-s, {length_m: 1.0e-3, mass_kg: 1.0}
  optic:
    file: optic.op4
    units: SI
    # damping: 0.005              # of this component's modes (equation 4): a value, one a mode, or [[Hz, ratio], ...]
    # placement: {translation: [0, 0, 1.65]}
    # a whole finite-element model is reduced first; docs/reduction.md has the methods (craig_bampton, rubin, guyan):
    # reduce: {boundary: [["3-6", "123456"]], max_frequency_hz: 300, accuracy: 1.0e-6}

connections:
  - {a: bus, b: optic, nodes: [3, 11, 19, 27]}          # the same node ids on both sides, all six directions
  # - {a: bus, b: optic, pairs: [[3, 103], [11, 111]], directions: "123"}
  # - {a: bus, b: optic, pairs: by position, tolerance_m: 1.0e-4}

# ground: [{component: bus, nodes: [3]}]
method: dual                      # or primal: the same physics with the constraints eliminated
damping: {ratio: 0.005}           # of the coupled modes; a choice of this study, there is no default

verification:
  rigid_body_modes: 6             # of a free-free structure

plant:
  inputs: [bus.3.123456]          # component.node.directions
  outputs: [optic.11.12]          # ... with :v or :a for velocity or acceleration, or component.recovery.label
  max_frequency_hz: 300
  static_correction: true         # of the modes above

response: {from_hz: 1, to_hz: 500, points: 600}

# export: [{to: c, dt_s: 1.0e-4}, {to: fmu, fmi: 3}]   # the plant for other programs: C99, FMU, m, jl, h5

# line_of_sight:                  # a wheel shakes a lens, a steering mirror holds the spot
#   wheel: {node: bus.3, amplitude: 5.0e-6, harmonics: [1, 2, 3], phases_deg: [0, 90, 0, 0, 90, 0], speeds_hz: [20]}
#   optics: {x: optic.11.1, y: optic.11.2, focal_length_m: 1.5, mirror_omega_rad_s: 100, mirror_zeta: 0.3}
#   controller: {proportional_gain: [1800, 1800]}
#   time: {duration_s: 1.0, step_s: 1.0e-4}
#   sweep: {from_hz: 5, to_hz: 100}
"""


def json_schema() -> str:
    """JSON schema (draft 2020-12) of the study file, for editors."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **StudySpec.model_json_schema()}
    return json.dumps(schema, indent=1, sort_keys=True) + "\n"


def markdown() -> str:
    """The reference page: every section and key with type, default and meaning."""
    schema = StudySpec.model_json_schema()
    parts = [INTRODUCTION, *_section("The study", schema)]
    for name, section in schema["$defs"].items():
        parts += _section(name, section)
    return "\n".join(parts) + "\n"


INTRODUCTION = """\
# The study file

A study is a YAML file: components, how they are joined, what is asked of the coupled structure.
`flexplant new` writes a commented starter, `flexplant run STUDY.yaml -o OUT` runs it, and every mistake is reported with its
line and what is allowed there. Paths are relative to the study's folder and may not leave it (`--allow-outside` lifts that).
Point your editor at `docs/study.schema.json` (in VS Code: `# yaml-language-server: $schema=study.schema.json` as the first
line) to have keys completed and checked while you type.

This page is made from the schema by `flexplant schema --markdown`.
"""


def _section(name: str, section: Mapping[str, Any]) -> Iterator[str]:
    yield f"## {name}\n\n{section['description'].strip()}\n"
    yield "| key | type | default | meaning |\n|---|---|---|---|"
    required = section.get("required", [])
    for key, field in section["properties"].items():
        default = "required" if key in required else _default(field)
        yield f"| `{key}` | {_type(field)} | {default} | {field.get('description', '')} |"
    yield ""


def _default(field: Mapping[str, Any]) -> str:
    value = field.get("default")
    if value is None:
        return ""
    return "see its section" if isinstance(value, dict) else f"`{json.dumps(value)}`"


def _type(field: Mapping[str, Any]) -> str:
    """Plain words for a JSON schema type."""
    if "$ref" in field:
        name = field["$ref"].rsplit("/", 1)[-1]
        return f"[{name}](#{name.lower()})"
    if "anyOf" in field:
        return " or ".join(_type(part) for part in field["anyOf"] if part.get("type") != "null")
    if "enum" in field or "const" in field:
        return " or ".join(f"`{value}`" for value in field.get("enum", [field.get("const")]))
    if field.get("type") == "array":
        return "list of " + _type(field["items"]) if "items" in field else f"{len(field['prefixItems'])} values"
    if field.get("type") == "object":
        return "mapping of names to " + _type(field["additionalProperties"])
    return {"string": "text", "boolean": "true or false", "integer": "whole number"}.get(field["type"], "number")
