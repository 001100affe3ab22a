"""Interface forces as outputs: the multipliers of the coupling, recovered from p also where the constraints are eliminated."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from flexplant.assembly import System
from flexplant.errors import InputError, nearest

ForceRow: TypeAlias = dict[str, sp.csr_array]


def force_labels(system: System, connection: str, which: str, name: str) -> list[str]:
    """Constraint labels "connection.node_a.direction" that `which` ("", "node" or "node.directions") selects.

    Raises InputError for a connection or node that is not there, and for a redundant row, whose force is not unique.
    """
    rows = [row.label for r in system.connections if r.connection.name == connection for row in r.rows]
    if not rows:
        names = [str(r.connection.name) for r in system.connections]
        raise InputError(f"{name!r}: there is no connection {connection!r}." + nearest(connection, names))
    node, _, directions = which.partition(".")
    wanted = [f"{connection}.{node}.{d}" for d in directions] if directions else [x for x in rows if not node or _node(x) == node]
    for label in wanted or [f"{connection}.{which}"]:
        if label in system.redundant:
            raise InputError(f"{name!r}: the constraint {label} follows from other constraints, so its force is not unique")
        if label not in rows:
            shown = [f"{connection}.force.{_node(x)}.{x.rpartition('.')[2]}" for x in rows]
            raise InputError(f"{name!r}: connection {connection!r} has no such row." + nearest(name, shown))
    return wanted


def _node(label: str) -> str:
    return label.split(".")[-2]


def force_row(system: System, label: str) -> ForceRow:
    """Rows (1, n) over p, p', p'' and over the applied forces F u of one interface force: what side a exerts on side b.

    Rigid: M p'' + Z p' + K p + B^T lambda = F u gives lambda = (B B^T)^-1 B (F u - K p - Z p' - M p'').
    Compliant: k (u_a - u_b) + c (u_a - u_b)'.
    """
    if label not in system.constraint_labels:
        return _compliant_row(system, label)
    B = system.constraints
    unit = np.zeros(B.shape[0])
    unit[system.constraint_labels.index(label)] = 1.0
    pick = splu(sp.csc_array(B @ B.T)).solve(unit)
    row = sp.csr_array(sp.csr_array(np.where(abs(pick) > 1e-15 * abs(pick).max(), pick, 0.0)[None, :]) @ B)
    return {
        "displacement": -row @ system.uncoupled_stiffness,
        "velocity": -row @ system.uncoupled_damping,
        "acceleration": -row @ system.uncoupled_mass,
        "force": row,
    }


def _compliant_row(system: System, label: str) -> ForceRow:
    resolved = next(r for r in system.connections if any(row.label == label for row in r.rows))
    labels = [row.label for row in resolved.rows]
    entries = [(i, system.row(*dof), value) for i, row in enumerate(resolved.rows) for dof, value in row.terms.items()]
    i, j, values = zip(*entries, strict=True)
    relative = sp.csr_array((values, (i, j)), shape=(len(labels), system.n))
    out = {}
    for kind, matrix in (("displacement", resolved.connection.stiffness), ("velocity", resolved.connection.damping)):
        if matrix is not None:
            springs = sp.csr_array(sp.kron(sp.eye_array(len(labels) // len(np.asarray(matrix))), matrix))
            out[kind] = sp.csr_array(springs[[labels.index(label)], :] @ relative)
    return out
