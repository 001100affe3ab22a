"""The structure in three dimensions: a light mesh and its mode shapes, for the animated view in the report."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray
from flexplant.model.display import DisplayMesh


@dataclass(frozen=True, eq=False)
class StructureView:
    """A mesh with mode shapes to animate: shapes (n_modes, n, 3), frequency_hz (n_modes,), labels such as "X bending 1".

    From a display matrix D (3n, coordinates; x, y, z of each node in turn): shapes = (D @ modes.shapes).T.reshape(-1, n, 3).
    Each shape is drawn with its largest displacement at the same size, so its scale is free. still: what a figure shows at
    rest beneath, where that is more than the mesh that moves.
    Raises InputError where the shapes do not fit.
    """

    mesh: DisplayMesh
    shapes: FloatArray
    frequency_hz: FloatArray
    labels: Sequence[str] = ()
    title: str = "Mode shapes"
    caption: str = ""
    first_mode: int = 0
    still: DisplayMesh | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "shapes", _finite(self.shapes, "shapes"))
        object.__setattr__(self, "frequency_hz", np.asarray(self.frequency_hz, dtype=float).ravel())
        n_modes, n = self.frequency_hz.size, len(self.mesh.positions)
        if self.shapes.shape != (n_modes, n, 3) or n_modes == 0:
            raise InputError(
                f"structure view: shapes {self.shapes.shape} do not fit {n_modes} frequencies and {n} nodes: (modes, nodes, 3)"
            )
        if self.labels and len(self.labels) != n_modes:
            raise InputError(f"structure view: {len(self.labels)} labels for {n_modes} modes")
        if not 0 <= self.first_mode < n_modes:
            raise InputError(f"structure view: first mode {self.first_mode} of {n_modes}")

    @property
    def captions(self) -> list[str]:
        """What the mode list shows: "X bending 1, 112.8 Hz"."""
        names = self.labels or [f"Mode {i + 1}" for i in range(self.frequency_hz.size)]
        return [
            f"{name} · {hz:.1f} Hz" if hz >= 1 else f"{name} · {hz:.2g} Hz"
            for name, hz in zip(names, self.frequency_hz, strict=True)
        ]

    def payload(self) -> dict[str, object]:
        """What the viewer in the page reads; arrays as base64 of little-endian float32 and uint32."""
        largest = np.linalg.norm(self.shapes, axis=2).max(axis=1)
        unit = self.shapes / np.where(largest > 0, largest, 1.0)[:, None, None]
        return {
            "positions": _packed(self.mesh.positions, "<f4"),
            "quads": _packed(self.mesh.quads, "<u4"),
            "lines": _packed(self.mesh.lines, "<u4"),
            "shapes": _packed(unit, "<f4"),
            "modes": self.captions,
            "first": self.first_mode,
        }


def joined(meshes: Sequence[DisplayMesh]) -> DisplayMesh:
    """Several meshes (components in place) as one, nodes in the given order; stack their shapes along the node axis to match."""
    if not meshes:
        raise InputError("display mesh: nothing to join")
    starts = np.cumsum([0, *(len(m.positions) for m in meshes[:-1])])
    return DisplayMesh(
        nodes=np.concatenate([m.nodes for m in meshes]),
        positions=np.vstack([m.positions for m in meshes]),
        quads=np.vstack([m.quads + start for m, start in zip(meshes, starts, strict=True)]),
        lines=np.vstack([m.lines + start for m, start in zip(meshes, starts, strict=True)]),
    )


def _finite(values: FloatArray, what: str) -> FloatArray:
    array = np.asarray(values, dtype=float)
    if not np.isfinite(array).all():
        raise InputError(f"structure: {what} has entries that are not finite")
    return array


def _packed(array: NDArray[np.generic], dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype=dtype).tobytes()).decode("ascii")
