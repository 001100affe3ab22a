"""Space-frame components for tests: 3-D beams written down directly, so that coupled plants have an independent peer."""

from __future__ import annotations

import numpy as np

from flexplant.assembly import Connection, System, couple
from flexplant.model.component import Component
from flexplant.model.geometry import Nodes
from flexplant.model.recovery import Recovery

E_MODULUS, SHEAR, DENSITY, AREA, INERTIA, TORSION = 7e10, 2.6e10, 2700.0, 4e-4, (1.3e-8, 2.1e-8), 2.2e-8


def beam_element(length: float) -> tuple[np.ndarray, np.ndarray]:
    """(12, 12) stiffness and consistent mass of a beam along x; DOF u v w rx ry rz at each end."""
    k, m = np.zeros((12, 12)), np.zeros((12, 12))
    axial, mass = np.array([[1, -1], [-1, 1]]), DENSITY * AREA * length
    for i, stiffness, inertia in ((0, E_MODULUS * AREA, mass), (3, SHEAR * TORSION, DENSITY * sum(INERTIA) * length)):
        k[np.ix_([i, i + 6], [i, i + 6])] += stiffness / length * axial
        m[np.ix_([i, i + 6], [i, i + 6])] += inertia / 6 * np.array([[2, 1], [1, 2]])
    a = length
    bend = np.array(
        [
            [12, 6 * a, -12, 6 * a],
            [6 * a, 4 * a**2, -6 * a, 2 * a**2],
            [-12, -6 * a, 12, -6 * a],
            [6 * a, 2 * a**2, -6 * a, 4 * a**2],
        ]
    )
    consistent = np.array(
        [
            [156, 22 * a, 54, -13 * a],
            [22 * a, 4 * a**2, 13 * a, -3 * a**2],
            [54, 13 * a, 156, -22 * a],
            [-13 * a, -3 * a**2, -22 * a, 4 * a**2],
        ]
    )
    for at, inertia, sign in (([1, 5, 7, 11], INERTIA[0], 1), ([2, 4, 8, 10], INERTIA[1], -1)):
        flip = np.diag([1, sign, 1, sign])
        k[np.ix_(at, at)] += E_MODULUS * inertia / a**3 * flip @ bend @ flip
        m[np.ix_(at, at)] += mass / 420 * flip @ consistent @ flip
    return k, m


def beam(name: str, start: float, stop: float, elements: int, *, damping: float = 0.0, first: int = 1) -> Component:
    """A beam along x between two stations; every node is boundary; damping: Z = damping * K (0: none)."""
    n = 6 * (elements + 1)
    K, M = np.zeros((n, n)), np.zeros((n, n))
    k, m = beam_element((stop - start) / elements)
    for e in range(elements):
        at = slice(6 * e, 6 * e + 12)
        K[at, at] += k
        M[at, at] += m
    ids = list(range(first, first + elements + 1))
    x = np.linspace(start, stop, elements + 1)
    nodes = Nodes(ids=ids, positions=np.c_[x, 0 * x, 0 * x])
    strain = np.zeros((2, n))
    strain[0, [2, 8]], strain[1, [0, 6]] = (-1, 1), (-1, 1)
    recovery = [Recovery("gauge", ["bend.z", "axial"], displacement=strain, units="m")]
    boundary = [(i, "123456") for i in ids]
    Z = damping * K if damping else None
    return Component(name=name, mass=M, stiffness=K, damping=Z, boundary=boundary, nodes=nodes, recovery=recovery)


def two_beams(method: str = "dual", *, grounded: bool = False, damping: float = 2e-5) -> System:
    """Beams "a" (nodes 1-5) and "b" (11-14) joined at 5-11; damping differs, so the modes are coupled by it."""
    parts = [beam("a", 0.0, 1.0, 4, damping=damping), beam("b", 1.0, 1.6, 3, damping=3 * damping, first=11)]
    connections = [Connection("a", "b", pairs=[(5, 11)])]
    if grounded:
        connections.append(Connection("a", "ground", pairs=[1]))
    return couple(parts, connections, method=method)


def one_beam_matrices(damping: float = 2e-5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K, M, Z of the same structure assembled by hand: nodes 1-5 then 12-14."""
    a, b = beam("a", 0.0, 1.0, 4, damping=damping), beam("b", 1.0, 1.6, 3, damping=3 * damping, first=11)
    L = np.zeros((54, 48))
    L[:30, :30] = np.eye(30)
    L[30:, 24:] = np.eye(24)
    blocks = [np.zeros((54, 54)) for _ in range(3)]
    for block, kind in zip(blocks, ("stiffness", "mass", "damping"), strict=True):
        block[:30, :30], block[30:, 30:] = getattr(a, kind), getattr(b, kind)
    K, M, Z = (L.T @ block @ L for block in blocks)
    return K, M, Z
