"""Writes the plate of this example, plate.npz, and frequencies of unreduced models by LAPACK to compare with.

python make.py
"""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

import flexplant as fp

CELLS, SIZE = (8, 5, 1), np.array([0.4, 0.25, 0.02])  # bricks, metres
YOUNG, POISSON, DENSITY = 70e9, 0.33, 2700.0
CORNERS = np.array(list(product((-1, 1), repeat=3)))


def brick(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass (24, 24) of a trilinear brick."""
    k, m = np.zeros((24, 24)), np.zeros((24, 24))
    shear, lame = YOUNG / 2 / (1 + POISSON), YOUNG * POISSON / (1 + POISSON) / (1 - 2 * POISSON)
    law = np.diag([2 * shear] * 3 + [shear] * 3)
    law[:3, :3] += lame
    for at in np.array(list(product((-1, 1), repeat=3))) / np.sqrt(3):
        terms = 1 + CORNERS * at
        shape, volume = terms.prod(axis=1) / 8, edges.prod() / 8
        slope = np.array([CORNERS[:, d] * np.delete(terms, d, axis=1).prod(axis=1) / 4 / edges[d] for d in range(3)])
        strain = np.zeros((6, 8, 3))
        for d in range(3):
            strain[d, :, d] = slope[d]
            strain[3 + d, :, (d + 1) % 3], strain[3 + d, :, (d + 2) % 3] = slope[(d + 2) % 3], slope[(d + 1) % 3]
        b = strain.reshape(6, 24)
        k += volume * b.T @ law @ b
        m += volume * DENSITY * np.kron(np.outer(shape, shape), np.eye(3))
    return k, m


def plate(name: str, cells: tuple[int, int, int] = CELLS, size: np.ndarray = SIZE) -> fp.FiniteElementModel:
    """A free plate of one layer of bricks, three DOF a node; node ids run fastest through the thickness, then along y."""
    count = np.array(cells) + 1
    ids = np.arange(count.prod()).reshape(count)
    first = ids[:-1, :-1, :-1].ravel()
    nodes = first[:, None] + [ids[tuple((c + 1) // 2)] for c in CORNERS]
    rows = (3 * nodes[:, :, None] + np.arange(3)).reshape(-1, 24)
    pairs = np.broadcast_arrays(rows[:, :, None], rows[:, None])
    place = tuple(x.ravel() for x in pairs)
    k, m = (
        sp.csr_array(sp.coo_array((np.tile(x.ravel(), len(rows)), place), shape=(3 * ids.size, 3 * ids.size)))
        for x in brick(size / cells)
    )
    positions = np.stack(np.meshgrid(*(np.linspace(0, s, c) for s, c in zip(size, count, strict=True)), indexing="ij"), axis=-1)
    number = 1 + np.arange(ids.size)
    return fp.FiniteElementModel(
        name=name,
        mass=(m + m.T) / 2,
        stiffness=(k + k.T) / 2,
        dofs=[(int(n), d) for n in number for d in (1, 2, 3)],
        nodes=fp.Nodes(ids=number, positions=positions.reshape(-1, 3)),
    )


def frequencies_hz(model: fp.FiniteElementModel, count: int = 20) -> np.ndarray:
    """Of the unreduced model, by LAPACK; the six rigid-body modes are written as zeros."""
    w2 = la.eigh(model.stiffness.toarray(), model.mass.toarray(), eigvals_only=True, subset_by_index=[0, count - 1])
    return np.r_[np.zeros(6), np.sqrt(w2[6:]) / (2 * np.pi)]


def make(folder: Path) -> None:
    """The files of the studies in this folder."""
    one = plate("plate")
    fp.write_model(one, folder / "plate.npz")
    np.savetxt(folder / "plate_hz.txt", frequencies_hz(one))
    two = plate("two", (2 * CELLS[0], *CELLS[1:]), SIZE * [2, 1, 1])
    np.savetxt(folder / "two_plates_hz.txt", frequencies_hz(two))


if __name__ == "__main__":
    make(Path(__file__).parent)
