"""Each factorisation backend once on a generated mesh: analysis, factor, 8 columns, a Sturm count. One thread, CPU seconds.

Run from the repository's root:  python benchmarks/bench_backends.py solid30k rslab,pardiso,cholmod,superlu
"""

from __future__ import annotations

import os
import sys
import time

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np  # noqa: E402  after the threads are capped
from bench_reduction import CASES  # noqa: E402
from meshes import held, shell, solid  # noqa: E402

from flexplant.numerics.factorization import analyze  # noqa: E402

SHIFT_HZ = 300.0


def interior(case: str):
    kind, cells = CASES[case]
    model = solid(cells) if kind == "solid" else shell(*cells)
    inside = np.setdiff1d(np.arange(len(model.dofs)), model.dofs.rows(held(model, 60)))
    return (matrix[inside][:, inside].tocsc() for matrix in (model.stiffness, model.mass))


def clocked(call):
    start = time.process_time()
    value = call()
    return value, time.process_time() - start


def main() -> None:
    case, names = sys.argv[1], sys.argv[2].split(",")
    k, m = interior(case)
    columns = np.random.default_rng(0).standard_normal((k.shape[0], 8))
    titles = ("case", "backend", "analyse", "factor", "solve ms", "count", "below", "fill", "residual")
    print("{:<10}{:<9}{:>9}{:>8}{:>10}{:>7}{:>7}{:>10}{:>10}".format(*titles))
    for name in names:
        analysis, t_analyse = clocked(lambda name=name: analyze(k, backend=name, threads=1))
        factor, t_factor = clocked(lambda analysis=analysis: analysis.factorize(k))
        solved = [clocked(lambda factor=factor: factor.solve(columns)) for _ in range(3)]
        residual = np.linalg.norm(k @ solved[0][0] - columns) / np.linalg.norm(columns)
        line = f"{case:<10}{name:<9}{t_analyse:>9.2f}{t_factor:>8.2f}{1e3 * min(t for _, t in solved):>10.0f}"
        shifted = k - (2 * np.pi * SHIFT_HZ) ** 2 * m
        counted, t_count = clocked(lambda analysis=analysis, shifted=shifted: analysis.factorize(shifted).negative_pivots)
        print(f"{line}{t_count:>7.2f}{counted!s:>7}{factor.fill:>10.3g}{residual:>10.1e}", flush=True)


if __name__ == "__main__":
    main()
