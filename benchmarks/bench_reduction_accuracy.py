"""Error against size on the ShockSat-like structure: classic HCB, residual vectors, Rubin, and promised accuracy.

Run from the repository's root:  python benchmarks/bench_reduction_accuracy.py [--plot docs/reduction-accuracy.svg]

The bus (48 boundary DOF) is reduced in many ways, the optic always far better than needed; both are coupled and compared with
the 61 elastic modes below 300 Hz of the unreduced whole. The last column is what `estimate_error` says without the whole model.
"""

from __future__ import annotations

import argparse
import time
from functools import partial
from pathlib import Path

import numpy as np
import scipy.sparse as sp

import flexplant as fp
from flexplant.reduction import craig_bampton, rubin
from flexplant.verification.reduction_error import estimate_error

DATA = Path(__file__).parents[1] / "examples" / "shocksat" / "data"
BUS = (9001, 9002, 9003, 9004, 9201, 9202, 9203, 9204)
OPTIC = (9101, 9201, 9202, 9203, 9204)
FEET = OPTIC[1:]
FAMILIES = {
    "classic": [partial(craig_bampton, n_modes=n) for n in (60, 100, 160, 250, 360)],
    "Rubin": [partial(rubin, n_modes=n) for n in (60, 100, 160, 250)],
    "80 modes + k blocks": [partial(craig_bampton, n_modes=80, residual_vectors=k) for k in (0, 1, 2, 3)],
    "size=": [partial(craig_bampton, size=n, max_frequency_hz=300) for n in (80, 100, 125, 150, 176)],
    "accuracy=": [partial(craig_bampton, accuracy=a, max_frequency_hz=300) for a in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)],
}


def load(name: str) -> fp.FiniteElementModel:
    with np.load(DATA / f"{name}_KM.npz") as data:
        n = len(data["dof"])
        upper = [sp.coo_array((data[x + "v"], (data[x + "i"], data[x + "j"])), shape=(n, n)) for x in "KM"]
        k, m = (sp.csr_array(u + sp.triu(u, k=1).T) for u in upper)
        dofs = fp.DofSet(data["dof"][:, 0], data["dof"][:, 1])
        return fp.FiniteElementModel(name=name, stiffness=k, mass=m, dofs=dofs)


def measured(bus: fp.Component, optic: fp.Component, truth: np.ndarray) -> tuple[float, float, float]:
    """Worst relative error of the first four modes and of all below 300 Hz, and the worst that is estimated."""
    joint = fp.Connection("bus", "optic", pairs=[(f, f) for f in FEET], directions="123456")
    system = fp.couple([bus, optic], [joint], method="primal")
    modes = fp.normal_modes(system)
    error = modes.frequency_hz[modes.n_rigid :][: truth.size] / truth - 1
    estimated = np.nan
    if getattr(bus, "error_rows", None) is not None:
        estimated = float(np.max(estimate_error(system, modes=modes).total[: truth.size]))
    return float(abs(error[:4]).max()), float(abs(error).max()), estimated


def plot(results: dict[str, list[tuple[int, float]]], path: str) -> None:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
    for (name, points), marker in zip(results.items(), "osD^v", strict=True):
        axes.semilogy(*zip(*points, strict=True), marker=marker, label=name)
    axes.set(xlabel="generalised coordinates of the bus", ylabel="worst relative frequency error below 300 Hz")
    axes.grid(visible=True, alpha=0.3)
    axes.legend()
    figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plot", help="write the figure here (needs matplotlib)")
    options = parser.parse_args()
    whole, bus, optic = (load(name) for name in ("whole", "bus", "optic"))
    modes = fp.normal_modes(whole, max_frequency_hz=300)
    truth = modes.frequency_hz[modes.n_rigid :]
    small = craig_bampton(optic, [(n, "123456") for n in OPTIC], accuracy=1e-9, max_frequency_hz=300)
    print(f"{truth.size} elastic modes below 300 Hz; optic: {small.report}")
    print(f"{'bus':<22}{'q DOF':>6}{'first four':>12}{'below 300 Hz':>14}{'estimated':>11}{'cpu s':>7}")
    results: dict[str, list[tuple[int, float]]] = {}
    for family, reductions in FAMILIES.items():
        for reduce in reductions:
            start = time.process_time()
            component = reduce(bus, [(n, "123456") for n in BUS])
            seconds = time.process_time() - start
            first, worst, estimated = measured(component, small, truth)
            results.setdefault(family, []).append((component.n_modal, worst))
            print(f"{family:<22}{component.n_modal:>6}{first:>12.1e}{worst:>14.1e}{estimated:>11.1e}{seconds:>7.1f}", flush=True)
    if options.plot:
        plot(results, options.plot)


if __name__ == "__main__":
    main()
