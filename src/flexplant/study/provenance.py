"""Where a study's numbers come from: files and their hashes, versions, settings."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from flexplant.assembly import System
from flexplant.study.schema import StudySpec

PACKAGES = ("flexplant", "numpy", "scipy", "xarray", "rslab", "pyyeti", "plotly")


def provenance(study: StudySpec, folder: Path, system: System) -> dict[str, dict[str, object]]:
    """Group -> name -> value, for the report and the results file."""
    groups: dict[str, dict[str, object]] = {f"file {name}": dict(_file(folder / name)) for name in _files(study)}
    for component in system.components:
        groups[f"component {component.name}"] = {
            "boundary DOF": component.n_boundary,
            "modal DOF": component.n_modal,
            **{str(k): v for k, v in component.source.items() if isinstance(v, (str, int, float))},
        }
    groups["versions"] = {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}}
    groups["settings"] = dict(_settings(study))
    return groups


def _files(study: StudySpec) -> list[str]:
    reference = study.verification.reference
    named = [c.file for c in study.components.values()]
    named += [reference.file] if reference is not None and reference.file is not None else []
    named += [study.truth.file, *(c.file for c in study.truth.components.values())] if study.truth is not None else []
    return list(dict.fromkeys(named))


def _file(path: Path) -> Iterator[tuple[str, object]]:
    data = path.read_bytes()
    yield "bytes", len(data)
    yield "sha256", hashlib.sha256(data).hexdigest()


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
