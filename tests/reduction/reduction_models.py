"""Unreduced models for the tests of reduction: solid, plate, shell, rotor, beams, and the ShockSat-like bus and optic."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from structures import shared

import flexplant as fp

ROOT = Path(__file__).parents[2]
SHOCKSAT = ROOT / "examples" / "shocksat" / "data"
BUS = (9001, 9002, 9003, 9004, 9201, 9202, 9203, 9204)
OPTIC = (9101, 9201, 9202, 9203, 9204)
FEET = (9201, 9202, 9203, 9204)


def _meshes():
    spec = importlib.util.spec_from_file_location("benchmark_meshes", ROOT / "benchmarks" / "meshes.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


meshes = _meshes()


def plate(cells: int = 12) -> fp.FiniteElementModel:
    """A flat rectangular plate with membrane and bending, 6 DOF a node."""
    size, count = np.array([1.0, 0.8]), cells + 1
    k, m = meshes.plate(*(size / cells), 0.01)
    ids = np.arange(count * count).reshape(count, count)
    nodes = np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1).reshape(-1, 4)
    rows = (6 * nodes[:, :, None] + np.arange(6)).reshape(-1, 24)
    x, y = np.meshgrid(np.linspace(0, size[0], count), np.linspace(0, size[1], count), indexing="ij")
    positions = np.c_[x.ravel(), y.ravel(), np.zeros(x.size)]
    n = 6 * count * count
    return meshes.model("plate", meshes.assembled(k, rows, n), meshes.assembled(m, rows, n), positions, 6)


def lumped_beam(n_elements: int = 40) -> fp.FiniteElementModel:
    """A plane beam (DOF 2, 6) whose rotations carry no mass."""
    h, ei, rho = 1.0 / n_elements, 100.0, 2.0
    a = [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h]]
    element = ei / h**3 * np.array([*a, [-x for x in a[0]], [6 * h, 2 * h * h, -6 * h, 4 * h * h]])
    n = 2 * (n_elements + 1)
    k, m = np.zeros((n, n)), np.zeros((n, n))
    for e in range(n_elements):
        k[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += element
        m[[2 * e, 2 * e + 2], [2 * e, 2 * e + 2]] += rho * h / 2
    dofs = [(i, d) for i in range(1, n_elements + 2) for d in (2, 6)]
    nodes = fp.Nodes(np.arange(1, n_elements + 2), np.c_[np.linspace(0, 1, n_elements + 1), np.zeros((n_elements + 1, 2))])
    return fp.FiniteElementModel(name="lumped", stiffness=k, mass=m, dofs=dofs, nodes=nodes)


def cofe_beams() -> tuple[fp.FiniteElementModel, fp.FiniteElementModel]:
    """The two cantilever parts of the CoFE superelement tests, massless rotations."""
    with np.load(shared("cofe_cb_beams", "cantilever_components_KM.npz")) as data:
        return tuple(
            fp.FiniteElementModel(
                name=f"part{i}", stiffness=data[f"K{i}"], mass=data[f"M{i}"], dofs=[(int(n), int(d)) for n, d in data[f"lab{i}"]]
            )
            for i in (1, 2)
        )


def rotor() -> fp.FiniteElementModel:
    """The Abaqus rotor of the EXUDYN tests, 115 nodes, 345 DOF."""
    text = shared("exudyn_rotor", "rotorDiscTest.inp").read_text().split("*Node")[1].split("*")[0]
    table = np.array([[float(x) for x in line.split(",")] for line in text.splitlines() if line.count(",") == 3])
    matrices = {}
    for kind in ("STIF", "MASS"):
        i, j, v = np.array(shared("exudyn_rotor", f"rotorDiscTest{kind}1.mtx").read_text().split(), dtype=float).reshape(-1, 3).T
        matrices[kind] = sp.csr_array((v, (i.astype(int) - 1, j.astype(int) - 1)), shape=(345, 345))
    return fp.FiniteElementModel(
        name="rotor",
        stiffness=0.01 * matrices["STIF"],
        mass=matrices["MASS"],
        dofs=[(int(n), d) for n in table[:, 0] for d in (1, 2, 3)],
        nodes=fp.Nodes(table[:, 0].astype(int), table[:, 1:]),
    )


def shocksat(name: str) -> fp.FiniteElementModel:
    """The unreduced "bus", "optic" or "whole" of the example."""
    with np.load(SHOCKSAT / f"{name}_KM.npz") as data:
        n = len(data["dof"])
        upper = [sp.coo_array((data[x + "v"], (data[x + "i"], data[x + "j"])), shape=(n, n)) for x in "KM"]
        k, m = (sp.csr_array(u + sp.triu(u, k=1).T) for u in upper)
        return fp.FiniteElementModel(name=name, stiffness=k, mass=m, dofs=fp.DofSet(data["dof"][:, 0], data["dof"][:, 1]))


def corners(model: fp.FiniteElementModel, count: int = 4) -> list[tuple[int, int]]:
    """All DOF of the `count` nodes that lie farthest out at the model's low end of x."""
    positions = model.nodes.positions
    end = np.flatnonzero(positions[:, 0] < positions[:, 0].min() + 1e-6 * model.nodes.extent)
    out = end[np.argsort(-np.linalg.norm(positions[end] - positions[end].mean(axis=0), axis=1), kind="stable")[:count]]
    chosen = set(model.nodes.ids[out].tolist())
    return [pair for pair in model.dofs.pairs if pair[0] in chosen]
