"""H-infinity norms, margins, singular values and random response beside their peers, alternating in one run.

Run from the repository's root, one thread:

    OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/bench_norms.py [--rounds N] [--quick]

Times are processor seconds (median of the rounds). `agreement` is the relative difference of the two values; a peer that would
take minutes is asked for a smaller plant (`states` in the table). The peers of the norm are slycot's AB13DD (Bruinsma and
Steinbuch, through `control.linfnorm`) and this package's own Hamiltonian test.
"""

from __future__ import annotations

import argparse
import datetime
import platform
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import control
import numpy as np
from threadpoolctl import threadpool_limits

import flexplant as fp
from flexplant.loop.breaking import cut_open
from flexplant.response import margins as dense_margins
from flexplant.response.norms import _norm


def plant(modes: int, *, zeta: float = 0.005, ny: int = 6, nu: int = 6, kind: str = "shape_out", seed: int = 0) -> fp.ModalPlant:
    """Modes from 1 to 1000 Hz."""
    rng = np.random.default_rng(seed)
    return fp.ModalPlant(
        omega=2 * np.pi * np.sort(rng.uniform(1, 1000, modes)),
        zeta=zeta,
        shape_in=rng.normal(size=(modes, nu)),
        **{kind: rng.normal(size=(ny, modes))},
        inputs=[f"u{k}" for k in range(nu)],
        outputs=[f"y{k}" for k in range(ny)],
    )


def grid_rms(p: fp.ModalPlant, hz: np.ndarray) -> float:
    """RMS of the first output for white inputs by the trapezoidal rule."""
    gain = abs(fp.frequency_response(p, hz).values[0]) ** 2
    return float(np.sqrt(np.trapezoid(gain.sum(axis=0), hz)))


def loop(modes: int, *, zeta: float = 0.005, rigid: int = 0, seed: int = 0) -> fp.Diagram:
    """Two collocated rate loops about a plant, six disturbances and six displacements."""
    rng = np.random.default_rng(seed)
    b = rng.normal(size=(modes, 8))
    structure = fp.ModalPlant(
        omega=np.r_[np.zeros(rigid), 2 * np.pi * np.sort(rng.uniform(1, 500, modes - rigid))],
        zeta=zeta,
        shape_in=b,
        shape_out=np.vstack([b[:, :2].T, rng.normal(size=(6, modes))]),
        inputs=[f"f{k}" for k in range(2)] + [f"w{k}" for k in range(6)],
        outputs=[f"x{k}" for k in range(2)] + [f"z{k}" for k in range(6)],
    )
    lag = 1 / (2 * np.pi * 2000)
    law = fp.transfer_function([-1.0, -100.0], [lag**2, 2 * lag, 1.0], input_name="e", output_name="f")
    wires = [(f"plant.x{k}", f"law{k}.e") for k in range(2)] + [(f"law{k}.f", f"plant.f{k}") for k in range(2)]
    return fp.Diagram(
        blocks={"plant": structure, "law0": law, "law1": law},
        connections=wires,
        inputs={f"w{k}": f"plant.w{k}" for k in range(6)},
        outputs={f"z{k}": f"plant.z{k}" for k in range(6)},
    )


def seconds(work: Callable[[], Any]) -> tuple[float, Any]:
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


def row(work: str, peer: str, ours: Callable[[], float], theirs: Callable[[], float] | None, rounds: int) -> None:
    """One line: median times of both, and how far their values agree."""
    times: list[tuple[float, float]] = []
    values = (0.0, 0.0)
    for _ in range(rounds):
        mine, value = seconds(ours)
        other, peer_value = seconds(theirs) if theirs is not None else (np.nan, np.nan)
        times.append((mine, other))
        values = (value, peer_value)
    mine, other = np.median(times, axis=0)
    shown = "" if theirs is None else f"{other:.3g} s | {other / mine:.3g} | {abs(values[1] / values[0] - 1):.0e}"
    print(f"| {work} | {peer} | {mine:.3g} s | {shown or '| | '} |", flush=True)


def norm_rows(rounds: int, quick: bool) -> None:
    for modes in (30, 100) if quick else (30, 100, 200):
        p = plant(modes)
        s = fp.state_space(p)
        system = control.ss(s.A, s.B, s.C, s.D)
        work = f"hinf_norm, 6x6, {2 * modes} states"
        row(work, "control.linfnorm (slycot)", lambda p=p: fp.hinf_norm(p).value, lambda s=system: control.linfnorm(s)[0], rounds)
        row(work, "own Hamiltonian test", lambda p=p: fp.hinf_norm(p).value, lambda s=s: _norm(s, 1e-7).value, rounds)
    for modes, zeta, kind in (
        (1000, 0.005, "shape_out"),
        (3000, 0.005, "shape_out"),
        (3000, 0.005, "shape_out_acceleration"),
        (3000, 1e-5, "shape_out_acceleration"),
    ):
        p = plant(modes, zeta=zeta, kind=kind)
        found = fp.hinf_norm(p)
        name = kind.removeprefix("shape_out_").replace("shape_out", "displacement")
        work = f"hinf_norm, 6x6, {2 * modes} states, zeta {zeta:g}, {name}; bracket {found.upper / found.lower - 1:.0e}"
        row(work, "-", lambda p=p: fp.hinf_norm(p).value, None, rounds)


def loop_rows(rounds: int, quick: bool) -> None:
    d = loop(75)
    s = fp.close(d)
    system = control.ss(s.A, s.B, s.C, s.D)
    work = "closed loop, 154 states"
    row(work, "control.linfnorm (slycot)", lambda: fp.hinf_norm(d).value, lambda: control.linfnorm(system)[0], rounds)
    for modes, rigid in ((1000, 0), (1000, 2), (3000, 0)):
        big = loop(modes, rigid=rigid)
        found = fp.hinf_norm(big)
        bracket = f"bracket {found.upper / found.lower - 1:.0e}" if np.isfinite(found.value) else found.explanation
        work = f"closed loop, {2 * modes + 4} states, {rigid} rigid-body modes; {bracket}"
        row(work, "-", lambda big=big: fp.hinf_norm(big).value, None, 1 if quick else rounds)
    at = ["plant.x0", "plant.x1"]
    small = loop(60)
    opened = fp.close(cut_open(small, at))
    L = fp.StateSpace(opened.A, opened.B, -opened.C, opened.D, opened.inputs, opened.outputs)
    row(
        "disk margin and all crossings, 124 states",
        "own eigenvalue pencils",
        lambda: fp.loop_margins(small, at).disk.alpha,
        lambda: dense_margins.margins(L).disk.alpha,
        1 if quick else rounds,
    )
    for modes in (500, 1500):
        big = loop(modes)
        work = f"loop_response (L, S, T, all margins), {2 * modes + 4} states"
        row(work, "-", lambda big=big: float(fp.loop_response(big, at).disk_margin), None, 1 if quick else rounds)


def other_rows(rounds: int) -> None:
    rng = np.random.default_rng(0)
    for ny, nu in ((1, 6), (2, 2), (2, 6), (6, 6)):
        G = rng.normal(size=(ny, nu, 10_000)) + 1j * rng.normal(size=(ny, nu, 10_000))
        response = fp.frequency_response(plant(2, ny=ny, nu=nu), np.arange(1.0, 10_001.0)).copy(data=G)
        stack = np.ascontiguousarray(G.transpose(2, 0, 1))
        work = f"singular_values, 10,000 matrices {ny}x{nu}"
        ours = lambda r=response: float(fp.singular_values(r).values[7, 0])  # noqa: E731
        row(work, "numpy batched svd", ours, lambda s=stack: float(np.linalg.svd(s, compute_uv=False)[7, 0]), rounds)
        row(work, "numpy svd loop", ours, lambda s=stack: float([np.linalg.svd(m, compute_uv=False) for m in s][7][0]), rounds)
    p = plant(200)
    s = fp.state_space(p)
    system = control.ss(s.A, s.B, s.C, s.D)
    row("h2_norm, 400 states", "control.norm (slycot)", lambda: fp.h2_norm(p), lambda: float(control.norm(system, 2)), rounds)
    big = plant(3000)
    row("h2_norm, 6000 states", "-", lambda: fp.h2_norm(big), None, rounds)
    hz = np.geomspace(1, 900, 300)
    psd = dict.fromkeys(p.inputs, 1.0)
    fine = fp.adaptive_grid(p, 1.0, 900.0, per_mode=401, per_decade=2000)
    row(
        f"random_response exact RMS, 400 states, 6 inputs (peer: its grid RMS on {fine.size} points)",
        "trapezoidal rule",
        lambda: float(fp.random_response(p, psd, hz).rms[0]),
        lambda: grid_rms(p, fine),
        rounds,
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="small plants and one round of what is slow")
    options = parser.parse_args()
    versions = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba", "control", "slycot"))
    print(f"{datetime.datetime.now(tz=datetime.UTC).date()}, Python {platform.python_version()}, {versions}; one thread\n")
    print("| work | peer | ours | peer | peer / ours | agreement |\n|---|---|---|---|---|---|")
    with threadpool_limits(1):
        fp.hinf_norm(plant(4))  # compiles, or loads what was compiled
        norm_rows(options.rounds, options.quick)
        loop_rows(options.rounds, options.quick)
        other_rows(options.rounds)


if __name__ == "__main__":
    main()
