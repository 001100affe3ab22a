"""Interface nodes: a patch of nodes moved rigidly by one node, or averaged by it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import scipy.linalg as la
import scipy.sparse as sp

from flexplant.errors import InputError, ModelError, expect, expect_choice, expect_count, nearest
from flexplant.model.arrays import FloatArray, IntArray, Matrix, items_of, real_values
from flexplant.model.component import FiniteElementModel
from flexplant.model.dofs import DofSet, expand_directions
from flexplant.model.geometry import Nodes, point, rigid_body_vectors

RANK = 1e-8  # of the patch's largest motion: below it the patch does not feel the interface node's motion
KINDS = ("rigid", "average")


def with_interface_node(
    model: FiniteElementModel,
    node: int,
    position: npt.ArrayLike,
    patch: Sequence[int],
    *,
    kind: str = "rigid",
    directions: str = "123456",
    weights: npt.ArrayLike | None = None,
) -> FiniteElementModel:
    """The model with a new node of six DOF (basic frame) that stands for a patch of nodes; take it as boundary.

    kind "rigid" (RBE2): the patch's DOF in `directions` follow the node, u_patch = C r, and leave the model.
    kind "average" (RBE3): the node takes the patch's weighted least-squares rigid motion, r = (C^T W C)^-1 C^T W u_patch, of
    translations; the patch keeps its flexibility, and a force on the node is shared out by the weights.
    position: (3,) basic frame. weights: one a patch node. Raises ModelError for unknown nodes, a model without positions, or
    a patch (one node, a straight line) that leaves a motion of the node undefined; InputError for impossible arguments.
    """
    expect(model, FiniteElementModel, "with_interface_node", "read_model gives one from a file")
    expect_choice(kind, KINDS, "interface node: kind")
    expect_count(node, "interface node: node", most=np.iinfo(np.int64).max)
    patch = _checked_patch(model, patch)
    nodes = _checked_nodes(model, node)
    at = point(position, "interface node: position")
    wanted = expand_directions(directions)
    if kind == "rigid" and weights is not None:
        raise InputError("interface node: weights are those of kind='average'; a rigid patch has none")
    rows = np.flatnonzero(
        np.isin(model.dofs.node, patch) & np.isin(model.dofs.direction, wanted if kind == "rigid" else (1, 2, 3))
    )
    motion = rigid_body_vectors(nodes, DofSet(model.dofs.node[rows], model.dofs.direction[rows]), about=at)
    _check_rank(model, node, motion)
    if kind == "rigid":
        dependent, link, others = rows, motion, np.zeros(0, dtype=np.int64)
        spread = np.zeros((rows.size, 0))
    else:
        dependent, link, others, spread = _averaged(motion, rows, _row_weights(model, rows, patch, weights))
    return _transformed(model, node, at, dependent, link, others, spread)


def _checked_patch(model: FiniteElementModel, patch: Sequence[int]) -> list[int]:
    listed = items_of(patch)
    if listed is None or not all(isinstance(p, (int, np.integer)) and not isinstance(p, bool) for p in listed):
        raise InputError(f"interface node: patch must be a list of node ids such as [101, 102], got {patch!r:.60}")
    known = set(model.dofs.node.tolist())
    for missing in [p for p in listed if p not in known][:1]:
        raise ModelError(f"model {model.name!r} has no node {missing}." + nearest(str(missing), map(str, sorted(known))))
    if len(set(listed)) < len(listed):
        raise InputError("interface node: patch lists a node twice")
    return [int(p) for p in listed]


def _checked_nodes(model: FiniteElementModel, node: int) -> Nodes:
    if model.nodes is None:
        raise ModelError(f"model {model.name!r} has no node positions, so an interface node cannot be placed")
    if node in model.nodes:
        raise ModelError(f"model {model.name!r} has a node {node} already; give the interface node another id")
    return model.nodes


def _check_rank(model: FiniteElementModel, node: int, motion: FloatArray) -> None:
    size = np.linalg.norm(motion, axis=0)
    if motion.shape[0] < 6 or not size.all() or la.svdvals(motion / size)[-1] < RANK:
        raise ModelError(
            f"model {model.name!r}: the patch of interface node {node} does not define all six motions (too few nodes, or on one "
            "line); add nodes off the line, or take the nodes themselves as boundary"
        )


def _row_weights(model: FiniteElementModel, rows: IntArray, patch: Sequence[int], weights: npt.ArrayLike | None) -> FloatArray:
    given = np.ones(len(patch)) if weights is None else real_values(weights, "interface node: weights")
    if given.shape != (len(patch),) or not (np.isfinite(given).all() and (given > 0).all()):
        raise InputError(f"interface node: weights must be {len(patch)} positive numbers, one a patch node")
    by_node = dict(zip((int(p) for p in patch), given, strict=True))
    return np.array([by_node[int(n)] for n in model.dofs.node[rows]])


def _averaged(motion: FloatArray, rows: IntArray, weights: FloatArray) -> tuple[IntArray, FloatArray, IntArray, FloatArray]:
    """Six patch DOF solved from r = A u_patch: u_dependent = A_d^-1 (r - A_o u_others)."""
    weighted = motion * weights[:, None]
    average = la.solve(motion.T @ weighted, weighted.T, assume_a="pos")
    size = np.linalg.norm(average, axis=1)
    pivots = la.qr(average / size[:, None], mode="r", pivoting=True)[-1]
    chosen, rest = pivots[:6], np.sort(pivots[6:])
    inverse = la.inv(average[:, chosen])
    return rows[chosen], inverse, rows[rest], -inverse @ average[:, rest]


def _transformed(
    model: FiniteElementModel, node: int, position: FloatArray, dependent: IntArray, link: FloatArray,
    others: IntArray, spread: FloatArray,
) -> FiniteElementModel:  # fmt: skip
    """T^T A T with u_dependent = link r + spread u_others; the new DOF come last."""
    assert model.nodes is not None
    n = len(model.dofs)
    kept = np.setdiff1d(np.arange(n), dependent)
    place = np.full(n, -1)
    place[kept] = np.arange(kept.size)
    t = sp.lil_array((n, kept.size + 6))
    t[kept, np.arange(kept.size)] = 1.0
    t[np.ix_(dependent, kept.size + np.arange(6))] = link
    if others.size:
        t[np.ix_(dependent, place[others])] = spread
    basis = sp.csr_array(t)

    def changed(matrix: Matrix | None) -> Matrix | None:
        return None if matrix is None else sp.csr_array(basis.T @ sp.csr_array(matrix) @ basis)

    frames = model.nodes.frames
    return replace(
        model,
        mass=changed(model.mass),
        stiffness=changed(model.stiffness),
        damping=changed(model.damping),
        dofs=DofSet(np.r_[model.dofs.node[kept], np.full(6, node)], np.r_[model.dofs.direction[kept], np.arange(1, 7)]),
        nodes=Nodes(
            np.r_[model.nodes.ids, node],
            np.vstack([model.nodes.positions, position]),
            None if frames is None else np.concatenate([frames, np.eye(3)[None]]),
        ),
    )
