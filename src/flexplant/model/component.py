"""What flexplant couples: finite-element models and Hurty/Craig-Bampton components."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from flexplant.errors import ModelError, expect_text
from flexplant.model.arrays import FloatArray, Matrix, checked_matrix, checked_symmetric, dense, frozen
from flexplant.model.describe import count, dof_text, listed, paragraph
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes
from flexplant.model.recovery import Recovery

if TYPE_CHECKING:
    from flexplant.model.coordinates import LeftOut


def check_name(name: str, what: str) -> str:
    """A name usable in channel names such as "bus.101.1": no dots, colons or blanks; ModelError otherwise."""
    if not isinstance(name, str) or not name or any(c in ".:/" or c.isspace() for c in name):
        raise ModelError(f"{what} name {name!r}: use a non-empty text without dots, colons, slashes and blanks")
    return name


def _check_nodes(owner: str, nodes: Nodes | None, dofs: DofSet) -> None:
    if nodes is None:
        return
    if not isinstance(nodes, Nodes):
        raise ModelError(f"{owner}: nodes must be Nodes(ids=, positions=), got {type(nodes).__name__}")
    missing = [n for n in dofs.nodes if n not in nodes]
    if missing:
        raise ModelError(f"{owner}: DOF at nodes {missing[:8]} that are not in its {len(nodes)} nodes; add their positions")


def _check_labels(owner: str, source: Mapping[str, Any], units: str) -> None:
    if not isinstance(source, Mapping):
        raise ModelError(f"{owner}: source must be a mapping, such as {{'path': ...}}, got {type(source).__name__}")
    expect_text(units, f"{owner}: units")


@dataclass(frozen=True, eq=False, kw_only=True)
class FiniteElementModel:
    """An unreduced model  M u'' + Z u' + K u = f.

    mass, stiffness, damping (or None): (n, n), symmetric, sparse or dense. dofs: one (node, direction) a row.
    nodes: positions and displacement frames, or None where unknown. source: provenance for reports.
    """

    name: str
    mass: Matrix
    stiffness: Matrix
    dofs: DofSet
    nodes: Nodes | None = None
    damping: Matrix | None = None
    source: Mapping[str, Any] = field(default_factory=dict)
    units: str = "SI"

    def __post_init__(self) -> None:
        _check_labels(f"model {check_name(self.name, 'model')!r}", self.source, self.units)
        dofs = DofSet.of(self.dofs)
        object.__setattr__(self, "dofs", dofs)
        for kind in ("mass", "stiffness", "damping"):
            if (matrix := getattr(self, kind)) is not None or kind != "damping":
                object.__setattr__(self, kind, checked_symmetric(matrix, len(dofs), f"model {self.name!r}: {kind} matrix"))
        _check_nodes(f"model {self.name!r}", self.nodes, dofs)

    def __repr__(self) -> str:
        nodes = "" if self.nodes is None else f", {count(len(self.nodes), 'node')}"
        damped = "with damping" if self.damping is not None else "no damping"
        head = f"FiniteElementModel {self.name!r}: {len(self.dofs)} DOF{nodes}, {damped}"
        return paragraph(head, {"units": self.units, "from": str(self.source.get("path", ""))})


@dataclass(frozen=True, eq=False, kw_only=True)
class Component:
    """A Hurty/Craig-Bampton component, coordinates p = [b; q]: physical boundary DOF, then modal.

    Equations 1-4 of the workflow:  M p'' + Z p' + K p = F,  M = [[Mbb, Mbq], [Mqb, I]],  K = [[Kbb, 0], [0, w^2]],
    Z = [[0, 0], [0, 2 xi w]]; other symmetric forms (physical Z, residual vectors, no modal part) are accepted as given.

    mass, stiffness, damping (or None): (n, n) symmetric, n = len(boundary) + n_modal; mass may be singular or indefinite.
    boundary: (node, direction) of the first rows. recovery: by name (a mapping, or a sequence of `Recovery`).
    structural_damping: D (n, n) or None, so that the stiffness of a harmonic motion is K + i D.
    interior: further (node, direction) where forces may act and displacements may be asked for, with interior_rows R
    (len(interior), n): u = R p, and a force f there acts as R^T f.
    Raises ModelError with the names and shapes that disagree. Source: Craig and Bampton 1968; Hurty 1965.
    """

    name: str
    mass: Matrix
    stiffness: Matrix
    boundary: DofSet
    damping: Matrix | None = None
    nodes: Nodes | None = None
    recovery: Mapping[str, Recovery] = field(default_factory=dict)
    modal_ids: Sequence[int] | None = None
    structural_damping: Matrix | None = None
    interior: DofSet = field(default_factory=lambda: DofSet.of(()))
    interior_rows: Matrix | None = None
    source: Mapping[str, Any] = field(default_factory=dict)
    units: str = "SI"

    def __post_init__(self) -> None:
        owner = f"component {check_name(self.name, 'component')!r}"
        _check_labels(owner, self.source, self.units)
        boundary = DofSet.of(self.boundary)
        object.__setattr__(self, "boundary", boundary)
        mass = checked_symmetric(self.mass, None, f"{owner}: mass matrix")
        n = mass.shape[0]
        object.__setattr__(self, "mass", mass)
        if len(boundary) > n:
            raise ModelError(f"{owner}: {len(boundary)} boundary DOF but matrices of shape {mass.shape}")
        for kind in ("stiffness", "damping", "structural_damping"):
            if (matrix := getattr(self, kind)) is not None or kind == "stiffness":
                what = f"{owner}: {kind.replace('_', ' ')} matrix"
                object.__setattr__(self, kind, checked_symmetric(matrix, n, what))
        _check_nodes(owner, self.nodes, boundary)
        self._set_recovery(owner, n)
        modal = np.arange(1, self.n_modal + 1) if self.modal_ids is None else self.modal_ids
        ids = frozen(modal, np.int64, what=f"{owner}: modal ids")
        if ids.shape != (self.n_modal,):
            raise ModelError(f"{owner}: {ids.size} modal ids for {self.n_modal} modal coordinates")
        object.__setattr__(self, "modal_ids", ids)
        twice = sorted(n for n, d in self.boundary.pairs if d == 0 and n in set(ids.tolist()))
        if twice or np.unique(ids).size < ids.size:
            raise ModelError(f"{owner}: modal ids must be distinct, and distinct from scalar boundary DOF {twice[:8]}")
        self._set_interior(owner, n)

    def __repr__(self) -> str:
        boundary = count(len(self.boundary), "boundary DOF", "boundary DOF")
        head = f"{type(self).__name__} {self.name!r}: {boundary}, {self.n_modal} modal"
        present = [kind.replace("_", " ") for kind in ("damping", "structural_damping") if getattr(self, kind) is not None]
        rows = {
            "boundary": dof_text(self.boundary.pairs),
            "interior": dof_text(self.interior.pairs) if len(self.interior) else "",
            "damping": " and ".join(present) or "none",
            "recovery": listed(f"{r.name} ({count(len(r.labels), 'row')})" for r in self.recovery.values()),
            "units": self.units,
            "from": str(self.source.get("path", "")),
        }
        return paragraph(head, rows | self._made())

    def _made(self) -> dict[str, str]:
        """What kinds of components say besides about themselves."""
        return {}

    def _set_interior(self, owner: str, n: int) -> None:
        interior = DofSet.of(self.interior)
        object.__setattr__(self, "interior", interior)
        if self.interior_rows is None and not len(interior):
            return
        rows = np.zeros((0, n)) if self.interior_rows is None else self.interior_rows
        object.__setattr__(self, "interior_rows", checked_matrix(rows, (len(interior), n), f"{owner}: interior rows"))
        taken = [f"{node}-{d}" for node, d in interior.pairs if (node, d) in self.dofs]
        if taken:
            raise ModelError(f"{owner}: interior DOF {', '.join(taken[:8])} are boundary or modal coordinates already")

    def _set_recovery(self, owner: str, n: int) -> None:
        given: Any = self.recovery
        if not isinstance(given, (Mapping, Sequence)) or isinstance(given, str):
            raise ModelError(f"{owner}: recovery must be a mapping by name or a list of Recovery, got {type(given).__name__}")
        items: list[Recovery] = list(given.values() if isinstance(given, Mapping) else given)
        for r in items:
            if not isinstance(r, Recovery):
                raise ModelError(f"{owner}: recovery must be Recovery values, got {type(r).__name__}")
        recovery = {check_name(r.name, "recovery"): r for r in items}
        if len(recovery) < len(items) or (isinstance(given, Mapping) and list(given) != list(recovery)):
            raise ModelError(f"{owner}: recovery names must be distinct, and a mapping's keys must be the names {list(recovery)}")
        for r in recovery.values():
            if r.n_columns != n:
                raise ModelError(f"{owner}: recovery {r.name!r} has {r.n_columns} columns, but the matrices are ({n}, {n})")
        object.__setattr__(self, "recovery", recovery)

    @property
    def n(self) -> int:
        """Number of generalised coordinates."""
        return int(self.mass.shape[0])

    @property
    def n_boundary(self) -> int:
        """Number of physical boundary DOF."""
        return len(self.boundary)

    @property
    def n_modal(self) -> int:
        """Number of modal coordinates."""
        return self.n - self.n_boundary

    def followed(self, _basis: FloatArray, _left_out: LeftOut, /) -> dict[str, Any]:
        """Fields that a kind of component has besides, on p = T p' (`in_coordinates`); this one has none."""
        return {}

    @cached_property
    def dofs(self) -> DofSet:
        """All coordinates: boundary (node, direction), then modal (modal id, 0)."""
        modal = np.asarray(self.modal_ids)
        return DofSet(np.r_[self.boundary.node, modal], np.r_[self.boundary.direction, np.zeros(self.n_modal, int)])

    @cached_property
    def fixed_interface_hz(self) -> FloatArray:
        """(n_modal,) sqrt(Kqq / Mqq) / 2 pi of the modal coordinates, Hz (negative stiffness gives NaN)."""
        k, m = dense(self.stiffness).diagonal()[self.n_boundary :], dense(self.mass).diagonal()[self.n_boundary :]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.sqrt(k / m) / (2 * np.pi))
