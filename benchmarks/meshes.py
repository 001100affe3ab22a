"""Finite-element models that the benchmarks generate themselves: a solid block and a cylindrical shell, any size."""

from __future__ import annotations

from itertools import product

import numpy as np
import scipy.sparse as sp

import flexplant as fp

YOUNG, POISSON, DENSITY = 70e9, 0.33, 2700.0
GAUSS = {2: ((-1 / 3**0.5, 1.0), (1 / 3**0.5, 1.0)), 3: ((-(0.6**0.5), 5 / 9), (0.0, 8 / 9), (0.6**0.5, 5 / 9))}
CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


def assembled(element: np.ndarray, rows: np.ndarray, size: int) -> sp.csr_array:
    """Sum of element matrices (n_e, k, k) or one (k, k) for all, at rows (n_e, k)."""
    n_e, k = rows.shape
    values = np.broadcast_to(element, (n_e, k, k)).ravel()
    at = (np.repeat(rows, k, axis=1).ravel(), np.tile(rows, (1, k)).ravel())
    return sp.csr_array(sp.coo_array((values, at), shape=(size, size)).tocsr())


def hexahedron(h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(24, 24) stiffness and consistent mass of a trilinear box with edges h (3,)."""
    corners = np.array(list(product((-1, 1), repeat=3)))
    lame, shear = YOUNG * POISSON / (1 + POISSON) / (1 - 2 * POISSON), YOUNG / 2 / (1 + POISSON)
    law = np.diag([2 * shear] * 3 + [shear] * 3)
    law[:3, :3] += lame
    k, m = np.zeros((24, 24)), np.zeros((24, 24))
    for point in product(GAUSS[2], repeat=3):
        x = np.array([p for p, _ in point])
        factors = 1 + corners * x
        shape = factors.prod(axis=1) / 8
        slope = np.array([corners[:, i] * np.delete(factors, i, 1).prod(axis=1) / 8 * 2 / h[i] for i in range(3)])
        strain = np.zeros((6, 24))
        for i in range(3):
            strain[i, i::3] = slope[i]
        for row, (i, j) in enumerate(((0, 1), (1, 2), (2, 0)), start=3):
            strain[row, i::3], strain[row, j::3] = slope[j], slope[i]
        volume = h.prod() / 8
        k += volume * strain.T @ law @ strain
        m += DENSITY * volume * np.kron(np.outer(shape, shape), np.eye(3))
    return k, m


def solid(cells: tuple[int, int, int], size: tuple[float, float, float] = (1.0, 0.7, 0.5)) -> fp.FiniteElementModel:
    """A free block of trilinear hexahedra; 3 (cells + 1) DOF an edge, nodes counted from 1, x slowest."""
    counts = np.array(cells) + 1
    axes = [np.linspace(0, s, c) for s, c in zip(size, counts, strict=True)]
    ids = np.arange(counts.prod()).reshape(counts)
    corner = [
        ids[slice(a, a + counts[0] - 1), slice(b, b + counts[1] - 1), slice(c, c + counts[2] - 1)].ravel()
        for a, b, c in product((0, 1), repeat=3)
    ]
    nodes = np.array(corner).T
    rows = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), 24)
    k, m = hexahedron(np.array(size) / np.array(cells))
    n = 3 * counts.prod()
    positions = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return model("solid", assembled(k, rows, n), assembled(m, rows, n), positions, 3)


def plate(a: float, b: float, thickness: float) -> tuple[np.ndarray, np.ndarray]:
    """(24, 24) flat shell rectangle, 6 DOF a node: bilinear membrane, Adini-Clough-Melosh bending, weak drilling springs."""
    k, m = np.zeros((24, 24)), np.zeros((24, 24))
    law = YOUNG / (1 - POISSON**2) * np.array([[1, POISSON, 0], [POISSON, 1, 0], [0, 0, (1 - POISSON) / 2]])
    x, y = (CORNERS * [a / 2, b / 2]).T
    inverse = np.linalg.inv(np.stack([_cubic(x, y), _cubic(x, y, 0, 1), -_cubic(x, y, 1, 0)], axis=1).reshape(12, 12))
    bend, plane = np.r_[2:24:6, 3:24:6, 4:24:6].reshape(3, 4).T.ravel(), np.r_[0:24:6, 1:24:6].reshape(2, 4).T.ravel()
    for (u, wu), (v, wv) in product(GAUSS[3], repeat=2):
        s, t, area = u * a / 2, v * b / 2, wu * wv * a * b / 4
        curvature = np.array([_cubic(s, t, 2, 0), _cubic(s, t, 0, 2), 2 * _cubic(s, t, 1, 1)]) @ inverse
        shape = (1 + CORNERS[:, 0] * u) * (1 + CORNERS[:, 1] * v) / 4
        slope = [CORNERS[:, 0] * (1 + CORNERS[:, 1] * v) / 2 / a, CORNERS[:, 1] * (1 + CORNERS[:, 0] * u) / 2 / b]
        strain = np.zeros((3, 8))
        strain[0, 0::2], strain[1, 1::2], strain[2, 0::2], strain[2, 1::2] = slope[0], slope[1], slope[1], slope[0]
        w = _cubic(s, t) @ inverse
        k[np.ix_(bend, bend)] += thickness**3 / 12 * area * curvature.T @ law @ curvature
        k[np.ix_(plane, plane)] += thickness * area * strain.T @ law @ strain
        m[np.ix_(bend, bend)] += DENSITY * thickness * area * np.outer(w, w)
        m[np.ix_(plane, plane)] += DENSITY * thickness * area * np.kron(np.outer(shape, shape), np.eye(2))
    drill = np.arange(5, 24, 6)
    for i, (u, v) in enumerate(CORNERS):  # a weak spring between a node's drilling rotation and the membrane's rotation there
        twist = np.zeros(24)
        twist[drill[i]] = 1.0
        twist[plane[0::2]] += CORNERS[:, 1] * (1 + CORNERS[:, 0] * u) / 4 / b
        twist[plane[1::2]] -= CORNERS[:, 0] * (1 + CORNERS[:, 1] * v) / 4 / a
        k += 1e-3 * YOUNG * thickness * a * b / 4 * np.outer(twist, twist)
    m[drill, drill] += DENSITY * thickness**3 / 12 * a * b / 4
    return k, m


def _cubic(x, y, i: int = 0, j: int = 0) -> np.ndarray:
    """Derivatives (i times by x, j times by y) of the twelve terms of the plate's polynomial."""
    powers = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3), (3, 1), (1, 3)]
    return np.stack([_power(x, p, i) * _power(y, q, j) for p, q in powers], axis=-1)


def _power(x, p: int, times: int):
    factor = np.prod(np.arange(p, p - times, -1)) if times else 1
    return np.zeros_like(x, dtype=float) if p < times else factor * np.asarray(x, dtype=float) ** (p - times)


def shell(around: int, along: int, thickness: float = 0.003) -> fp.FiniteElementModel:
    """A free cylinder (radius 0.5 m, length 2 m) of flat rectangles, 6 around (along + 1) DOF; ring 0 holds the lowest ids."""
    radius, length = 0.5, 2.0
    angle = 2 * np.pi * np.arange(around) / around
    chord = 2 * radius * np.sin(np.pi / around)
    k, m = plate(chord, length / along, thickness)
    middle = angle + np.pi / around
    zero = np.zeros(around)
    frame = np.stack(
        [[-np.sin(middle), np.cos(middle), zero], [zero, zero, zero + 1], [np.cos(middle), np.sin(middle), zero]]
    ).transpose(2, 0, 1)  # rows: element x (tangent), y (axis), z (outward)
    turn = np.einsum("ij,ekl->eikjl", np.eye(8), frame).reshape(around, 24, 24)
    k, m = (np.einsum("eji,jk,ekl->eil", turn, x, turn, optimize=True) for x in (k, m))
    i, j = np.meshgrid(np.arange(around), np.arange(along), indexing="ij")
    right = (i + 1) % around
    nodes = np.stack([j * around + i, j * around + right, (j + 1) * around + right, (j + 1) * around + i], axis=-1).reshape(-1, 4)
    rows = (6 * nodes[:, :, None] + np.arange(6)).reshape(-1, 24)
    n = 6 * around * (along + 1)
    level = np.repeat(np.linspace(0, length, along + 1), around)
    positions = np.c_[np.tile(radius * np.cos(angle), along + 1), np.tile(radius * np.sin(angle), along + 1), level]
    return model("shell", *(assembled(np.repeat(x, along, axis=0), rows, n) for x in (k, m)), positions, 6)


def model(name: str, k: sp.csr_array, m: sp.csr_array, positions: np.ndarray, directions: int) -> fp.FiniteElementModel:
    ids = np.arange(1, len(positions) + 1)
    dofs = fp.DofSet(np.repeat(ids, directions), np.tile(np.arange(1, directions + 1), len(ids)))
    symmetric = [sp.csr_array(0.5 * (x + x.T)) for x in (k, m)]
    return fp.FiniteElementModel(name=name, stiffness=symmetric[0], mass=symmetric[1], dofs=dofs, nodes=fp.Nodes(ids, positions))


def held(model: fp.FiniteElementModel, count: int) -> list[tuple[int, int]]:
    """A boundary of `count` DOF: whole nodes spread over the face (ring) that the lowest ids make."""
    width = int(model.dofs.direction.max())
    height = model.nodes.positions[:, 2 if model.name == "shell" else 0]
    face = np.flatnonzero(height < 1e-9) + 1
    chosen = face[np.linspace(0, len(face) - 1, count // width).astype(int)]
    return [(int(node), d) for node in chosen for d in range(1, width + 1)]
