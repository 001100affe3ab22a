"""Speed of an exported plant: C99 source of 100 modes, 6 inputs, 6 outputs, compiled by the C compiler of this machine."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from flexplant.io import write_plant
from flexplant.plant.modal import ModalPlant

STEPS = 2_000_000
DRIVER = f"""
#include "plant.h"
#include <stdio.h>
#include <time.h>
int main(void) {{
  plant_state s; plant_real u[PLANT_INPUTS] = {{1, 2, 3, 4, 5, 6}}, y[PLANT_OUTPUTS]; double sum = 0;
  clock_t begin = clock();
  plant_reset(&s);
  for (int k = 0; k < {STEPS}; k++) {{ u[0] = k & 1; plant_step(&s, u, y); sum += y[0]; }}
  printf("%.2f million steps/s (check sum %g)\\n", {STEPS} / 1e6 / ((double)(clock() - begin) / CLOCKS_PER_SEC), sum);
  return 0;
}}
"""


def plant(n: int = 100) -> ModalPlant:
    """Six rigid-body modes and elastic ones up to 500 Hz."""
    rng = np.random.default_rng(1)
    omega = np.r_[np.zeros(6), np.sort(rng.uniform(10, 3000, n - 6))]
    names = [f"bus.{i}.1" for i in range(1, 7)]
    shapes = rng.standard_normal((2, n, 6))
    return ModalPlant(omega=omega, zeta=0.005, shape_in=shapes[0], shape_out=shapes[1].T, inputs=names, outputs=names)


def main() -> None:
    """Compile and run it in double, in single precision, and for this processor."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        print("no C compiler found")
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_plant(plant(), folder / "plant.c", dt=1e-4)
        (folder / "bench.c").write_text(DRIVER)
        for flags in ([], ["-DPLANT_REAL=float"], ["-march=native"]):
            command = [compiler, "-O3", "-std=c99", *flags, "-o", "bench", "bench.c", "plant.c"]
            subprocess.run(command, cwd=folder, check=True)
            done = subprocess.run([folder / "bench"], capture_output=True, text=True, check=True)
            print(f"{' '.join(['-O3', *flags]):24} {done.stdout.strip()}")


if __name__ == "__main__":
    main()
