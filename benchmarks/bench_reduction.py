"""Reduce generated meshes to 60 modes + 60 constraint modes, against scipy's eigsh, one thread each.

Run from the repository's root:  python benchmarks/bench_reduction.py [--large] [--quick] [--rounds 2] [case ...]

Methods, alternating, each run in its own process so that its peak memory is its own:
  flexplant      craig_bampton(n_modes=60)
  eigsh+factor   scipy eigsh on the same kind of factor (flexplant's best, as OPinv), constraint modes by that factor
  eigsh          scipy eigsh(sigma=0) as a user calls it (SuperLU), constraint modes by one more splu
CPU seconds are printed beside wall seconds: on a shared machine they carry less noise. The residual is the largest
|K x - w^2 M x| / |K x| of the 60 modes. Memory is what the process took at its peak beyond the model itself.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import time

CASES = {
    "small500": ("solid", (6, 5, 3)),
    "solid30k": ("solid", (24, 20, 18)),
    "shell101k": ("shell", (130, 129)),
    "solid103k": ("solid", (36, 32, 27)),
    "shell300k": ("shell", (224, 223)),
    "solid300k": ("solid", (54, 45, 38)),
    "shell1M": ("shell", (409, 408)),
}
DEFAULT, LARGE = ("small500", "solid30k", "shell101k", "solid103k"), ("shell300k", "solid300k", "shell1M")
SUPERLU_TOO_SLOW = {"solid103k", *LARGE}
N_MODES = N_BOUNDARY = 60


def flexplant_job(model, boundary):
    import flexplant as fp

    component = fp.craig_bampton(model, boundary, n_modes=count(model), error_estimate=False, threads=1, keep_basis=True)
    n_b = component.n_boundary
    return component.stiffness.diagonal()[n_b:], component.basis[:, n_b:], True


def count(model) -> int:
    return min(N_MODES, len(model.dofs) // 20)


def held(model, boundary):
    import numpy as np

    b = model.dofs.rows(boundary)
    i = np.setdiff1d(np.arange(len(model.dofs)), b)
    return b, i, model.stiffness[i][:, i].tocsc(), model.mass[i][:, i].tocsc(), model.stiffness[i][:, b].toarray()


def eigsh_job(model, boundary):
    from scipy.sparse.linalg import eigsh, splu

    _, _, k, m, kib = held(model, boundary)
    values, vectors = eigsh(k, count(model), m, sigma=0)
    splu(k).solve(-kib)
    return values, vectors, False


def eigsh_factor_job(model, boundary):
    from scipy.sparse.linalg import LinearOperator, eigsh

    from flexplant.numerics.factorization import factorize

    _, _, k, m, kib = held(model, boundary)
    factor = factorize(k, threads=1)
    factor.solve(-kib)
    values, vectors = eigsh(k, count(model), m, sigma=0, OPinv=LinearOperator(k.shape, factor.solve, dtype=float))
    return values, vectors, False


JOBS = {"flexplant": flexplant_job, "eigsh+factor": eigsh_factor_job, "eigsh": eigsh_job}


def residual(model, boundary, values, vectors, whole: bool) -> float:
    import numpy as np

    _, i, k, m, _ = held(model, boundary)
    x = vectors[i] if whole else vectors
    force = k @ x
    return float((np.linalg.norm(force - (m @ x) * values, axis=0) / np.linalg.norm(force, axis=0)).max())


def run_job(case: str, job: str) -> None:
    """In a process of its own: build the mesh, time the job, print one line of JSON."""
    import meshes

    warm = meshes.solid((4, 4, 4))
    JOBS[job](warm, meshes.held(warm, N_BOUNDARY))  # imports and first calls are not what is compared
    kind, cells = CASES[case]
    model = meshes.solid(cells) if kind == "solid" else meshes.shell(*cells)
    boundary = meshes.held(model, N_BOUNDARY)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    wall, cpu = time.perf_counter(), time.process_time()
    values, vectors, whole = JOBS[job](model, boundary)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    result = {"dof": len(model.dofs), "wall": wall, "cpu": cpu, "peak_gb": peak / 1e6}
    print(json.dumps(result | {"residual": residual(model, boundary, values, vectors, whole), "last": float(max(values))}))


def measured(case: str, job: str) -> dict:
    capped = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"), "1")
    command = [sys.executable, __file__, "--case", case, "--job", job]
    done = subprocess.run(command, env=os.environ | capped, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def table(case: str, rounds: int, jobs: list[str]) -> None:
    results: dict[str, list[dict]] = {job: [] for job in jobs}
    for _ in range(rounds):
        for job in jobs:
            results[job].append(measured(case, job))
    own = statistics.median(r["cpu"] for r in results["flexplant"])
    print(f"\n{case}: {results['flexplant'][0]['dof']} DOF, {rounds} round(s), load {os.getloadavg()[0]:.1f} of {os.cpu_count()}")
    print(f"{'method':<14}{'wall s':>9}{'cpu s':>9}{'spread':>8}{'times':>7}{'residual':>10}{'peak GB':>9}")
    for job, runs in results.items():
        cpu = [r["cpu"] for r in runs]
        middle, spread = statistics.median(cpu), (max(cpu) - min(cpu)) / statistics.median(cpu)
        worst, peak = max(r["residual"] for r in runs), max(r["peak_gb"] for r in runs)
        wall = statistics.median(r["wall"] for r in runs)
        print(f"{job:<14}{wall:>9.2f}{middle:>9.2f}{spread:>8.0%}{middle / own:>7.1f}{worst:>10.1e}{peak:>9.2f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", choices=[*CASES, []], default=[], metavar="case", help=", ".join(CASES))
    parser.add_argument("--large", action="store_true", help="300k and 1M DOF too: minutes and up to 10 GB")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="without scipy's own SuperLU, which takes most of the time")
    parser.add_argument("--case", help=argparse.SUPPRESS)
    parser.add_argument("--job", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.job:
        run_job(options.case, options.job)
        return
    cases = options.cases or [*DEFAULT, *(LARGE if options.large else ())]
    for case in cases:
        slow = options.quick or case in SUPERLU_TOO_SLOW
        table(case, options.rounds, ["flexplant"] if case in LARGE else ["flexplant", "eigsh+factor"] if slow else list(JOBS))


if __name__ == "__main__":
    main()
