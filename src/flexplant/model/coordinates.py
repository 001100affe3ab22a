"""A component in other coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from flexplant.model.arrays import FloatArray, Matrix, dense
from flexplant.model.component import Component
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes
from flexplant.model.recovery import Recovery


@dataclass(frozen=True, eq=False)
class LeftOut:
    """What T leaves out of an interface: motions X with X^T K X = I and X^T K T = 0.

    rows: X^T M T (k, n'). slowest: the lowest w^2 of X alone, infinite where nothing is left out. interface: its boundary DOF,
    and how many coordinates stand for them.
    """

    rows: FloatArray
    slowest: float
    interface: tuple[int, int]


def in_coordinates(
    component: Component,
    basis: FloatArray,
    left_out: LeftOut,
    *,
    boundary: DofSet,
    nodes: Nodes | None,
    modal_ids: Sequence[int] | None = None,
) -> Component:
    """The component on p = T p', T (n, n'): T^T A T of its matrices, R T of its rows, and what follows from a reduction."""

    def projected(matrix: Matrix | None) -> Matrix | None:
        return None if matrix is None else _symmetric(basis.T @ (matrix @ basis))

    return replace(
        component,
        boundary=boundary,
        nodes=nodes,
        modal_ids=modal_ids,
        mass=projected(component.mass),
        stiffness=projected(component.stiffness),
        damping=projected(component.damping),
        structural_damping=projected(component.structural_damping),
        interior_rows=None if component.interior_rows is None else dense(component.interior_rows @ basis),
        recovery={r.name: _recovered(r, basis) for r in component.recovery.values()},
        **component.followed(basis, left_out),
    )


def _symmetric(matrix: FloatArray) -> FloatArray:
    return 0.5 * (matrix + matrix.T)


def _recovered(recovery: Recovery, basis: FloatArray) -> Recovery:
    kinds = {kind: getattr(recovery, kind) for kind in ("displacement", "velocity", "acceleration")}
    rows: dict[str, Any] = {kind: None if x is None else dense(x @ basis) for kind, x in kinds.items()}
    return replace(recovery, **rows)
