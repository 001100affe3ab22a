"""From MYSTRAN's G-set stiffness and mass to the free set: RBE2 eliminated, DOF without stiffness removed.

Layout of a stored ``*_KM.npz`` (SI, no pickled objects):

- ``dof`` (n, 2): grid and component (1-6) of each row, ascending;
- ``Ki``, ``Kj``, ``Kv``: the upper triangle of K with the diagonal: row and column from 0, value;
- ``Mi``, ``Mj``, ``Mv``: the same of M.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from mystran_files import read_grids, read_rigids, read_sparse

NO_STIFFNESS = 1e-8  # of the stiffest DOF of the same grid: drops the drilling rotations of flat shells


@dataclass(frozen=True, eq=False)
class Matrices:
    """K and M of the free set, and the grid and component of each row."""

    dof: np.ndarray
    stiffness: sp.csr_array
    mass: sp.csr_array


def rigid_link(offset: np.ndarray) -> np.ndarray:
    """Displacements (6) at a point `offset` away from a grid, per displacement (6) of the grid."""
    x, y, z = offset
    link = np.eye(6)
    link[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return link


def expansion(deck: Path) -> tuple[sp.csr_array, np.ndarray]:
    """The matrix that gives every G-set displacement from the ones the RBE2s leave independent; and which those are.

    G-set rows are in ascending grid and component.
    """
    grids = read_grids(deck)
    first = {grid: 6 * i for i, grid in enumerate(sorted(grids))}
    full = sp.lil_array(sp.eye_array(6 * len(grids)))
    dependent: list[int] = []
    for grid, directions, dependents in read_rigids(deck):
        for other in dependents:
            link = rigid_link(grids[other] - grids[grid])
            for direction in map(int, directions):
                row = first[other] + direction - 1
                full[row, row] = 0.0
                full[row, first[grid] : first[grid] + 6] = link[direction - 1]
                dependent.append(row)
    independent = np.setdiff1d(np.arange(6 * len(grids)), dependent)
    return sp.csr_array(full.tocsc()[:, independent]), independent


def has_stiffness(stiffness: sp.csr_array, dof: np.ndarray) -> np.ndarray:
    """Which DOF have stiffness, compared with the stiffest DOF of the same grid."""
    diagonal = stiffness.diagonal()
    _, place = np.unique(dof[:, 0], return_inverse=True)
    largest = np.zeros(place.max() + 1)
    np.maximum.at(largest, place, diagonal)
    return diagonal > NO_STIFFNESS * largest[place]


def symmetric(matrix: sp.csr_array) -> sp.csr_array:
    return sp.csr_array((matrix + matrix.T) / 2)


def free_set(deck: Path, stiffness: Path, mass: Path) -> Matrices:
    """K and M of the free set, from a deck and MYSTRAN's sparse KGG (.L1L) and MGG (.L1R)."""
    spread, independent = expansion(deck)
    size = spread.shape[0]
    k, m = (symmetric(spread.T @ read_sparse(path, size) @ spread) for path in (stiffness, mass))
    grids = np.array(sorted(read_grids(deck)))
    dof = np.column_stack([grids[independent // 6], independent % 6 + 1]).astype("i4")
    keep = np.flatnonzero(has_stiffness(k, dof))
    return Matrices(dof[keep], k[keep][:, keep], m[keep][:, keep])


def triangle(letter: str, matrix: sp.csr_array) -> dict[str, np.ndarray]:
    upper = sp.triu(matrix, format="csc").tocoo()
    upper.eliminate_zeros()
    return {letter + "i": upper.row.astype("i4"), letter + "j": upper.col.astype("i4"), letter + "v": upper.data}


def save(path: Path, matrices: Matrices) -> None:
    parts = triangle("K", matrices.stiffness) | triangle("M", matrices.mass)
    np.savez_compressed(path, dof=matrices.dof, **parts)


def load(path: Path) -> Matrices:
    """K and M, whole, from a stored ``*_KM.npz``."""
    with np.load(path) as data:
        size = len(data["dof"])
        upper = [sp.coo_array((data[x + "v"], (data[x + "i"], data[x + "j"])), shape=(size, size)) for x in "KM"]
        k, m = (sp.csr_array(u + sp.triu(u, k=1).T) for u in upper)
        return Matrices(data["dof"], k, m)
