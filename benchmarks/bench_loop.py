"""Speed of the line-of-sight loop on a free-free plant of 150 modes: frequency response, time steps, wheel-speed sweep.

Run from the repository's root:  python benchmarks/bench_loop.py [--threads N]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from flexplant.blocks.wheel import Wheel, wheel_disturbance, wheel_tones
from flexplant.loop.close import close
from flexplant.loop.frequency import frequency_response
from flexplant.loop.harmonic import wheel_speed_sweep
from flexplant.loop.line_of_sight import LineOfSight, line_of_sight_diagram
from flexplant.loop.simulate import simulate
from flexplant.plant.modal import ModalPlant

INPUTS = [f"bus.9001.{d}" for d in range(1, 7)]
MODES, STEPS, DENSE_STEPS, SPEEDS = 150, 100_000, 20_000, 1000


def plant() -> ModalPlant:
    """Six rigid-body modes and the rest between 50 and 1200 Hz, 0.5 % damped."""
    rng = np.random.default_rng(0)
    omega = np.r_[np.zeros(6), 2 * np.pi * np.sort(rng.uniform(50, 1200, MODES - 6))]
    return ModalPlant(
        omega=omega,
        zeta=0.005,
        shape_in=rng.normal(size=(MODES, 6)),
        shape_out=rng.normal(size=(2, MODES)),
        inputs=INPUTS,
        outputs=["optic.1.1", "optic.1.2"],
    )


def timed(what: str, call: Callable[[], Any]) -> None:
    """Print the best of three runs."""
    best = np.inf
    for _ in range(3):
        start = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - start)
    print(f"{what:64s} {best:8.3f} s")


def main() -> None:
    """Every line is measured in this process."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, default=1)
    with threadpool_limits(parser.parse_args().threads):
        los = LineOfSight(focal_length=1.5, gain=1800.0, mirror_omega=100.0, mirror_zeta=0.3)
        structure = plant()
        closed, opened = (line_of_sight_diagram(los, structure, closed=c) for c in (True, False))
        wheel = Wheel(amplitude=5e-6, harmonics=[1, 2, 3], phase_rad=np.radians([0, 90, 0, 0, 90, 0]), inputs=INPUTS)
        t = np.arange(STEPS) * 1e-4
        u = wheel_disturbance(wheel, 20.0, t)
        dense = close(closed)
        timed(
            "frequency response, closed diagram, 10,000 frequencies",
            lambda: frequency_response(closed, np.geomspace(1, 2e3, 10_000)),
        )
        timed(f"simulate, plant alone, {STEPS} steps", lambda: simulate(structure, t, u))
        timed(f"simulate, closed loop, {STEPS} steps", lambda: simulate(closed, t, u))
        timed(
            f"simulate, closed loop as dense states, {DENSE_STEPS} steps",
            lambda: simulate(dense, t[:DENSE_STEPS], u[:, :DENSE_STEPS]),
        )
        timed("simulate, closed loop, tones from rest", lambda: simulate(closed, t, wheel_tones(wheel, 20.0)))
        timed(
            "simulate, closed loop, tones at steady state",
            lambda: simulate(closed, t, wheel_tones(wheel, 20.0), initial="steady_state"),
        )
        speeds = np.linspace(1, 100, SPEEDS)
        timed(
            f"wheel-speed sweep, {SPEEDS} speeds, open and closed",
            lambda: wheel_speed_sweep({"open": opened, "closed": closed}, wheel, speeds),
        )


if __name__ == "__main__":
    main()
