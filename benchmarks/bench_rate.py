"""Steps per second of the closed loop beside the speed of the machine at that moment.

    OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/bench_rate.py [--seconds 70]

A matrix product, a run of 100,000 steps and one of 1,000,000 take turns; quantiles over all turns, and the correlation with the
product's rate, tell how much of the spread is the machine's. Processor time, one thread.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from bench_response import time_rows
from threadpoolctl import threadpool_limits

SIZE, PRODUCTS = 600, 6


def spent(work: Callable[[], object]) -> float:
    """Processor seconds of one call."""
    start = time.process_time()
    work()
    return time.process_time() - start


def main() -> None:
    """Print the quantiles."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=70.0)
    end = time.monotonic() + parser.parse_args().seconds
    with threadpool_limits(1):
        rates = [row for row in time_rows() if row.unit == "M/s" and row.target == 4.0]
        a = np.random.default_rng(0).normal(size=(SIZE, SIZE))
        turns = []
        while time.monotonic() < end:
            product = 2e-9 * PRODUCTS * SIZE**3 / spent(lambda: [a @ a for _ in range(PRODUCTS)])
            turns.append([product, *(row.units / spent(row.ours) for row in rates)])
    found = np.array(turns[1:])
    print(f"{len(found)} turns\n\n| quantile | product, GF/s | 100,000 steps, M/s | 1,000,000 steps, M/s |\n|---|---|---|---|")
    for percent, row in zip((5, 25, 50, 75, 95), np.percentile(found, [5, 25, 50, 75, 95], axis=0), strict=True):
        print(f"| {percent} % | " + " | ".join(f"{value:.3g}" for value in row) + " |")
    print(f"\ncorrelation with the product: {np.corrcoef(found.T)[0, 1:].round(2)}")


if __name__ == "__main__":
    main()
