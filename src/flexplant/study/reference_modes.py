"""Reference modes of a study: frequencies, and shapes where the reference and the display recovery share nodes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.assembly import System
from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray
from flexplant.study.schema import ReferenceSpec
from flexplant.verification import Reference

RIGID_BELOW_HZ = 0.01
SHAPE_NODES = 40  # nodes at which shapes are compared, spread over the structure


@dataclass(frozen=True, eq=False)
class ReferenceModes:
    """rigid_hz, flexible_hz: ascending, Hz. labels: rows of shapes (n_rows, n_flexible with shapes), or none."""

    rigid_hz: FloatArray
    flexible_hz: FloatArray
    labels: tuple[str, ...] = ()
    shapes: FloatArray | None = None

    def first(self, spec: ReferenceSpec, count: int) -> Reference:
        """The first flexible modes, with their shapes where all of them have one."""
        hz = self.flexible_hz[:count]
        if self.shapes is None or self.shapes.shape[1] < hz.size:
            return Reference(hz, names=spec.labels, source=spec.name)
        return Reference(hz, self.shapes[:, : hz.size], self.labels, names=spec.labels, source=spec.name)


def read_reference(spec: ReferenceSpec, folder: Path, system: System) -> ReferenceModes:
    """The reference of a study; InputError for a file that has no frequencies."""
    arrays = {"frequency_hz": spec.frequency_hz} if spec.file is None else _arrays(folder / spec.file)
    hz = np.atleast_1d(np.array(arrays["frequency_hz"], dtype=float))
    if hz.ndim != 1 or not hz.size or not np.isfinite(hz).all():
        raise InputError(f"reference {spec.name!r}: no list of finite frequencies found")
    flexible = abs(hz) >= RIGID_BELOW_HZ
    labels, shapes = _shapes(arrays, system, flexible)
    return ReferenceModes(abs(hz[~flexible]), hz[flexible], labels, shapes)


def _arrays(path: Path) -> dict[str, Any]:
    try:
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as data:
                return {
                    name: data[name] for name in ("frequency_hz", "nodes", "shapes") if name in data or name == "frequency_hz"
                }
        return {"frequency_hz": np.loadtxt(path, dtype=float, ndmin=1)}
    except (KeyError, ValueError, OSError) as error:
        raise InputError(f"{path}: not reference modes (.npz with frequency_hz, or one frequency a line): {error}") from None


def _shapes(arrays: dict[str, Any], system: System, flexible: Any) -> tuple[tuple[str, ...], FloatArray | None]:
    """Labels and shapes (n_rows, n) at some of the nodes that both the reference and a display recovery have."""
    if "nodes" not in arrays or "shapes" not in arrays:
        return (), None
    place = {int(node): i for i, node in enumerate(arrays["nodes"])}
    known: dict[int, str] = {}
    for component in system.components:
        recovery = component.recovery.get("display")
        for label in recovery.labels if recovery is not None else ():
            node = int(label.partition(".")[0])
            if node in place:
                known.setdefault(node, f"{component.name}.display")
    nodes = list(known)[:: max(1, len(known) // SHAPE_NODES)]
    if not nodes:
        return (), None
    labels = tuple(f"{known[node]}.{node}.{direction}" for node in nodes for direction in (1, 2, 3))
    given = np.asarray(arrays["shapes"], dtype=float)
    shapes = given[flexible[: len(given)]][:, [place[node] for node in nodes]]
    return labels, shapes.reshape(len(shapes), -1).T
