"""Descriptor plants of coupled systems, sparse (equations 12-24)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.assembly import System
from flexplant.plant.channels import OutputRows, checked_system, input_matrix, output_matrices, refuse_structural_damping
from flexplant.plant.origin import origin
from flexplant.plant.state_space import Descriptor


def descriptor(system: System, *, inputs: Sequence[str], outputs: Sequence[str], name: str = "plant") -> Descriptor:
    """E x' = A x + B u, y = C x + D u with E = [[I, 0], [0, M]], A = [[0, I], [-K, -Z]], B = [0; F], C = [DRM, 0].

    x = [z; z'], z the coupled coordinates: p and the multipliers (dual: M is padded with zeros, so E is singular) or the
    independent coordinates (primal). Each output with an acceleration part A_i z'' adds one algebraic state w_i = A_i z'':
    a row [0, A_i, 0] in E and [0, 0, 1] in A. Interface forces are lambda = (B B^T)^-1 B (F u - K p - Z p' - M p'').
    Raises InputError with the nearest names for unknown inputs or outputs, and for structural damping.
    """
    checked_system(system, "descriptor")
    refuse_structural_damping(
        system,
        "descriptor",
        "use structural_frequency_response, or with_equivalent_viscous_damping(component, hz) before coupling",
    )
    columns, rows = input_matrix(system, inputs), output_matrices(system, outputs)
    basis = system.to_coupled(sp.eye_array(system.n, format="csr"))
    n, with_acceleration = system.n_coupled, _acceleration_rows(rows)
    extra, acceleration = with_acceleration.size, None
    if rows.acceleration is not None and extra:
        acceleration = sp.csr_array(rows.acceleration[with_acceleration] @ basis)
    E = _blocks(n, extra, {(0, 0): sp.eye_array(n), (1, 1): system.mass, (2, 1): acceleration})
    A = _blocks(
        n, extra, {(0, 1): sp.eye_array(n), (1, 0): -system.stiffness, (1, 1): -system.damping, (2, 2): sp.eye_array(extra)}
    )
    F = sp.csr_array(basis.T @ columns.matrix)
    nu, ny = len(columns.names), len(rows.names)
    B = sp.vstack([sp.csr_array((n, nu)), F, sp.csr_array((extra, nu))])
    place = sp.csr_array((np.ones(extra), (with_acceleration, np.arange(extra))), shape=(ny, extra))
    velocity = sp.csr_array((ny, n)) if rows.velocity is None else rows.velocity @ basis
    C = sp.hstack([rows.displacement @ basis, velocity, place])
    D = np.zeros((ny, nu)) if rows.force is None else (rows.force @ columns.matrix).toarray()
    units = {"input_units": columns.units, "output_units": rows.units}
    return Descriptor(E, A, B, C, D, columns.names, rows.names, name=name, **units, source=origin(system))


def _acceleration_rows(rows: OutputRows) -> Any:
    if rows.acceleration is None:
        return np.zeros(0, dtype=int)
    return np.flatnonzero(np.diff(rows.acceleration.indptr))


def _blocks(n: int, extra: int, parts: dict[tuple[int, int], Any]) -> sp.csr_array:
    """A (2 n + extra) square matrix from blocks at (row, column) of the partition [n, n, extra]; absent ones are zero."""
    sizes = (n, n, extra)
    grid = [[parts.get((i, j)) for j in range(3)] for i in range(3)]
    filled = [[sp.csr_array((sizes[i], sizes[j])) if grid[i][j] is None else grid[i][j] for j in range(3)] for i in range(3)]
    return sp.csr_array(sp.block_array(filled))
