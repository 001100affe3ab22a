"""From matrices and the DOF of their rows, in any order, to a model, or to a component (boundary first, then modal)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.model.arrays import Matrix, is_sparse
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes
from flexplant.model.recovery import Recovery

Matrices = dict[str, Matrix | None]


def listed_model(path: Path, matrices: Matrices, dofs: DofSet, nodes: Nodes | None, name: str, source: Any) -> FiniteElementModel:
    """The finite-element model; ReadError where matrices and DOF do not have the same size, or a row is modal."""
    _check_shapes(path, matrices, dofs)
    if (dofs.direction == 0).any():
        raise ReadError(path, "has modal rows (direction 0), so it is a component: use read_component")
    return FiniteElementModel(name=name, **_given(matrices), dofs=dofs, nodes=nodes, source=source)


def listed_component(
    path: Path,
    matrices: Matrices,
    dofs: DofSet,
    nodes: Nodes | None,
    name: str,
    source: Any,
    recovery: tuple[Recovery, ...] = (),
) -> Component:
    """The component, rows with direction 0 as its modal part whatever their place; ReadError as `listed_model`."""
    _check_shapes(path, matrices, dofs)
    modal = dofs.direction == 0
    order = np.r_[np.flatnonzero(~modal), np.flatnonzero(modal)]
    ordered = {k: None if m is None else reordered(m, order) for k, m in matrices.items()}
    return Component(
        name=name,
        **_given(ordered),
        boundary=DofSet(dofs.node[~modal], dofs.direction[~modal]),
        modal_ids=dofs.node[modal].tolist(),
        nodes=nodes,
        recovery={r.name: r for r in recovery},
        source=source,
    )


def reordered(matrix: Matrix, order: Any) -> Matrix:
    """Rows and columns in this order."""
    return matrix.tocsr()[order][:, order] if is_sparse(matrix) else matrix[np.ix_(order, order)]


def _given(matrices: Matrices) -> dict[str, Any]:
    return dict(matrices)


def _check_shapes(path: Path, matrices: Matrices, dofs: DofSet) -> None:
    for kind, matrix in matrices.items():
        if matrix is not None and matrix.shape != (len(dofs), len(dofs)):
            raise ReadError(path, f"{kind} has shape {matrix.shape}, but {len(dofs)} DOF are listed")
