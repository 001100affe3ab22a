"""Speed and accuracy of frequency responses, time simulation and sweeps beside named peers, alternating in one run.

Run from the repository's root, one thread:

    OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/bench_response.py [--rounds N]

Times are processor seconds of this one-threaded process. Every round measures ours, then the peer;
the table gives the median ratio and its smallest and largest value over the rounds.
Peers that would take minutes do a part of the work, and their time is scaled up (`part` in the table).
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any
from unittest import mock

import control
import numba
import numpy as np
from pyyeti import ode
from threadpoolctl import threadpool_limits

from flexplant.blocks.basic import summing_junction
from flexplant.blocks.sampled import SampledBlock, saturation, user_block
from flexplant.blocks.transfer_function import transfer_function
from flexplant.blocks.wheel import Wheel, harmonic_amplitudes
from flexplant.loop.cascade import cascade_of
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.harmonic import wheel_speed_sweep
from flexplant.loop.line_of_sight import LineOfSight, line_of_sight_diagram
from flexplant.loop.recursion import Recursion, march
from flexplant.loop.simulate import simulate
from flexplant.plant.discretize import discretize
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import state_space
from flexplant.response.frequency import frequency_response
from flexplant.response.gain_sweep import GainSweep

MODES, FREQUENCIES, DT = 200, 10_000, 1e-4
HZ = np.linspace(0.5, 1200.0, FREQUENCIES)
OMEGA = 2 * np.pi * HZ


@dataclass(frozen=True)
class Row:
    """One line of the table; part: the share of the work that the peer does before its time is scaled up."""

    work: str
    peer: str
    target: float
    ours: Callable[[], Any]
    theirs: Callable[[], Any] | None
    error: Callable[[], float] | None = None
    part: float = 1.0
    units: float = 1.0
    unit: str = "ms"
    fixed: Callable[[], Any] | None = None


def plant(ny: int = 6, nu: int = 6, *, n: int = MODES, full: bool = False, seed: int = 0) -> ModalPlant:
    """Modes from 1 to 1000 Hz at 0.5 % damping, or fully coupled damping."""
    rng = np.random.default_rng(seed)
    omega = 2 * np.pi * np.sort(rng.uniform(1, 1000, n))
    damping = None
    if full:
        mixing = rng.normal(size=(n, n)) / np.sqrt(n)
        size = np.sqrt(2 * 0.005 * omega)
        damping = np.outer(size, size) * (np.eye(n) + 0.5 * mixing @ mixing.T)
    return ModalPlant(
        omega=omega,
        zeta=0.005,
        damping=damping,
        shape_in=rng.normal(size=(n, nu)),
        shape_out=rng.normal(size=(ny, n)),
        inputs=[f"u{k}" for k in range(nu)],
        outputs=[f"y{k}" for k in range(ny)],
    )


def numpy_sum(p: ModalPlant, omega: np.ndarray) -> np.ndarray:
    """The modal sum as one writes it in numpy."""
    receptance = 1 / (p.omega[:, None] ** 2 - omega**2 + 2j * p.zeta[:, None] * p.omega[:, None] * omega)
    residues = (p.shape_out[:, None, :] * p.shape_in.T[None]).reshape(-1, p.n_modes)
    return (residues @ receptance).reshape(len(p.outputs), len(p.inputs), -1)


def numpy_solve(p: ModalPlant, omega: np.ndarray) -> np.ndarray:
    """One dense solution a frequency."""
    out = np.empty((len(p.outputs), len(p.inputs), omega.size), dtype=complex)
    for k, w in enumerate(omega):
        dynamic = np.diag(p.omega**2 - w**2) + 1j * w * p.damping_matrix
        out[:, :, k] = p.shape_out @ np.linalg.solve(dynamic, p.shape_in)
    return out


def relative(a: np.ndarray, b: np.ndarray) -> float:
    """Largest error over a channel relative to that channel's largest value, worst channel."""
    return float((abs(a - b).max(axis=-1) / abs(b).max(axis=-1)).max())


def frequency_rows() -> list[Row]:
    """Lines 1 to 5 of the table."""
    p, wide, full = plant(), plant(24, 50), plant(n=260, full=True)
    s = state_space(p)
    system = control.ss(s.A, s.B, s.C, s.D)
    unit = ode.SolveUnc(np.ones(MODES), 2 * p.zeta * p.omega, p.omega**2)
    loads = [np.outer(p.shape_in[:, k], np.ones(FREQUENCIES)) for k in range(6)]
    rng = np.random.default_rng(1)
    right = rng.normal(size=(MODES, 2 * FREQUENCIES))
    narrow_left, wide_left = rng.normal(size=(36, MODES)), rng.normal(size=(1200, MODES))
    some = OMEGA[:: FREQUENCIES // 100]

    def pyyeti_fsolve() -> list[np.ndarray]:
        return [p.shape_out @ unit.fsolve(load, HZ, incrb="d").d for load in loads]

    def ours() -> np.ndarray:
        return frequency_response(p, HZ).values

    def ours_wide() -> np.ndarray:
        return frequency_response(wide, HZ).values

    memory = np.zeros((24, 50, FREQUENCIES), dtype=complex)

    def ours_written() -> np.ndarray:
        return frequency_response(wide, HZ, out=memory).values

    def ours_full() -> np.ndarray:
        return frequency_response(full, HZ).values

    def solved(q: ModalPlant = p) -> float:
        return relative(frequency_response(q, HZ).values[:, :, :: FREQUENCIES // 100], numpy_solve(q, some))

    def solved_wide() -> float:
        return solved(wide)

    return [
        Row(
            "frequency response, 200 modes, 6x6, 10,000 points",
            "python-control + slycot",
            400,
            ours,
            lambda: control.frequency_response(system, OMEGA[:1100]),
            solved,
            part=0.1,
            fixed=lambda: control.frequency_response(system, OMEGA[:100]),
        ),
        Row("same", "pyYeti SolveUnc.fsolve", 40, ours, pyyeti_fsolve),
        Row("same", "numpy modal sum", 6, ours, lambda: numpy_sum(p, OMEGA)),
        Row("same", "bare GEMM", 1 / 2.5, ours, lambda: narrow_left @ right),
        Row("same, 24x50", "numpy modal sum", 3, ours_wide, lambda: numpy_sum(wide, OMEGA), solved_wide),
        Row("same, into given memory", "numpy modal sum", 3, ours_written, lambda: numpy_sum(wide, OMEGA)),
        Row("same, 24x50", "bare GEMM", 1 / 2.5, ours_wide, lambda: wide_left @ right),
        Row(
            "full damping, 260 modes, 6x6, 10,000 points",
            "numpy solve loop",
            40,
            ours_full,
            lambda: numpy_solve(full, some),
            lambda: relative(frequency_response(full, some / (2 * np.pi)).values, numpy_solve(full, some)),
            part=0.01,
        ),
    ]


def time_rows() -> list[Row]:
    """Open and closed loop in time; ours does 100,000 steps, the peers a part of them."""
    p = plant()
    s = state_space(p)
    los = LineOfSight(focal_length=1.5, gain=1800.0, mirror_omega=100.0, mirror_zeta=0.3)
    loop = line_of_sight_diagram(los, p, plant_outputs=["y0", "y1"], signals=("spot", "angle", "tilt"))
    system = control.ss(s.A, s.B, s.C, s.D)
    nt = 100_000
    t, u = np.arange(nt) * DT, np.random.default_rng(2).normal(size=(6, nt))
    short, some = 3_000, 10_000
    unit = ode.SolveUnc(np.ones(MODES), 2 * p.zeta * p.omega, p.omega**2, DT)

    def opened() -> Any:
        return simulate(p, t, u)

    def error() -> float:
        steps = discretize(s, DT, hold="zero")
        x, y = np.zeros(s.n_states), np.empty((6, short))
        for k in range(short):
            y[:, k] = s.C @ x
            x = steps.A @ x + steps.B @ u[:, k]
        return relative(simulate(p, t[:short], u[:, :short], hold="zero").outputs.values, y)

    rows = [
        Row(
            "time, 200 modes, 6 in, 6 out, open loop",
            "control.forced_response",
            80,
            opened,
            lambda: control.forced_response(system, t[:short], u[:, :short]),
            error,
            part=short / nt,
        ),
        Row(
            "same",
            "pyYeti SolveUnc.tsolve",
            30,
            opened,
            lambda: p.shape_out @ unit.tsolve(p.shape_in @ u[:, :some]).d,
            part=some / nt,
        ),
    ]
    closed = Row(
        "same, closed loop with a 4-state mirror", "ours without the loop", 1 / 1.5, lambda: simulate(loop, t, u), opened
    )
    rate = Row("steps per second, closed loop (millions)", "-", 4.0, closed.ours, None, units=1e-6 * nt, unit="M/s")
    ten = np.arange(10 * nt) * DT, np.tile(u, 10)
    long = Row("same, 1,000,000 steps in a run", "-", 4.0, lambda: simulate(loop, *ten), None, units=1e-5 * nt, unit="M/s")
    return [*rows, closed, rate, long, *feedback_rows(p, t, u), *sampled_rows(p, t, u)]


def damped(p: ModalPlant) -> Diagram:
    """Two dampers on the structure, each with a filter and a spring: they feed back into the plant."""
    laws = {f"law{k}": transfer_function([-30.0, -1000.0], [1e-3, 1.0]) for k in range(2)}
    sums = {f"sum{k}": summing_junction("++", output_name="f") for k in range(2)}
    wires = [(f"plant.y{k}", f"law{k}.u") for k in range(2)] + [(f"law{k}.y", f"sum{k}.in2") for k in range(2)]
    return Diagram(
        blocks={"plant": replace(p, shape_out=np.vstack([p.shape_in[:, :2].T, p.shape_out[2:]])), **laws, **sums},
        connections=[*wires, *((f"sum{k}.f", f"plant.u{k}") for k in range(2))],
        inputs={f"u{k}": f"sum{k}.in1" if k < 2 else f"plant.u{k}" for k in range(6)},
        outputs={f"y{k}": f"plant.y{k}" for k in range(6)},
    )


def feedback_rows(p: ModalPlant, t: np.ndarray, u: np.ndarray) -> list[Row]:
    """A loop that feeds back into the plant: in its own modes, and what they cost once."""
    loop, short, some = damped(p), 3_000, 30_000
    whole, cascade, nt = close(loop), cascade_of(loop), t.size
    system = control.ss(whole.A, whole.B, whole.C, whole.D)

    def ours() -> Any:
        return simulate(loop, t, u)

    def dense() -> Any:
        return march(Recursion(cascade, DT, np.zeros(cascade.n_states), "first"), u[:, :some], some, (6, 6))

    def error() -> float:
        steps, x, y = discretize(whole, DT, hold="zero"), np.zeros(whole.n_states), np.empty((6, short))
        for k in range(short):
            y[:, k] = steps.C @ x
            x = steps.A @ x + steps.B @ u[:, k]
        return relative(simulate(loop, t[:short], u[:, :short], hold="zero").outputs.values, y)

    work = "time, 200 modes, 6 in, 6 out, a loop that feeds back into the plant"
    return [
        Row(work, "ours without the loop", 0.5, ours, lambda: simulate(p, t, u), error),
        Row("same", "our dense block of 402 states", 1.0, ours, dense, part=some / nt),
        Row(
            "same",
            "control.forced_response",
            1.0,
            ours,
            lambda: control.forced_response(system, t[:short], u[:, :short]),
            part=short / nt,
        ),
        Row("same, the first run, its modes included", "-", np.inf, lambda: simulate(replace(loop), t, u), None, units=1e3),
    ]


def sampled_rows(p: ModalPlant, t: np.ndarray, u: np.ndarray) -> list[Row]:
    """Nonlinear and digital blocks with all modes inside their loop, and a user's function there."""
    controller = transfer_function([-3e-4, 2e-4], [1.0, -0.3], dt=DT)

    @numba.njit
    def clipped(_: float, force: np.ndarray) -> np.ndarray:
        return np.minimum(np.maximum(force, -1.0), 1.0)

    def loop(law: SampledBlock) -> Diagram:
        ports = law.inputs[0], law.outputs[0]
        return Diagram(
            blocks={"plant": p, "controller": controller, "law": law},
            connections=[("plant.y0", "controller.u"), ("controller.y", f"law.{ports[0]}"), (f"law.{ports[1]}", "plant.u0")],
            inputs={f"u{k}": f"plant.u{k}" for k in range(1, 6)},
            outputs={f"y{k}": f"plant.y{k}" for k in range(6)},
        )

    blocks = {"a saturation": saturation(-1.0, 1.0), "a user's function": user_block(clipped, inputs=["u"], outputs=["y"])}
    return [
        Row(
            f"steps per second (millions), digital controller and {name} around 200 modes",
            "-",
            0.0,
            lambda law=law: simulate(loop(law), t, u[1:]),
            None,
            units=1e-6 * t.size,
            unit="M/s",
        )
        for name, law in blocks.items()
    ]


def time_compilation() -> str:
    """Processor seconds of first simulations: nothing compiled yet, and kept on disk."""
    plant_of = "from flexplant import ModalPlant as M, simulate, Diagram, saturation; import numpy as n; o = n.ones((1, 1)); "
    plant_of += "p = M(omega=[9.0], zeta=0.1, shape_in=o, shape_out=o, inputs=['u'], outputs=['y']); at = n.arange(99) * 1e-3; "
    loop = "Diagram(blocks={'p': p, 's': saturation(-1, 1)}, connections=[('p.y', 's.u'), ('s.y', 'p.u')], outputs={'y': 'p.y'})"
    with tempfile.TemporaryDirectory() as folder:
        runs = [plant_of + f"simulate({system}, at)" for system in ("p", "p", loop, loop)]
        cold, warm, sampled_cold, sampled_warm = (started(code, NUMBA_CACHE_DIR=folder) for code in runs)
    return (
        f"First simulation in a fresh interpreter, all imports included: {cold:.2f} s where nothing is compiled yet, {warm:.2f} s"
        f" afterwards; with sampled blocks {sampled_cold:.2f} s, {sampled_warm:.2f} s afterwards."
    )


def sweep_rows() -> list[Row]:
    """Wheel speeds and gains."""
    p = plant()
    s = state_space(p)
    los = LineOfSight(focal_length=1.5, gain=1800.0, mirror_omega=100.0, mirror_zeta=0.3)
    loop = line_of_sight_diagram(los, p, plant_outputs=["y0", "y1"])
    system = control.ss(s.A, s.B, s.C[:2], s.D[:2])
    wheel = Wheel(
        amplitude=5e-6,
        harmonics=np.linspace(1, 5.6, 8),
        phase_rad=np.radians([0, 90, 0, 0, 90, 0]),
        inputs=[f"u{k}" for k in range(6)],
    )
    speeds = np.linspace(1, 100, 1000)
    points = 2 * np.pi * np.outer(np.linspace(1, 5.6, 8), speeds).ravel()
    G = frequency_response(p, np.linspace(0.5, 1200, 8000)).values
    loops, out = GainSweep(G[:1, :1], G[:1, 1:2], G[1:2, :1], G[1:2, 1:2]), np.empty((1, 1, 8000), dtype=complex)
    gains = np.linspace(-5, 5, 100)

    def first_sweep() -> Any:
        loop.derived.clear()
        return wheel_speed_sweep(loop, wheel, speeds)

    def error() -> float:
        whole, few = close(loop), speeds[::100]
        found = wheel_speed_sweep(loop, wheel, few).amplitude.values
        harmonics, amplitudes = harmonic_amplitudes(wheel)
        dense = np.empty_like(found)
        for j, speed in enumerate(few):
            for h, a in enumerate(amplitudes.T):
                x = np.linalg.solve(2j * np.pi * harmonics[h] * speed * np.eye(whole.n_states) - whole.A, whole.B @ a)
                dense[:, h, j] = (whole.C @ x + whole.D @ a) * speed**2
        return relative(found.reshape(2, -1), dense.reshape(2, -1))

    return [
        Row(
            "1,000 wheel speeds x 8 harmonics, closed loop",
            "python-control without slycot, plant alone",
            5000,
            lambda: wheel_speed_sweep(loop, wheel, speeds),
            lambda: without_slycot(lambda: control.frequency_response(system, points[::400])),
            error,
            part=20 / 8000,
        ),
        Row(
            "same",
            "python-control + slycot, plant alone",
            5000,
            lambda: wheel_speed_sweep(loop, wheel, speeds),
            lambda: control.frequency_response(system, points[:500]),
            part=500 / 8000,
            fixed=lambda: control.frequency_response(system, points[:2]),
        ),
        Row(
            "same, a diagram's first sweep",
            "python-control + slycot, plant alone",
            5000,
            first_sweep,
            lambda: control.frequency_response(system, points[:500]),
            part=500 / 8000,
            fixed=lambda: control.frequency_response(system, points[:2]),
        ),
        Row(
            "gains x 8,000 frequencies, cached plant (us a gain)",
            "-",
            300.0,
            lambda: [loops(k, out) for k in gains],
            None,
            units=1e6 / gains.size,
            unit="us",
        ),
    ]


def without_slycot(call: Callable[[], Any]) -> Any:
    """python-control as pip installs it: slycot is an extra, and without it every frequency is one dense solution."""
    with mock.patch.dict(sys.modules, {"slycot": None}):
        return call()


PARTS = {"frequency": frequency_rows, "time": time_rows, "sweeps": sweep_rows}


def seconds(call: Callable[[], Any]) -> float:
    """Processor time of one call in this process: its wall time where nothing else runs, and fair to both sides elsewhere."""
    start = time.process_time()
    call()
    return time.process_time() - start


def measured(row: Row, rounds: int) -> str:
    """The row's line of the table."""
    row.ours()
    ours, ratios = [], []
    for _ in range(rounds):
        ours.append(seconds(row.ours))
        if row.theirs is not None:
            one_time = 0.0 if row.fixed is None else seconds(row.fixed)
            ratios.append((seconds(row.theirs) - one_time) / row.part / ours[-1])
    accuracy = "" if row.error is None else f"{row.error():.0e}"
    if row.theirs is not None:
        low, middle, high = min(ratios), float(np.median(ratios)), max(ratios)
        verdict = "met" if middle >= row.target else "missed"
        cells = [
            f"{1e3 * np.median(ours):.4g} ms",
            f"{middle:.3g} ({low:.3g} to {high:.3g})",
            *judged(row, verdict),
            accuracy,
        ]
    else:
        values = [row.units / s if row.unit == "M/s" else row.units * s for s in ours]
        middle = np.median(values)
        good = middle >= row.target if row.unit == "M/s" else middle <= row.target
        spread = f"{min(values):.3g} to {max(values):.3g} {row.unit}"
        cells = [f"{middle:.3g} {row.unit}", spread, *judged(row, "met" if good else "missed"), accuracy]
    return f"| {row.work} | {row.peer} | " + " | ".join(cells) + " |"


def judged(row: Row, verdict: str) -> tuple[str, str]:
    """The target and whether it is reached; nothing where there is none (0, infinity)."""
    return (f"{row.target:.3g}", verdict) if 0 < row.target < np.inf else ("-", "")


def started(code: str, **environment: str) -> float:
    """Processor seconds of a statement in a fresh interpreter."""
    script = f"import time; t = time.process_time(); {code}; print(time.process_time() - t)"
    given = {**os.environ, **environment}
    return float(subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, env=given).stdout)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--part", choices=[*PARTS, "all"], default="all")
    given = parser.parse_args()
    rounds, parts = given.rounds, list(PARTS) if given.part == "all" else [given.part]
    packages = ("numpy", "scipy", "numba", "control", "slycot", "pyyeti")
    versions = ", ".join(f"{k} {version(k)}" for k in packages)
    print(f"{datetime.date.today()}, Python {platform.python_version()}, {versions}; one thread\n")
    print("| work | peer | ours (median) | peer / ours: median (spread) | at least | | error |")
    print("|---|---|---|---|---|---|---|")
    with threadpool_limits(1):
        for row in (row for part in parts for row in PARTS[part]()):
            print(measured(row, rounds), flush=True)
    imports = min(started("import flexplant") for _ in range(3))
    first = "from flexplant.response.receptance import ModalSum as M; import numpy as n; o = n.ones"
    kernels = min(started(f"{first}; M(o((1, 1)), o(1), o(1))(n.arange(99.0))") for _ in range(2))
    with tempfile.TemporaryDirectory() as empty:
        cold = started(f"{first}; M(o((1, 1)), o(1), o(1))(n.arange(99.0))", NUMBA_CACHE_DIR=empty)
    print(
        f"\nimport flexplant: {imports:.3f} s. First frequency response, numba's import included: {kernels:.2f} s, "
        f"or {cold:.2f} s where nothing is compiled yet (processor time)."
    )
    print(time_compilation())


if __name__ == "__main__":
    main()
