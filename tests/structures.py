"""Small structures for tests, made from textbook elements: an independent road to the matrices that flexplant couples."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
from scipy.spatial.transform import Rotation

from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.geometry import Nodes, Placement

TUBE = {"ea": 2.1e7, "ei": 3.0e4, "gj": 2.3e4, "rho_a": 2.4, "rho_ip": 7e-3}


def random_rotation(seed: int) -> np.ndarray:
    return Rotation.random(rng=np.random.default_rng(seed)).as_matrix()


def _bending(upper: list[float]) -> np.ndarray:
    """Symmetric (4, 4) matrix from its upper triangle, row by row."""
    out = np.zeros((4, 4))
    out[np.triu_indices(4)] = upper
    return out + np.triu(out, 1).T


def beam_matrices(
    length: float, *, ea: float, ei: float, gj: float, rho_a: float, rho_ip: float
) -> tuple[np.ndarray, np.ndarray]:
    """(12, 12) Euler-Bernoulli stiffness and consistent mass of a round beam along local x (Przemieniecki 1968)."""
    k, m = np.zeros((12, 12)), np.zeros((12, 12))
    pair, share = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([[2.0, 1.0], [1.0, 2.0]]) / 6
    k[np.ix_([0, 6], [0, 6])], k[np.ix_([3, 9], [3, 9])] = ea / length * pair, gj / length * pair
    m[np.ix_([0, 6], [0, 6])], m[np.ix_([3, 9], [3, 9])] = rho_a * length * share, rho_ip * length * share
    a = length
    bend = ei / a**3 * _bending([12, 6 * a, -12, 6 * a, 4 * a**2, -6 * a, 2 * a**2, 12, -6 * a, 4 * a**2])
    inertia = rho_a * a / 420 * _bending([156, 22 * a, 54, -13 * a, 4 * a**2, 13 * a, -3 * a**2, 156, -22 * a, 4 * a**2])
    for rows, sign in (([1, 5, 7, 11], 1.0), ([2, 4, 8, 10], -1.0)):  # in the x-z plane a positive slope is a negative rotation
        turn = np.diag([1.0, sign, 1.0, sign])
        k[np.ix_(rows, rows)] += turn @ bend @ turn
        m[np.ix_(rows, rows)] += turn @ inertia @ turn
    return k, m


def local_axes(direction: np.ndarray) -> np.ndarray:
    """Rows: a right-handed frame whose x axis is `direction`."""
    x = direction / np.linalg.norm(direction)
    y = np.cross(np.eye(3)[np.argmin(abs(x))], x)
    y /= np.linalg.norm(y)
    return np.array([x, y, np.cross(x, y)])


def blocks(frame: np.ndarray, count: int) -> np.ndarray:
    return la.block_diag(*[frame] * count)


def frame_model(
    name: str, positions: dict[int, np.ndarray], bars: list[tuple[int, int]], *, masses: dict[int, float] | None = None,
    frames: dict[int, np.ndarray] | None = None,
) -> FiniteElementModel:  # fmt: skip
    """Round beams between nodes, point masses, 6 DOF a node, in the given displacement frames."""
    ids = list(positions)
    at = {n: 6 * i for i, n in enumerate(ids)}
    k, m = np.zeros((6 * len(ids),) * 2), np.zeros((6 * len(ids),) * 2)
    for a, b in bars:
        axis = positions[b] - positions[a]
        turn = blocks(local_axes(axis), 4)
        rows = np.r_[at[a] : at[a] + 6, at[b] : at[b] + 6]
        kl, ml = beam_matrices(float(np.linalg.norm(axis)), **TUBE)
        k[np.ix_(rows, rows)] += turn.T @ kl @ turn
        m[np.ix_(rows, rows)] += turn.T @ ml @ turn
    for n, value in (masses or {}).items():
        m[at[n] : at[n] + 3, at[n] : at[n] + 3] += value * np.eye(3)
    axes = np.array([(frames or {}).get(n, np.eye(3)) for n in ids])
    turn = la.block_diag(*[blocks(f, 2) for f in axes])
    k, m = turn @ k @ turn.T, turn @ m @ turn.T
    dofs = [(n, d) for n in ids for d in range(1, 7)]
    nodes = Nodes(np.array(ids), np.array([positions[n] for n in ids]), None if frames is None else axes)
    return FiniteElementModel(name=name, mass=0.5 * (m + m.T), stiffness=0.5 * (k + k.T), dofs=dofs, nodes=nodes)


def whole_component(model: FiniteElementModel, **changes: object) -> Component:
    """A component that keeps every DOF of the model: coupling it involves no reduction."""
    fields = {"name": model.name, "mass": model.mass, "stiffness": model.stiffness, "boundary": model.dofs, "nodes": model.nodes}
    return Component(**{**fields, **changes})


def moved(positions: dict[int, np.ndarray], placement: Placement) -> dict[int, np.ndarray]:
    """System positions as seen in the component's own frame: x_c = R^T (x_s - t)."""
    return {n: placement.rotation.T @ (p - placement.translation) for n, p in positions.items()}


CHAIN = {
    1: np.array([0.0, 0.0, 0.0]), 2: np.array([0.7, 0.1, 0.0]), 3: np.array([1.2, 0.5, 0.3]), 4: np.array([1.6, 0.4, 0.9]),
    5: np.array([2.2, 0.9, 1.0]), 6: np.array([2.4, 1.6, 0.7]),
}  # fmt: skip
CHAIN_BARS = [(1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (2, 4), (4, 6)]
CHAIN_MASSES = {1: 1.3, 3: 0.4, 6: 2.1}


def chain(frames: dict[int, np.ndarray] | None = None) -> FiniteElementModel:
    """The unsplit frame: six nodes, seven beams, nothing symmetric."""
    return frame_model("whole", CHAIN, CHAIN_BARS, masses=CHAIN_MASSES, frames=frames)


def chain_halves(
    placements: dict[str, Placement] | None = None, frames: dict[str, dict[int, np.ndarray]] | None = None
) -> tuple[Component, Component]:
    """The same frame cut at node 4: "left" (nodes 1-4) and "right" (nodes 4-6), each in its own frame."""
    parts = []
    for name, ids in (("left", [1, 2, 3, 4]), ("right", [4, 5, 6])):
        place = (placements or {}).get(name, Placement())
        bars = [b for b in CHAIN_BARS if set(b) <= set(ids)]
        masses = {n: v for n, v in CHAIN_MASSES.items() if n in ids}
        own = moved({n: CHAIN[n] for n in ids}, place)
        parts.append(whole_component(frame_model(name, own, bars, masses=masses, frames=(frames or {}).get(name))))
    return parts[0], parts[1]


def spring_component(
    name: str, stiffness: np.ndarray, mass: np.ndarray, boundary: list[tuple[int, int]], **fields: object
) -> Component:
    return Component(name=name, stiffness=stiffness, mass=mass, boundary=boundary, **fields)


def elastic_hz(mass: np.ndarray, stiffness: np.ndarray, n_rigid: int) -> np.ndarray:
    """All frequencies above the `n_rigid` lowest, Hz, by LAPACK alone."""
    values = la.eigh(stiffness, mass, eigvals_only=True)
    return np.sqrt(values[n_rigid:]) / (2 * np.pi)


def bordered_hz(system: object) -> np.ndarray:
    """Finite frequencies of the dual (bordered) pencil: QZ, infinite eigenvalues dropped, each polished on the same pencil.

    QZ is backward stable for the norm of K only; inverse iteration and the Rayleigh quotient give the digits it loses.
    """
    k, m = system.stiffness.toarray(), system.mass.toarray()
    alpha, beta = la.eigvals(k, m, homogeneous_eigvals=True)
    size = abs(beta) / np.hypot(abs(alpha), abs(beta))
    values = np.sort((alpha[size > 1e-9 * size.max()] / beta[size > 1e-9 * size.max()]).real)
    elastic = abs(values) > 1e-6 * np.median(abs(values))
    values[elastic] = [_polished(k, m, v) for v in values[elastic]]
    return np.sort(np.sqrt(abs(values)) / (2 * np.pi))


def _polished(k: np.ndarray, m: np.ndarray, value: float) -> float:
    factor = la.lu_factor(k - value * (1 + 1e-7) * m)
    x = np.random.default_rng(1).normal(size=k.shape[0])
    for _ in range(4):
        x = la.lu_solve(factor, m @ (x / np.linalg.norm(x)))
    return float((x @ k @ x) / (x @ m @ x))


def shared(*parts: str) -> Path:
    """A file of the shared validation data; the test skips where the data are not beside the repository."""
    root = Path(os.environ.get("FLEXPLANT_SHARED", Path(__file__).parents[2] / "shared" / "data"))
    path = root.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"validation data not found: {path} (set FLEXPLANT_SHARED to their folder)")
    return path
