"""Connections between components: which nodes, which directions, in which frame, rigid or compliant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from flexplant.assembly.pairs import Pair, coordinate_pair, grounded_node, is_dof_pair, is_whole, node_pair
from flexplant.errors import CouplingError, ModelError, nearest
from flexplant.model.arrays import FloatArray, frozen, is_number, items_of, real_values
from flexplant.model.component import check_name
from flexplant.model.dofs import expand_directions
from flexplant.model.geometry import check_rotation

GROUND = "ground"
OFFSETS = ("rigid", "ignore", "forbid")


@dataclass(frozen=True, eq=False)
class Connection:
    """Ties nodes of component `a` to nodes of component `b` (equations 6-7: p_a - p_b = 0, direction by direction).

    pairs: [(node_a, node_b), ...]; [((node_a, direction), (node_b, direction)), ...] for single coordinates, taken as they
      are; "by position" (nodes closer than `tolerance`, model length unit); a list of nodes where b is "ground".
    directions: subset of "123456", along `frame`: "a" or "b" (that side's displacement frame), "system", or (3, 3) rows.
    offset: for nodes that do not coincide: "rigid" (rigid link, u_b = u_a + theta_a x r), "ignore" (coordinates are
      equated as they are) or "forbid" (an error).
    nodes: for "by position", the nodes of `a` that must match; without it one side must match completely. With b "ground"
      the nodes that are clamped, which may be given as `pairs` as well.
    stiffness, damping: None is rigid; a number, one value a direction (or a pair of coordinates), or a square matrix makes
      it compliant (N/m, N m/rad).
    The constraint's multiplier is the force that a exerts on b.
    """

    a: str
    b: str
    pairs: Any = "by position"
    directions: str = "123456"
    name: str | None = None
    frame: str | FloatArray = "a"
    offset: str = "rigid"
    tolerance: float | None = None
    nodes: Sequence[int] | None = None
    stiffness: npt.ArrayLike | None = None
    damping: npt.ArrayLike | None = None

    def __post_init__(self) -> None:
        if self.b is None:
            object.__setattr__(self, "b", GROUND)
        for side in (self.a, self.b):
            if not isinstance(side, str) or not side:
                raise CouplingError(f"connection: a and b are names of components, got {type(side).__name__} {side!r:.60}")
        name = f"{self.a}-{self.b}" if self.name is None else self.name
        object.__setattr__(self, "name", check_name(name, "connection"))
        self._check_directions()
        if self.a == GROUND:
            raise CouplingError(f"connection {self.name!r}: name the component first and 'ground' second")
        if isinstance(self.pairs, str) and self.pairs != "by position":
            raise CouplingError(f"connection {self.name!r}: pairs must be node pairs or 'by position', got {self.pairs!r}")
        self._check_nodes()
        if self.b == GROUND:
            self._name_grounded()
        if not isinstance(self.pairs, (str, Sequence)) and not (isinstance(self.pairs, np.ndarray) and self.pairs.ndim):
            raise CouplingError(f"connection {self.name!r}: pairs must be a list, got {type(self.pairs).__name__}")
        if not isinstance(self.pairs, str) and not len(self.pairs):
            raise CouplingError(f"connection {self.name!r}: no pairs; give node pairs or 'by position'")
        self._check_pairs()
        if not isinstance(self.offset, str) or self.offset not in OFFSETS:
            text = f"connection {self.name!r}: offset {self.offset!r:.60} is not one of {OFFSETS}."
            raise CouplingError(text + nearest(self.offset, OFFSETS))
        if self.tolerance is not None and not (is_number(self.tolerance) and 0 <= self.tolerance < np.inf):
            raise CouplingError(f"connection {self.name!r}: tolerance {self.tolerance} must be a length >= 0")
        self._check_frame()
        n = len(self.pairs) if self.by_coordinate else len(expand_directions(self.directions))
        for kind in ("stiffness", "damping"):
            if getattr(self, kind) is not None:
                object.__setattr__(self, kind, self._square(kind, n))

    def _check_directions(self) -> None:
        try:
            directions = expand_directions(self.directions)
        except (TypeError, ValueError) as error:
            raise CouplingError(f"connection {self.name!r}: {error}") from None
        if 0 in directions:
            raise CouplingError(
                f"connection {self.name!r}: directions {self.directions!r}: nodes couple in 1-6; couple scalar coordinates as "
                "pairs ((node, 0), (node, 0))"
            )

    def _check_pairs(self) -> None:
        """CouplingError where a pair is none, before any component is there to look it up in."""
        if self.by_coordinate:
            for pair in self.pairs:
                coordinate_pair(pair, f"connection {self.name!r}")
        elif not isinstance(self.pairs, str):
            self.listed_nodes()

    def listed_nodes(self) -> list[Pair]:
        """[(node_a, node_b or None for ground), ...] of pairs that name nodes."""
        one = grounded_node if self.b == GROUND else node_pair
        return [one(pair, f"connection {self.name!r}") for pair in self.pairs]

    def _name_grounded(self) -> None:
        """The nodes that are clamped, as pairs or as nodes, not as both."""
        if not isinstance(self.pairs, str):
            if self.nodes is not None:
                raise CouplingError(f"connection {self.name!r}: pairs and nodes both list nodes to ground; give one of them")
        elif self.nodes is None:
            raise CouplingError(f"connection {self.name!r}: list the nodes to ground, for example nodes=[101, 102]")
        else:
            object.__setattr__(self, "pairs", list(self.nodes))
            object.__setattr__(self, "nodes", None)  # one place, so that dataclasses.replace makes the same connection

    def _check_nodes(self) -> None:
        if self.nodes is None:
            return
        nodes = tuple(items_of(self.nodes) or ())
        if not nodes or not all(map(is_whole, nodes)):
            raise CouplingError(
                f"connection {self.name!r}: nodes must be a list of node ids of {self.a!r} such as [101, 102], got {self.nodes!r}"
            )
        object.__setattr__(self, "nodes", nodes)

    def _check_frame(self) -> None:
        if not isinstance(self.frame, str):
            object.__setattr__(self, "frame", check_rotation(self.frame, f"connection {self.name!r}: frame"))
        elif self.frame not in ("a", "b", "system"):
            raise CouplingError(
                f"connection {self.name!r}: frame {self.frame!r} does not exist; use 'a', 'b', 'system' or a (3, 3) rotation"
            )

    def _square(self, kind: str, n: int) -> FloatArray:
        try:
            given = real_values(getattr(self, kind), f"connection {self.name!r}: {kind} is not numeric")
        except ModelError as error:
            raise CouplingError(str(error)) from None
        spread = given.ndim < 2 and given.size in (1, n)
        out = np.diag(np.broadcast_to(given, (n,))) if spread else given
        if out.shape != (n, n) or not np.isfinite(out).all() or abs(out - out.T).max() > 1e-9 * abs(out).max():
            raise CouplingError(
                f"connection {self.name!r}: {kind} must be a number, {n} numbers or a symmetric ({n}, {n}) matrix "
                f"({n} coupled coordinates a pair of nodes), got {'values that are not' if out.shape == (n, n) else given.shape}"
            )
        return np.asarray(frozen(out))

    @property
    def by_coordinate(self) -> bool:
        """True where pairs are single coordinates, ((node, direction), (node, direction))."""
        return not isinstance(self.pairs, str) and self.b != GROUND and all(is_dof_pair(p) for p in self.pairs)

    @property
    def rigid(self) -> bool:
        """True where the connection is a constraint, not a spring or damper."""
        return self.stiffness is None and self.damping is None
