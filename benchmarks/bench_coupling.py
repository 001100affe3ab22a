"""Couple 200 Hurty/Craig-Bampton components (40,000 generalised DOF, about 5,000 constraints) and take 100 modes.

Run from the repository's root:  python benchmarks/bench_coupling.py [--small]

Targets: couple under 5 s and 1 GB, the first 100 modes under 60 s. Each number printed is measured in this process; the peak
is the growth of the resident set. The competitors (SVD null space, dense column-pivoted QR) eliminate the same constraints of a
smaller chain, since they would not finish at full size.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import scipy.linalg as la
import scipy.sparse as sp
from threadpoolctl import threadpool_limits

from flexplant.assembly import Connection, System, couple
from flexplant.model.component import Component
from flexplant.model.geometry import Nodes, Placement
from flexplant.modes import normal_modes
from flexplant.numerics.elimination import eliminate
from flexplant.numerics.factorization import factorize

CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y, z in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=float)
DIRECTIONS = "123456"


def hcb_component(name: str, n_modal: int, seed: int) -> Component:
    """A free-free box with 8 corner nodes (48 boundary DOF) and `n_modal` modes: Kbb R = 0 exactly, Mqq = I, Mbq coupled."""
    rng = np.random.default_rng(seed)
    n_b = 6 * len(CORNERS)
    rigid = np.zeros((n_b, 6))
    for i, (x, y, z) in enumerate(CORNERS - CORNERS.mean(axis=0)):
        rigid[6 * i : 6 * i + 6] = np.eye(6)
        rigid[6 * i : 6 * i + 3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    free = la.null_space(rigid.T)
    kbb = free @ np.diag(np.geomspace(1e6, 1e9, free.shape[1])) @ free.T
    omega = 2 * np.pi * np.sort(rng.uniform(20.0, 900.0, n_modal))
    participation = rng.normal(size=(n_b, n_modal)) * np.sqrt(2.0 / max(n_modal, 1))
    mbb = 12.0 * np.eye(n_b) + participation @ participation.T
    mass = np.block([[mbb, participation], [participation.T, np.eye(n_modal)]])
    boundary = [(i + 1, d) for i in range(len(CORNERS)) for d in range(1, 7)]
    nodes = Nodes(np.arange(1, len(CORNERS) + 1), CORNERS)
    return Component(name=name, mass=mass, stiffness=la.block_diag(kbb, np.diag(omega**2)), boundary=boundary, nodes=nodes)


def lattice(n_components: int, n_modal: int) -> tuple[list[Component], list[Connection], dict[str, Placement]]:
    """Boxes in a row, four corner nodes (24 DOF) at each joint; plus rigid ties that close loops near the end."""
    parts = [hcb_component(f"c{i}", n_modal, i) for i in range(n_components)]
    places = {f"c{i}": Placement(np.eye(3), [float(i), 0, 0]) for i in range(n_components)}
    pairs = [(5, 1), (6, 2), (7, 3), (8, 4)]
    joints = [Connection(f"c{i}", f"c{i + 1}", pairs, DIRECTIONS) for i in range(n_components - 1)]
    far = [Connection(f"c{i}", f"c{i + 40}", [(1, 8)], DIRECTIONS) for i in range(0, n_components - 40, 4)]
    return parts, joints + far, places


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def environment() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    cpu = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.machine())
    backend = factorize(sp.eye_array(2, format="csc")).backend
    versions = f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}"
    return f"{cpu}, {os.cpu_count()} cores, one BLAS thread, {versions}, factorization by {backend}"


def measure_couple(n_components: int, n_modal: int) -> System:
    begin = time.perf_counter()
    parts, connections, places = lattice(n_components, n_modal)
    size = sum(c.n for c in parts)
    print(f"components      {len(parts)}, {size} generalised DOF, built in {time.perf_counter() - begin:.2f} s")
    before, begin = peak_mb(), time.perf_counter()
    system = couple(parts, connections, placements=places)
    k = system.stiffness
    seconds = time.perf_counter() - begin
    print(f"couple (dual)   {seconds:.2f} s, peak {peak_mb():.0f} MB (+{peak_mb() - before:.0f}), {k.shape}, {k.nnz} nonzeros")
    found = f"{system.n_constraints} independent, {len(system.redundant)} redundant"
    print(f"constraints     {found}, |B L| {abs(system.constraints @ system.basis).max():.1e}, L {system.basis.nnz} nonzeros")
    return system


def measure_modes(system: System, count: int) -> None:
    begin = time.perf_counter()
    modes = normal_modes(system, n_modes=count)
    seconds = time.perf_counter() - begin
    hz = modes.frequency_hz
    first, last = hz[modes.n_rigid], hz[-1]
    print(f"{count} modes       {seconds:.1f} s, peak {peak_mb():.0f} MB, {modes.n_rigid} rigid, {first:.4f} to {last:.3f} Hz")
    gap = abs(system.constraints @ modes.shapes).max() / abs(modes.shapes).max()
    print(f"residuals       |K phi - w^2 M phi| / |diag(K) phi| {modes.residuals.max():.1e}; |B phi| / |phi| {gap:.1e}")
    k = system.basis.T @ system.uncoupled_stiffness @ system.basis
    m = system.basis.T @ system.uncoupled_mass @ system.basis
    middle = 0.5 * (hz[-2] + hz[-1])
    below = factorize(k - (2 * np.pi * middle) ** 2 * m).negative_pivots
    print(f"none missed     below {middle:.4f} Hz: {np.count_nonzero(hz < middle)} modes found, {below} by Sturm count")


def measure_competitors(system: System) -> None:
    b = system.constraints
    print(f"competitors on  B {b.shape}")

    def timed(label: str, work: Callable[[], Any]) -> None:
        begin = time.perf_counter()
        basis = work()
        seconds = time.perf_counter() - begin
        filled = basis.nnz if sp.issparse(basis) else np.count_nonzero(abs(basis) > 1e-14)
        print(f"  {label:28s}{seconds:9.3f} s, basis {filled} nonzeros")

    timed("sparse elimination (ours)", lambda: eliminate(b).basis)
    timed("SVD null space (dense)", lambda: la.null_space(b.toarray()))
    timed("column-pivoted QR (dense)", lambda: _qr_basis(b.toarray()))


def _qr_basis(b: np.ndarray) -> np.ndarray:
    _, r, order = la.qr(b, mode="economic", pivoting=True)
    m, n = b.shape
    basis = np.zeros((n, n - m))
    basis[order[:m]] = -la.solve_triangular(r[:, :m], r[:, m:])
    basis[order[m:], np.arange(n - m)] = 1.0
    return basis


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true", help="60 components of 60 modes, for a quick look")
    n_components, n_modal = (60, 60) if parser.parse_args().small else (200, 152)
    print(environment())
    with threadpool_limits(1):
        measure_modes(measure_couple(n_components, n_modal), 100)
        parts, connections, places = lattice(60, 0)
        measure_competitors(couple(parts, connections, placements=places))


if __name__ == "__main__":
    main()
