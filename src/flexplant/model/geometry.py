"""Nodes with displacement frames, placements, and geometric rigid-body motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from flexplant.errors import InputError, ModelError, expect, nearest
from flexplant.model.arrays import FloatArray, IntArray, frozen, real_values
from flexplant.model.describe import count, listed
from flexplant.model.dofs import DofSet

ORTHOGONALITY_TOLERANCE = 1e-6  # single-precision direction cosines pass, a typing error does not


def check_rotation(rotation: npt.ArrayLike, what: str) -> FloatArray:
    """A read-only (3, 3) proper rotation, re-orthogonalised to machine precision; ModelError otherwise."""
    given: FloatArray = frozen(rotation, what=what)
    if given.shape != (3, 3) or not np.isfinite(given).all():
        raise ModelError(f"{what}: a rotation must be a finite (3, 3) matrix, got shape {given.shape}")
    u, s, vt = np.linalg.svd(given)
    if abs(s - 1).max() > ORTHOGONALITY_TOLERANCE or np.linalg.det(given) < 0:
        raise ModelError(
            f"{what}: not a right-handed rotation (singular values {np.round(s, 6)}, det {np.linalg.det(given):.4g})"
        )
    return np.asarray(frozen(u @ vt)) if abs(s - 1).max() > 1e-14 else given


def cylindrical_frame(position: npt.ArrayLike, origin: npt.ArrayLike, axes: npt.ArrayLike) -> FloatArray:
    """Displacement axes (rows: radial, tangential, axial) at a point of a cylindrical system.

    position, origin: (3,), basic frame. axes: (3, 3), rows are x, y, z of the cylindrical system in the basic frame.
    On the axis the radial direction is undefined: there the x axis is taken (MSC Nastran convention for theta = 0).
    """
    rows = check_rotation(axes, "cylindrical frame")
    local = rows @ (point(position, "cylindrical_frame: position") - point(origin, "cylindrical_frame: origin"))
    radius = float(np.hypot(local[0], local[1]))
    c, s = (local[0] / radius, local[1] / radius) if radius > 1e-12 * (1 + abs(local).max()) else (1.0, 0.0)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ rows


def point(values: npt.ArrayLike, what: str) -> FloatArray:
    """(3,) three finite numbers; InputError otherwise."""
    found = real_values(values, what)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise InputError(f"{what} must be three finite numbers, got shape {found.shape}: {values!r:.60}")
    return found


def cross_matrix(vector: npt.ArrayLike) -> FloatArray:
    """S such that S @ w = vector x w."""
    x, y, z = np.asarray(vector, dtype=float)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass(frozen=True, eq=False)
class Nodes:
    """Node ids, positions and displacement frames.

    ids: (n,). positions: (n, 3) in the component's basic frame, length unit of the model.
    frames: (n, 3, 3) or None (all basic); rows of frames[i] are the displacement axes of node i in the basic frame,
    so u_displacement = frames[i] @ u_basic.
    """

    ids: IntArray
    positions: FloatArray
    frames: FloatArray | None = None

    def __post_init__(self) -> None:
        ids, positions = frozen(self.ids, np.int64, what="nodes: ids"), frozen(self.positions, what="nodes: positions")
        if ids.ndim != 1 or positions.shape != (ids.size, 3):
            raise ModelError(f"nodes: {ids.size} ids need positions of shape ({ids.size}, 3), got {positions.shape}")
        if not np.isfinite(positions).all():
            raise ModelError(f"nodes: position of node {ids[~np.isfinite(positions).all(axis=1)][0]} is not finite")
        object.__setattr__(self, "ids", ids)
        object.__setattr__(self, "positions", positions)
        if len(self._row) != ids.size:
            raise ModelError(f"nodes: {ids.size - len(self._row)} node ids are listed twice")
        if self.frames is not None:
            frames = frozen(self.frames, what="nodes: frames")
            if frames.shape != (ids.size, 3, 3):
                raise ModelError(f"nodes: frames must have shape ({ids.size}, 3, 3), got {frames.shape}")
            checked = [check_rotation(f, f"displacement frame of node {i}") for i, f in zip(ids, frames, strict=True)]
            object.__setattr__(self, "frames", frozen(np.reshape(checked, (ids.size, 3, 3))))

    def __repr__(self) -> str:
        frames = "" if self.frames is None else ", with displacement frames"
        size = f", {', '.join(f'{s:.4g}' for s in np.ptp(self.positions, axis=0))} across" if self.ids.size else ""
        return f"{count(self.ids.size, 'node')}{size}{frames}: {listed(self.ids.tolist())}"

    @cached_property
    def _row(self) -> dict[int, int]:
        return {int(i): k for k, i in enumerate(self.ids)}

    def __len__(self) -> int:
        return int(self.ids.size)

    def __contains__(self, node: object) -> bool:
        return node in self._row

    def _index(self, node: int) -> int:
        try:
            return self._row[node]
        except KeyError:
            raise ModelError(f"no position is known for node {node}." + nearest(str(node), map(str, self._row))) from None

    def position(self, node: int) -> FloatArray:
        """(3,) position of a node in the basic frame; ModelError names an unknown node."""
        return np.asarray(self.positions[self._index(node)])

    def frame(self, node: int) -> FloatArray:
        """(3, 3) displacement axes (rows) of a node in the basic frame."""
        index = self._index(node)
        return np.eye(3) if self.frames is None else np.asarray(self.frames[index])

    @property
    def extent(self) -> float:
        """Largest distance along an axis between two nodes."""
        return float(np.ptp(self.positions, axis=0).max()) if len(self) else 0.0


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a component stands in the system: x_system = rotation @ x_component + translation."""

    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    translation: FloatArray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", check_rotation(self.rotation, "placement"))
        translation = frozen(self.translation, what="placement: translation")
        if translation.shape != (3,) or not np.isfinite(translation).all():
            raise ModelError(f"placement: translation must be three finite numbers, got shape {translation.shape}")
        object.__setattr__(self, "translation", translation)

    def apply(self, positions: npt.ArrayLike) -> FloatArray:
        """Positions (..., 3) of the component, in the system's frame."""
        return np.asarray(positions, dtype=float) @ self.rotation.T + self.translation


def rigid_body_vectors(
    nodes: Nodes, dofs: DofSet, *, about: npt.ArrayLike = (0.0, 0.0, 0.0), placement: Placement | None = None
) -> FloatArray:
    """Displacements of each DOF under unit rigid translations and rotations, (n_dof, 6).

    Columns: translation x, y, z and rotation about x, y, z through `about`, in the system frame (the basic frame without a
    placement); rows in each node's displacement frame; scalar and modal rows (direction 0) are zero:
    u = F R^T [I, -[r]x; 0, I] with r the position relative to `about`.
    """
    expect(nodes, Nodes, "rigid_body_vectors", "Nodes(ids, positions) makes them")
    expect(dofs, DofSet, "rigid_body_vectors", "DofSet.of([(node, direction), ...]) makes one")
    placement = Placement() if placement is None else placement
    expect(placement, Placement, "rigid_body_vectors", "Placement(rotation, translation) makes one")
    centre = point(about, "rigid_body_vectors: about")
    rows = np.zeros((len(dofs), 6))
    for node in dofs.nodes:
        to_local = nodes.frame(node) @ placement.rotation.T
        arm = placement.apply(nodes.position(node)) - centre
        motion = np.zeros((6, 6))
        motion[:3, :3], motion[3:, 3:] = to_local, to_local
        motion[:3, 3:] = -to_local @ cross_matrix(arm)
        at = np.flatnonzero((dofs.node == node) & (dofs.direction > 0))
        rows[at] = motion[dofs.direction[at] - 1]
    return rows
