"""Reduce small models: flexplant against scipy's eigsh and dense eigh, CPU milliseconds, one thread, alternating in one process.

Run from the repository's root:  python benchmarks/bench_small.py [--rounds 15] [--dof 400 600]

flexplant        craig_bampton as called: constraint modes, modes counted by inertia, error estimate, component checked
the modes only   the same without the count and the error estimate: the work of the other two
eigsh            eigsh(sigma=0) and one splu for the constraint modes, as a user calls them
eigh             dense eigh of the wanted modes and cho_solve for the constraint modes

Each number is the smallest of the rounds: on a shared machine the rest is noise. "first" is the first call of the process.
"""

from __future__ import annotations

import argparse
import os
import sys
import time

import meshes
import numpy as np
import scipy.linalg as la
from scipy.sparse.linalg import eigsh, splu

import flexplant as fp

CASES = [
    ("solid", (2, 2, 1), 5),
    ("solid", (3, 2, 2), 10),
    ("solid", (5, 3, 2), 24),
    ("solid", (4, 4, 2), 60),
    ("solid", (6, 5, 3), 25),
    ("solid", (6, 5, 3), 60),
    ("shell", (12, 6), 60),
    ("solid", (7, 5, 4), 60),
    ("solid", (7, 6, 5), 25),
    ("solid", (7, 6, 5), 60),
    ("shell", (14, 11), 60),
    ("solid", (9, 7, 4), 60),
    ("solid", (11, 7, 6), 25),
    ("solid", (11, 7, 6), 60),
    ("shell", (20, 16), 60),
    ("solid", (12, 9, 6), 60),
    ("solid", (12, 10, 6), 60),
    ("solid", (12, 10, 6), 25),
    ("solid", (13, 10, 7), 60),
    ("shell", (25, 24), 60),
]
DENSE_UP_TO = 1300  # beyond, dense eigh takes seconds
METHODS = ("flexplant", "the modes only", "eigsh", "eigh")
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS")
BARE = {"error_estimate": False, "verify_count": False}


def held(model, boundary):
    b = model.dofs.rows(boundary)
    i = np.setdiff1d(np.arange(len(model.dofs)), b)
    return model.stiffness[i][:, i].tocsc(), model.mass[i][:, i].tocsc(), model.stiffness[i][:, b].toarray()


def by_eigsh(model, boundary, n_modes):
    k, m, kib = held(model, boundary)
    eigsh(k, n_modes, m, sigma=0)
    splu(k).solve(-kib)


def by_eigh(model, boundary, n_modes):
    k, m, kib = held(model, boundary)
    dense = k.toarray()
    la.eigh(dense, m.toarray(), subset_by_index=[0, n_modes - 1])
    la.cho_solve(la.cho_factor(dense), -kib)


def milliseconds(job) -> float:
    start = time.process_time()
    job()
    return 1e3 * (time.process_time() - start)


def row(model, n_modes, rounds) -> None:
    boundary, n = meshes.held(model, 12 if len(model.dofs) < 100 else 24), len(model.dofs)
    jobs = {
        "flexplant": lambda: fp.craig_bampton(model, boundary, n_modes=n_modes, threads=1),
        "the modes only": lambda: fp.craig_bampton(model, boundary, n_modes=n_modes, threads=1, **BARE),
        "eigsh": lambda: by_eigsh(model, boundary, n_modes),
    }
    if n <= DENSE_UP_TO:
        jobs["eigh"] = lambda: by_eigh(model, boundary, n_modes)
    first = milliseconds(jobs["flexplant"])
    taken = {name: [] for name in jobs}
    for _ in range(max(3, rounds * 500 // max(n, 500))):
        for name, job in jobs.items():
            taken[name].append(milliseconds(job))
    best = {name: min(times) for name, times in taken.items()}
    report = fp.craig_bampton(model, boundary, n_modes=n_modes, threads=1).report
    ratio = best["eigsh"] / best["flexplant"]
    numbers = "".join(f"{best[name]:16.1f}" if name in best else f"{'':16}" for name in METHODS)
    worst = max(report.residuals)
    print(f"{model.name:<6}{n:6}{n_modes:6}{first:8.0f}{numbers}{ratio:8.1f}{worst:10.0e}{report.proved!s:>8}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15, help="of 500 DOF; larger models take fewer")
    parser.add_argument("--dof", type=int, nargs=2, default=(0, 10**9), metavar=("FROM", "TO"), help="only models of so many DOF")
    given = parser.parse_args()
    if any(os.environ.get(name) != "1" for name in THREADS):  # the libraries read them when they are loaded
        os.execve(sys.executable, [sys.executable, __file__, *sys.argv[1:]], os.environ | dict.fromkeys(THREADS, "1"))
    heads = "".join(f"{name:>16}" for name in METHODS)
    print(f"{'mesh':<6}{'DOF':>6}{'modes':>6}{'first':>8}{heads}{'times':>8}{'residual':>10}{'proved':>8}")
    for kind, cells, n_modes in CASES:
        model = meshes.solid(cells) if kind == "solid" else meshes.shell(*cells)
        if given.dof[0] <= len(model.dofs) <= given.dof[1]:
            row(model, n_modes, given.rounds)
    print(f"load {os.getloadavg()[0]:.1f} of {os.cpu_count()}")


if __name__ == "__main__":
    main()
