"""The sidecar: a small YAML file that says what plain matrices mean.

name: bus
matrices: {mass: MXX, stiffness: KXX}      # optional: damping
boundary: [[9001, "123456"], ...]          # component: the first rows; all further rows are modal
dofs: [[1, 1], ...]                        # finite-element model: every row
modal: 360                                 # optional: how many modal rows there must be
nodes: [[9001, x, y, z], ...]
frames: {9001: [[..],[..],[..]], 9002: rim}   # displacement axes as rows, or a system's name; others basic
systems: {rim: {type: cylindrical, origin: [0, 0, 0], axes: [[1,0,0],[0,1,0],[0,0,1]]}}
units: SI
recovery: {sensor: {matrix: CS, labels: [x, y], units: m}}
display: bus_display.npz                   # in the same folder: nodes, positions, matrix, quads, lines
source: where it comes from
surrogate: true
file: bus.mat                              # optional: not the sidecar of files with another ending, such as bus.npz
"""

from __future__ import annotations

import operator
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from flexplant.errors import InputError, ModelError, ReadError, nearest
from flexplant.io.parse.coordinates import CoordinateSystem
from flexplant.io.parse.files import read_head
from flexplant.io.parse.yaml_lines import LinedYaml, read_yaml
from flexplant.model.component import check_name
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes, check_rotation
from flexplant.model.units import unit_system

KEYS = ("name", "matrices", "boundary", "dofs", "modal", "nodes", "frames", "systems", "units", "recovery", "display", "source",
        "surrogate", "file")  # fmt: skip
KINDS = ("mass", "stiffness", "damping")
FILE_LINE = re.compile(rb"""^file: *["']?([^"'#\r\n]*[^"'#\s])""", re.MULTILINE)
SYSTEM_TYPES = {"rectangular": "R", "cylindrical": "C", "spherical": "S"}


@dataclass(frozen=True)
class Sidecar:
    """A checked sidecar. boundary and dofs are None where the key is absent."""

    yaml: LinedYaml
    name: str | None
    matrices: dict[str, str]
    boundary: DofSet | None
    dofs: DofSet | None
    nodes: Nodes | None
    modal: int | None
    recovery: Mapping[str, Mapping[str, Any]]
    display: Path | None

    @property
    def path(self) -> Path:
        """The sidecar's own file."""
        return self.yaml.path

    @property
    def units(self) -> Any:
        """The unit system it states: a preset's name, or (length in m, mass in kg); None if it states none."""
        return self.yaml.data.get("units")

    def fail(self, problem: str, *keys: str) -> NoReturn:
        """Raise ReadError at the line of a key."""
        self.yaml.fail(problem, *keys)

    def source(self) -> dict[str, Any]:
        """What goes into a model's provenance."""
        given = {k: self.yaml.data[k] for k in ("units", "surrogate") if k in self.yaml.data}
        return given | ({"description": str(self.yaml.data["source"])} if "source" in self.yaml.data else {})


def sidecar_path(path: Path) -> Path | None:
    """The sidecar beside a matrix file: same stem, .yaml or .yml, and not one that says it is another file's."""
    return next((p for p in _beside(path) if _belongs(p, path)), None)


def _beside(path: Path) -> list[Path]:
    return [p for p in (path.with_suffix(".yaml"), path.with_suffix(".yml")) if p.is_file()]


def _belongs(sidecar: Path, path: Path) -> bool:
    """By the ending, since both may have been given another name together."""
    said = FILE_LINE.search(read_head(sidecar))
    return said is None or Path(said[1].decode("utf-8", "replace")).suffix.lower() == path.suffix.lower()


def find_sidecar(path: Path, given: str | Path | None) -> Sidecar:
    """The sidecar that was given, or the one beside the file; ReadError that says what to write if there is none."""
    found = Path(given) if given is not None else sidecar_path(path)
    if found is None:
        others = "".join(f"; {p.name} says that it is another file's" for p in _beside(path))
        raise ReadError(
            path, f"plain matrices need a sidecar that says what the rows are: {path.with_suffix('.yaml').name} beside it "
            f"(keys: matrices, boundary or dofs, nodes, units, ...) or sidecar=...{others}"
        )  # fmt: skip
    return read_sidecar(found)


def read_sidecar(path: Path) -> Sidecar:
    """A sidecar from its file; ReadError with the line for unknown keys and unusable values."""
    yaml = read_yaml(path)
    data = yaml.check_keys(yaml.data, KEYS)
    key = "name"
    try:
        name = None if data.get(key) is None else check_name(data[key], "model")
        key = "units"
        if key in data:
            unit_system(data[key] if isinstance(data[key], str) else tuple(data[key]))
        key = "boundary"
        boundary = _dofs(yaml, key)
        key = "dofs"
        dofs = _dofs(yaml, key)
        key = "nodes"
        nodes = _nodes(yaml)
    except (ModelError, InputError, TypeError, ValueError, OverflowError) as error:
        yaml.fail(f"{key}: {error}", key)
    return Sidecar(yaml, name, _matrices(yaml), boundary, dofs, nodes, _modal(yaml), _recovery(yaml), _display(yaml))


def _matrices(yaml: LinedYaml) -> dict[str, str]:
    given = yaml.check_keys(yaml.data.get("matrices", {k: k for k in KINDS[:2]}), KINDS, "matrices")
    missing = [k for k in KINDS[:2] if k not in given]
    if missing:
        yaml.fail(f"matrices must name {' and '.join(missing)}, as in matrices: {{mass: MXX, stiffness: KXX}}", "matrices")
    return {kind: str(name) for kind, name in given.items()}


def _dofs(yaml: LinedYaml, key: str) -> DofSet | None:
    given = yaml.data.get(key)
    if given is None:
        return None
    if not isinstance(given, list) or not given or not all(isinstance(row, list) and len(row) == 2 for row in given):
        yaml.fail(f'{key} must be a list of [node, directions], as in [[9001, "123456"]]', key)
    return DofSet.of([(node, directions) for node, directions in given])


def _modal(yaml: LinedYaml) -> int | None:
    given = yaml.data.get("modal")
    if given is not None and (not isinstance(given, int) or isinstance(given, bool) or given < 0):
        yaml.fail("modal must be the number of modal rows", "modal")
    return given


def _nodes(yaml: LinedYaml) -> Nodes | None:
    given = yaml.data.get("nodes")
    if given is None:
        if "frames" in yaml.data:
            yaml.fail("frames need nodes", "frames")
        return None
    if not isinstance(given, list) or not all(isinstance(row, list) and len(row) == 4 for row in given):
        yaml.fail("nodes must be a list of [id, x, y, z]", "nodes")
    ids = [operator.index(row[0]) for row in given]
    positions = np.array([[float(v) for v in row[1:]] for row in given]).reshape(-1, 3)
    return Nodes(ids=np.array(ids, dtype=np.int64), positions=positions, frames=_frames(yaml, ids, positions))


def _frames(yaml: LinedYaml, ids: list[int], positions: Any) -> Any:
    given = yaml.data.get("frames")
    if given is None:
        return None
    if not isinstance(given, dict):
        yaml.fail("frames must be a mapping of node to axes or to a system's name", "frames")
    systems = _systems(yaml)
    frames = np.tile(np.eye(3), (len(ids), 1, 1))
    for node, value in given.items():
        if node not in ids:
            yaml.fail(f"frames: node {node} is not in nodes." + nearest(str(node), map(str, ids)), "frames", str(node))
        row = ids.index(node)
        if isinstance(value, str) and value not in systems:
            yaml.fail(f"frames: there is no system {value!r}." + nearest(value, systems), "frames", str(node))
        try:
            by_name = isinstance(value, str)
            frames[row] = systems[value].frame_at(positions[row]) if by_name else check_rotation(value, f"node {node}")
        except (ModelError, TypeError, ValueError) as error:
            yaml.fail(f"frames: {error}", "frames", str(node))
    return frames


def _systems(yaml: LinedYaml) -> dict[str, CoordinateSystem]:
    given = yaml.data.get("systems", {})
    if not isinstance(given, dict):
        yaml.fail("systems must be a mapping of name to type, origin, axes", "systems")
    return {str(name): _system(yaml, str(name), spec) for name, spec in given.items()}


def _system(yaml: LinedYaml, name: str, spec: Any) -> CoordinateSystem:
    spec = yaml.check_keys(spec, ("type", "origin", "axes"), "systems", name)
    kind = str(spec.get("type", "rectangular"))
    if kind not in SYSTEM_TYPES:
        yaml.fail(f"systems.{name}: unknown type {kind!r}." + nearest(kind, SYSTEM_TYPES), "systems", name)
    try:
        origin = np.array(spec.get("origin", [0, 0, 0]), dtype=float).reshape(3)
        axes = check_rotation(spec.get("axes", np.eye(3)), f"systems.{name}")
    except (ModelError, TypeError, ValueError) as error:
        yaml.fail(f"systems.{name}: {error}", "systems", name)
    return CoordinateSystem(SYSTEM_TYPES[kind], origin, axes)


def _recovery(yaml: LinedYaml) -> dict[str, dict[str, Any]]:
    given = yaml.data.get("recovery", {})
    if not isinstance(given, dict):
        yaml.fail("recovery must be a mapping of name to matrix, labels, units", "recovery")
    for name, spec in given.items():
        spec = yaml.check_keys(spec, ("matrix", "velocity", "acceleration", "labels", "units"), "recovery", str(name))
        if not isinstance(spec.get("labels", []), list):
            yaml.fail(f"recovery.{name}: labels must be a list", "recovery", str(name))
    return {str(name): spec for name, spec in given.items()}


def _display(yaml: LinedYaml) -> Path | None:
    given = yaml.data.get("display")
    return None if given is None else confined(yaml, str(given), "display")


def confined(yaml: LinedYaml, name: str, key: str) -> Path:
    """A file that a YAML file refers to, which must lie in the same folder or below it."""
    folder = yaml.path.parent
    path = folder / name
    try:
        inside = path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):
        inside = False
    if not inside:
        yaml.fail(f"{key}: {name!r} lies outside the folder of this file, which is not allowed", key)
    if not path.is_file():
        yaml.fail(f"{key}: there is no file {name!r} in {folder}", key)
    return path
