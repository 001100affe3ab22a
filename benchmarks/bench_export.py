"""Speed of exported plants: C99 source and FMU of 100 modes, 6 inputs, 6 outputs, compiled by the C compiler of this machine."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import zipfile
from pathlib import Path

import numpy as np

from flexplant.io import write_plant
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace

STEPS, FMU_STEPS = 2_000_000, 200_000
DT = 1e-4
DRIVER = """
#include "plant.h"
#include <stdio.h>
#include <time.h>
int main(void) {
  plant_state s; plant_real u[PLANT_INPUTS] = {1, 2, 3, 4, 5, 6}, y[PLANT_OUTPUTS]; double sum = 0;
  clock_t begin = clock();
  plant_reset(&s);
  for (int k = 0; k < STEPS; k++) { u[0] = k & 1; plant_step(&s, u, y); sum += y[0]; }
  printf("%.2f million steps/s (check sum %g)\\n", STEPS / 1e6 / ((double)(clock() - begin) / CLOCKS_PER_SEC), sum);
  return 0;
}
"""
FMU_DRIVER = """
#include "plant.c"
#include <stdio.h>
#include <time.h>
int main(void) {
  const uint32_t in = 1, out = 2; double u[INPUTS] = {1, 2, 3, 4, 5, 6}, y[OUTPUTS], sum = 0;
  fmi3Instance m = fmi3InstantiateCoSimulation("p", TOKEN, NULL, 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL);
  fmi3EnterInitializationMode(m, 0, 0, 0, 0, 0); fmi3ExitInitializationMode(m);
  clock_t begin = clock();
  for (int k = 0; k < STEPS; k++) {
    u[0] = k & 1;
    fmi3SetFloat64(m, &in, 1, u, INPUTS); fmi3DoStep(m, k * DT, DT, 0, NULL, NULL, NULL, NULL);
    fmi3GetFloat64(m, &out, 1, y, OUTPUTS); sum += y[0];
  }
  printf("%.2f million steps/s (check sum %g)\\n", STEPS / 1e6 / ((double)(clock() - begin) / CLOCKS_PER_SEC), sum);
  return 0;
}
"""


def plant(n: int = 100, *, coupled: bool = False) -> ModalPlant:
    """Six rigid-body modes and elastic ones up to 500 Hz; coupled: with damping that couples all elastic modes."""
    rng = np.random.default_rng(1)
    omega = np.r_[np.zeros(6), np.sort(rng.uniform(10, 3000, n - 6))]
    names = [f"bus.{i}.1" for i in range(1, 7)]
    shapes = rng.standard_normal((2, n, 6))
    damping = None
    if coupled:
        half = rng.standard_normal((n, n))
        half[:6] = 0
        damping = half @ half.T / n + np.diag(0.01 * omega)
    return ModalPlant(
        omega=omega, zeta=0.005, damping=damping, shape_in=shapes[0], shape_out=shapes[1].T, inputs=names, outputs=names
    )


def dense(n: int = 200) -> StateSpace:
    """States that cannot be taken apart: a chain with one eigenvector."""
    rng = np.random.default_rng(1)
    names = [f"bus.{i}.1" for i in range(1, 7)]
    A = np.diag(-np.ones(n)) + np.diag(np.ones(n - 1), 1)
    return StateSpace(A, rng.standard_normal((n, 6)), rng.standard_normal((6, n)), np.zeros((6, 6)), names, names)


def main() -> None:
    """Compile and run them in double, in single precision, and for this processor."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        print("no C compiler found")
        return
    plants = {"100 modes": plant(), "100 modes, full damping": plant(coupled=True), "200 states, dense": dense()}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for title, given in plants.items():
            steps = STEPS // 100 if "dense" in title else STEPS
            write_plant(given, folder / "plant.c", dt=DT)
            for flags in ([], ["-DPLANT_REAL=float"], ["-march=native"]):
                speed = run(compiler, folder, DRIVER, ["plant.c", f"-DSTEPS={steps}", *flags])
                print(f"{title:24} C99 {' '.join(['-O3', *flags]):24} {speed}")
            write_plant(given, folder / "plant.fmu", version=3, binary=False)
            with zipfile.ZipFile(folder / "plant.fmu") as archive:
                (folder / "plant.c").write_bytes(archive.read("sources/plant.c"))
            speed = run(compiler, folder, FMU_DRIVER, [f"-DSTEPS={min(steps, FMU_STEPS)}", f"-DDT={DT!r}"])
            print(f"{title:24} FMU 3.0 {'-O3':20} {speed}")


def run(compiler: str, folder: Path, driver: str, arguments: list[str]) -> str:
    """Compile the driver with these arguments, and what it prints."""
    (folder / "bench.c").write_text(driver)
    subprocess.run([compiler, "-O3", "-std=c99", "-o", "bench", "bench.c", *arguments], cwd=folder, check=True)
    return subprocess.run([folder / "bench"], capture_output=True, text=True, check=True).stdout.strip()


if __name__ == "__main__":
    main()
