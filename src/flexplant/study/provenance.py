"""Where a study's numbers come from: files and their hashes, versions, settings."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from flexplant.assembly import System
from flexplant.study.display import is_drawn, mesh_of
from flexplant.study.schema import StudySpec

PACKAGES = ("flexplant", "numpy", "scipy", "xarray", "rslab", "pyyeti", "plotly")


def provenance(study: StudySpec, path: Path, system: System) -> dict[str, dict[str, object]]:
    """Group -> name -> value, for the report and the results file; `path`: the study file.

    Files are named relative to the study's folder: a report is passed on, and where it was made is nobody's business.
    """
    groups: dict[str, dict[str, object]] = {"Files (SHA-256)": dict(_hashes(study, path, system))}
    for component in system.components:
        groups[f"Component {component.name}"] = {
            "boundary DOF": component.n_boundary,
            "modal DOF": component.n_modal,
            **_told(component.source),
        }
    for name, spec in study.components.items():
        if is_drawn(spec) and (mesh := mesh_of(spec, path.parent)) is not None:
            groups[f"Geometry of {name}"] = {"nodes": len(mesh.nodes), **_told(mesh.source)}
            groups["Files (SHA-256)"] |= dict(_beside(mesh.source, path.parent))
    groups["Versions"] = {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}}
    groups["Settings"] = dict(_settings(study))
    return groups


def _told(source: Mapping[str, object]) -> dict[str, object]:
    """What a record of provenance says, but for path and hash, which stand with the files."""
    return {str(k): v for k, v in source.items() if isinstance(v, (str, int, float)) and k not in ("path", "sha256")}


def _files(study: StudySpec) -> list[str]:
    reference = study.verification.reference
    parts = [*study.components.values(), *([] if study.truth is None else study.truth.components.values())]
    named = [name for c in parts for name in (c.file, c.geometry) if name is not None]
    named += [reference.file] if reference is not None and reference.file is not None else []
    named += [study.truth.file] if study.truth is not None else []
    return list(dict.fromkeys(named))


def _hashes(study: StudySpec, path: Path, system: System) -> Iterator[tuple[str, str]]:
    """The study file, every file it names, and what the readers found beside them (sidecars, display sets)."""
    folder = path.parent
    for name in (path.name, *_files(study)):
        yield name, hashlib.sha256((folder / name).read_bytes()).hexdigest()
    for component in system.components:
        yield from _beside(component.source, folder)


def _beside(source: Mapping[str, Any], folder: Path) -> Iterator[tuple[str, str]]:
    """Files that a reader found beside the one it was given."""
    for file, digest in source.get("files", {}).items():
        yield Path(os.path.relpath(file, folder)).as_posix(), digest


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _settings(study: StudySpec) -> Iterator[tuple[str, object]]:
    yield "assembly", study.method
    yield (
        "damping of the coupled modes",
        "none given" if study.damping is None else f"{study.damping.ratio} on {study.damping.on}",
    )
    yield from _flat("plant", study.plant.model_dump())
    if study.line_of_sight is not None:
        yield from _flat("", study.line_of_sight.model_dump(exclude={"frequency"}))
    if study.truth is not None:
        yield "structural damping of the comparison", study.truth.structural_damping


def _flat(name: str, value: object) -> Iterator[tuple[str, object]]:
    """Nested settings as "wheel amplitude": value; lists as text."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(f"{name} {key}".strip(), inner)
    elif value is not None:
        yield name, ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else value
