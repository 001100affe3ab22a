"""Reduce generated meshes to 60 modes + 60 constraint modes, against scipy's eigsh and exudyn, one thread each.

Run from the repository's root:
  python benchmarks/bench_reduction.py [--quick] [--large] [--superlu-estimate] [--rounds 2] [--fresh] [--plot] [case ...]

Methods, alternating, each run in its own process so that its peak memory is its own:
  flexplant        craig_bampton(n_modes=60, verify_count=False): the same work as the next
  eigsh+rslab      scipy eigsh with a factor of rslab as OPinv, constraint modes by that factor; tolerance 1e-6, at which it
                   takes the fewest solutions it ever takes and its residual is about flexplant's
  eigsh+supernodal the same with flexplant's own factor, the one that "flexplant" uses
  eigsh+pardiso    the same with MKL's or SuiteSparse's factor, where these extras are installed; one run, not in the table:
  eigsh+cholmod      python benchmarks/bench_reduction.py --case solid103k --job eigsh+pardiso
  eigsh+tol0       eigsh+rslab at eigsh's own default tolerance
  flexplant+count  verify_count=True: the modes are proved complete, by one more factorisation
  eigsh            scipy eigsh(sigma=0) as a user calls it (SuperLU), constraint modes by one more splu
  superlu          one such factor and a few solutions, where the above takes too long: its time is estimated from them
  exudyn           exudyn's own Craig-Bampton modes, ComputeHurtyCraigBamptonModes (solids, where it is installed)
CPU seconds are printed beside wall seconds: on a shared machine they carry less noise. The residual is the largest
|K x - w^2 M x| / |K x| of the 60 modes. Memory is what the process took at its peak beyond the model itself. "modes" is the time
of the eigenproblem alone, the factor made, and what it is times flexplant's.

Every finished run is kept in benchmarks/results/reduction.json (or the file that FLEXPLANT_RESULTS names), with date and
versions, and not repeated; --fresh forgets those of the cases asked for. --plot draws docs/reduction-cost.svg from what is kept.
"""

from __future__ import annotations

import argparse
import datetime
import importlib.metadata
import importlib.util
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path

CASES = {
    "small500": ("solid", (6, 5, 3)),
    "solid30k": ("solid", (24, 20, 18)),
    "shell30k": ("shell", (71, 70)),
    "shell101k": ("shell", (130, 129)),
    "solid103k": ("solid", (36, 32, 27)),
    "shell300k": ("shell", (224, 223)),
    "solid300k": ("solid", (54, 45, 38)),
    "shell1M": ("shell", (409, 408)),
}
DEFAULT, LARGE = ("small500", "solid30k", "shell30k", "shell101k", "solid103k"), ("shell300k", "solid300k", "shell1M")
SUPERLU_TOO_SLOW = {"solid103k"}
N_MODES = N_BOUNDARY = 60
TOLERANCE = 1e-6
SMALL_REPEATS = 20  # of milliseconds
RESULTS = Path(os.environ.get("FLEXPLANT_RESULTS", Path(__file__).parent / "results" / "reduction.json"))
PLOT = Path(__file__).parents[1] / "docs" / "reduction-cost.svg"


def count(model) -> int:
    return min(N_MODES, len(model.dofs) // 20)


def flexplant_job(model, boundary, verify_count=False):
    import flexplant as fp
    from flexplant.reduction import interior

    extra, solver = {"modes": 0.0}, interior.shift_invert

    def timed(*arguments, **more):
        start = time.process_time()
        found = solver(*arguments, **more)
        extra["modes"] = time.process_time() - start
        return found

    interior.shift_invert = timed
    options = {"error_estimate": False, "threads": 1, "keep_basis": True, "verify_count": verify_count}
    component = fp.craig_bampton(model, boundary, n_modes=count(model), **options)
    interior.shift_invert = solver
    n_b, rows = component.n_boundary, held_rows(model, boundary)
    return component.stiffness.diagonal()[n_b:], component.basis[rows, n_b:], extra | {"proved": component.report.proved}


def counted_job(model, boundary):
    return flexplant_job(model, boundary, verify_count=True)


def held_rows(model, boundary):
    import numpy as np

    return np.setdiff1d(np.arange(len(model.dofs)), model.dofs.rows(boundary))


def held(model, boundary):
    b, i = model.dofs.rows(boundary), held_rows(model, boundary)
    return b, i, model.stiffness[i][:, i].tocsc(), model.mass[i][:, i].tocsc(), model.stiffness[i][:, b].toarray()


def eigsh_job(model, boundary):
    from scipy.sparse.linalg import eigsh, splu

    _, _, k, m, kib = held(model, boundary)
    values, vectors = eigsh(k, count(model), m, sigma=0)
    splu(k).solve(-kib)
    return values, vectors, {}


def eigsh_factor_job(model, boundary, backend="rslab", tolerance=TOLERANCE):
    from scipy.sparse.linalg import LinearOperator, eigsh

    from flexplant.numerics.completion import completed
    from flexplant.numerics.factorization import factorize

    _, i, k, m, kib = held(model, boundary)
    start = time.process_time()
    factor = factorize(completed(k, model.dofs.node[i]) if i.size > 20_000 else k, threads=1, backend=backend)
    extra = {"factor": time.process_time() - start, "solves": 0}
    factor.solve(-kib)

    def solve(b):
        extra["solves"] += 1
        return factor.solve(b)

    inverse, start = LinearOperator(k.shape, solve, dtype=float), time.process_time()
    values, vectors = eigsh(k, count(model), m, sigma=0, OPinv=inverse, tol=tolerance)
    return values, vectors, extra | {"modes": time.process_time() - start}


def eigsh_own_factor_job(model, boundary):
    return eigsh_factor_job(model, boundary, "supernodal")


def eigsh_pardiso_job(model, boundary):
    return eigsh_factor_job(model, boundary, "pardiso")


def eigsh_cholmod_job(model, boundary):
    return eigsh_factor_job(model, boundary, "cholmod")


def eigsh_default_job(model, boundary):
    return eigsh_factor_job(model, boundary, tolerance=0)


def superlu_job(model, boundary):
    """eigsh(sigma=0) factors with splu's defaults and solves column by column."""
    import numpy as np
    from scipy.sparse.linalg import splu

    _, _, k, _, kib = held(model, boundary)
    start = time.process_time()
    factor = splu(k)
    spent = [time.process_time() - start]
    for right_side in (np.ones(k.shape[0]), np.arange(float(k.shape[0])), -kib):
        start = time.process_time()
        factor.solve(right_side)
        spent.append(time.process_time() - start)
    return None, None, {"factor": spent[0], "one": min(spent[1:3]), "many": spent[3], "fill": int(factor.nnz)}


def exudyn_job(model, boundary):
    import numpy as np
    import scipy.sparse as sp
    from exudyn.FEM import FEMinterface, HCBstaticModeSelection

    fem = FEMinterface()
    fem.nodes = {"Position": np.array(model.nodes.positions)}
    fem.massMatrix, fem.stiffnessMatrix = sp.csr_matrix(model.mass), sp.csr_matrix(model.stiffness)
    nodes = sorted({node - 1 for node, _ in boundary})
    every = HCBstaticModeSelection.allBoundaryNodes
    fem.ComputeHurtyCraigBamptonModes([nodes], count(model), useSparseSolver=True, computationMode=every, timerTreshold=10**9)
    vectors = np.asarray(fem.modeBasis["matrix"])[held_rows(model, boundary), -count(model) :]
    return (2 * np.pi * np.asarray(fem.GetEigenFrequenciesHz()[-count(model) :])) ** 2, vectors, {}


JOBS = {
    "flexplant": flexplant_job,
    "eigsh+rslab": eigsh_factor_job,
    "eigsh+supernodal": eigsh_own_factor_job,
    "eigsh+pardiso": eigsh_pardiso_job,
    "eigsh+cholmod": eigsh_cholmod_job,
    "eigsh+tol0": eigsh_default_job,
    "flexplant+count": counted_job,
    "eigsh": eigsh_job,
    "superlu": superlu_job,
    "exudyn": exudyn_job,
}


def residual(model, boundary, values, vectors) -> float:
    import numpy as np

    _, _, k, m, _ = held(model, boundary)
    force = k @ vectors
    return float((np.linalg.norm(force - (m @ vectors) * values, axis=0) / np.linalg.norm(force, axis=0)).max())


def warm_up(model) -> None:
    """Load the compiled loops that only large models take (which compile them, once on a machine)."""
    import numpy as np

    from flexplant.numerics import products
    from flexplant.numerics.factorization import factorize, supernodal_backend

    if supernodal_backend.available():
        size, products.LARGE = products.LARGE, 1
        factor = factorize(completed_pattern(model), backend="supernodal")
        for columns in (1, 8, 16):
            products.product(model.mass, factor.solve(np.ones((len(model.dofs), columns))))
        products.LARGE = size


def completed_pattern(model):
    import scipy.sparse as sp

    return sp.csr_array(model.stiffness + sp.eye_array(len(model.dofs)) * abs(model.stiffness).max())


def run_job(case: str, job: str) -> None:
    """In a process of its own: build the mesh, time the job, print one line of JSON."""
    import meshes

    warm = meshes.solid((4, 4, 4))
    JOBS[job](warm, meshes.held(warm, N_BOUNDARY))  # imports and first calls are not what is compared
    warm_up(warm)
    kind, cells = CASES[case]
    model = meshes.solid(cells) if kind == "solid" else meshes.shell(*cells)
    boundary = meshes.held(model, N_BOUNDARY)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    wall, cpu = time.perf_counter(), time.process_time()
    repeats = SMALL_REPEATS if case.startswith("small") else 1
    for _ in range(repeats):
        values, vectors, extra = JOBS[job](model, boundary)
    wall, cpu = (time.perf_counter() - wall) / repeats, (time.process_time() - cpu) / repeats
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    result = {"dof": len(model.dofs), "wall": wall, "cpu": cpu, "peak_gb": (peak - before) / 1e6, "process_gb": peak / 1e6}
    if vectors is not None:
        result["residual"] = residual(model, boundary, values, vectors)
    print(json.dumps(result | extra))


def measured(case: str, job: str) -> dict:
    capped = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"), "1")
    command = [sys.executable, __file__, "--case", case, "--job", job]
    done = subprocess.run(command, env=os.environ | capped, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{case}, {job}: {done.stderr.strip().splitlines()[-1]}")
    versions = {name: importlib.metadata.version(name) for name in ("flexplant", "numpy", "scipy", "rslab")}
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    about = {"case": case, "job": job, "date": now, "load": round(os.getloadavg()[0], 1), "versions": versions}
    return about | json.loads(done.stdout.splitlines()[-1])


def kept() -> list[dict]:
    return json.loads(RESULTS.read_text()) if RESULTS.exists() else []


def keep(runs: list[dict]) -> None:
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text("[\n" + ",\n".join(json.dumps(run) for run in runs) + "\n]\n")


def jobs_of(case: str, quick: bool, estimate: bool) -> list[str]:
    if case in LARGE:
        return ["flexplant"]
    jobs = ["flexplant", "eigsh+rslab", "eigsh+supernodal", "flexplant+count", "eigsh+tol0"]
    if case in SUPERLU_TOO_SLOW:
        return [*jobs, "superlu"] if estimate else jobs
    jobs += [] if quick else ["eigsh"]
    return [*jobs, "exudyn"] if CASES[case][0] == "solid" and not quick and importlib.util.find_spec("exudyn") else jobs


def run_case(case: str, rounds: int, jobs: list[str]) -> None:
    """Run what is not kept yet, jobs in turn; a superlu run is long and made once."""
    for number in range(rounds):
        for job in jobs:
            have = sum(run["case"] == case and run["job"] == job for run in kept())
            if have <= number and not (job == "superlu" and have):
                run = measured(case, job)
                keep([*kept(), run])


def runs_of(case: str) -> dict[str, list[dict]]:
    """Kept runs of a case by method; estimated ones of eigsh from a factor and a few solutions of superlu."""
    found = {job: [run for run in kept() if run["case"] == case and run["job"] == job] for job in JOBS}
    for run in found.pop("superlu"):
        solves = found["eigsh+rslab"][0]["solves"] if found["eigsh+rslab"] else 153
        cpu = 2 * run["factor"] + solves * run["one"] + run["many"]  # a factor for the modes, and one for the constraint modes
        found.setdefault("eigsh (estimated)", []).append(run | {"cpu": cpu, "wall": cpu})
    return {job: runs for job, runs in found.items() if runs}


def middle(runs: list[dict], key: str) -> float:
    return statistics.median(run[key] for run in runs)


def table(case: str) -> None:
    found = runs_of(case)
    if "flexplant" not in found:
        return
    own, loads = middle(found["flexplant"], "cpu"), [run["load"] for runs in found.values() for run in runs]
    print(f"\n{case}: {found['flexplant'][0]['dof']} DOF, load {min(loads)} to {max(loads)} of {os.cpu_count()}")
    heads = ("runs", "wall s", "cpu s", "spread", "times", "factor", "modes", "times", "solves", "residual", "peak GB")
    print(f"{'method':<18}" + "".join(f"{head:>9}" for head in heads))
    modes = middle(found["flexplant"], "modes") if all("modes" in run for run in found["flexplant"]) else 0.0
    for job, runs in found.items():
        cpu = middle(runs, "cpu")
        spread = (max(r["cpu"] for r in runs) - min(r["cpu"] for r in runs)) / cpu
        cells = [f"{len(runs)}", f"{middle(runs, 'wall'):.3g}", f"{cpu:.3g}", f"{spread:.0%}", f"{cpu / own:.2f}"]
        cells += [f"{middle(runs, 'factor'):.2f}" if "factor" in runs[0] else ""]
        known = "modes" in runs[0] and modes > 0
        cells += [f"{middle(runs, 'modes'):.2f}", f"{middle(runs, 'modes') / modes:.2f}"] if known else ["", ""]
        cells += [f"{runs[0]['solves']}" if "solves" in runs[0] else ""]
        cells += [
            f"{max(r['residual'] for r in runs):.1e}" if "residual" in runs[0] else "",
            f"{max(r['peak_gb'] for r in runs):.2f}",
        ]
        print(f"{job:<18}" + "".join(f"{cell:>9}" for cell in cells), flush=True)


def plot() -> None:
    """Time and memory of flexplant against DOF, from the kept runs."""
    import matplotlib.pyplot as plt

    plt.rcParams["svg.hashsalt"] = "flexplant"
    figure, axes = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")
    for kind, mark in (("shell", "o-"), ("solid", "s-")):
        runs = [runs_of(case).get("flexplant") for case, (k, _) in CASES.items() if k == kind and case != "small500"]
        points = sorted((r[0]["dof"], middle(r, "cpu"), max(x["process_gb"] for x in r)) for r in runs if r)
        for axis, column in zip(axes, (1, 2), strict=True):
            axis.loglog([p[0] for p in points], [p[column] for p in points], mark, label=kind)
    for axis, title in zip(axes, ("CPU time, s", "peak memory of the process, GB"), strict=True):
        axis.set(xlabel="DOF", title=title)
        axis.grid(True, which="both", alpha=0.3)
        axis.legend()
    figure.savefig(PLOT, metadata={"Date": None})
    print(f"wrote {PLOT.relative_to(Path.cwd()) if PLOT.is_relative_to(Path.cwd()) else PLOT}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", choices=[*CASES, []], default=[], metavar="case", help=", ".join(CASES))
    parser.add_argument("--large", action="store_true", help="300k and 1M DOF too: minutes and up to 10 GB")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="without SuperLU and exudyn, which take most of the time")
    parser.add_argument("--superlu-estimate", action="store_true", help="factor solid103k by SuperLU once: ten minutes, 10 GB")
    parser.add_argument("--fresh", action="store_true", help="forget kept runs of these cases (those of superlu stay)")
    parser.add_argument("--plot", action="store_true", help="write docs/reduction-cost.svg (needs matplotlib)")
    parser.add_argument("--case", help=argparse.SUPPRESS)
    parser.add_argument("--job", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.job:
        run_job(options.case, options.job)
        return
    cases = options.cases or [*DEFAULT, *(LARGE if options.large else ())]
    if options.fresh:
        keep([run for run in kept() if run["case"] not in cases or run["job"] == "superlu"])
    for case in cases:
        run_case(case, options.rounds, jobs_of(case, options.quick, options.superlu_estimate))
        table(case)
    if options.plot:
        plot()


if __name__ == "__main__":
    main()
