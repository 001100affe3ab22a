"""Plants of every kind, and an FMU of either version driven through FMPy, for the tests of FMUs."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexplant.plant.discretize import discretize
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, state_space

fmpy = pytest.importorskip("fmpy")
GCC = shutil.which("gcc")
needs_gcc = pytest.mark.skipif(GCC is None, reason="no C compiler (gcc)")
DT, N = 1e-3, 300
CHAIN = np.diag(-np.ones(6)) + np.diag(np.ones(5), 1)  # one eigenvector only: cannot be taken apart


def plant(n: int = 20, **given: object) -> ModalPlant:
    rng = np.random.default_rng(2)
    fields: dict = {
        "omega": np.r_[np.zeros(min(n, 2)), np.sort(rng.uniform(3, 5000, max(n - 2, 0)))],
        "zeta": 0.01,
        "shape_in": rng.standard_normal((n, 3)),
        "shape_out": rng.standard_normal((2, n)),
        "inputs": ["bus.101.1", "bus.101.2", 'odd "name" */ ??='],
        "outputs": ["optic.9.1", "optic.9.1:a"],
        "input_units": ["N", "N", "Nm"],
        "output_units": ["m", "m/s²"],
        "static_correction": np.array([[0, 0, 0], rng.standard_normal(3)]),
        "name": "plate & <co>",
    }
    return ModalPlant(**(fields | given))


def coupled(n: int = 20) -> ModalPlant:
    """Damping that couples the elastic modes."""
    half = np.random.default_rng(1).standard_normal((n, n))
    half[:2] = 0
    return plant(n, damping=half @ half.T)


def kinds() -> dict[str, Any]:
    names = {"inputs": ["a", "b"], "outputs": ["y"]}
    return {
        "modal": plant(),
        "full damping": coupled(),
        "state space": state_space(coupled()),
        "defective": StateSpace(CHAIN, np.eye(6, 2), np.ones((1, 6)), [[0, 1.0]], **names),
        "sampled": discretize(coupled(), DT),
        "sampled, defective": StateSpace(CHAIN / 2 + np.eye(6), np.eye(6, 2), np.ones((1, 6)), [[0, 1.0]], dt=DT, **names),
        "rigid only": plant(2, omega=np.zeros(2)),
        "one real pole": StateSpace([[-3.0]], [[1.0, 2.0]], [[1.0]], [[0.0, 0.0]], **names),
        "no states": plant(0),
    }


class Fmu:
    """An FMU of either version, with its inputs and outputs as vectors; messages: what it logged."""

    def __init__(self, path: Path, folder: Path) -> None:
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        about = fmpy.read_model_description(str(path))
        self.messages: list[str] = []
        self.third = about.fmiVersion == "3.0"
        given = {
            "guid": about.guid,
            "unzipDirectory": fmpy.extract(str(path), str(folder)),
            "modelIdentifier": about.coSimulation.modelIdentifier,
        }
        self.fmu = FMU3Slave(instanceName="p", **given) if self.third else FMU2Slave(instanceName="p", **given)
        self.about = about
        self.inputs = [v.valueReference for v in about.modelVariables if v.causality == "input"]
        self.outputs = [v.valueReference for v in about.modelVariables if v.causality == "output"]
        self.size = sum(
            int(np.prod(v.shape or (1,))) if self.third else 1 for v in about.modelVariables if v.causality == "output"
        )
        if self.third:
            self.fmu.instantiate(logMessage=self._logger())
        else:
            self.fmu.instantiate(callbacks=self._callbacks())

    def _logger(self) -> Any:
        from fmpy.fmi3 import fmi3LogMessageCallback

        return fmi3LogMessageCallback(lambda environment, status, category, text: self.messages.append(text.decode()))

    def _callbacks(self) -> Any:
        from fmpy import fmi2

        log = fmi2.fmi2CallbackLoggerTYPE(lambda environment, name, status, category, text: self.messages.append(text.decode()))
        allocate, free = fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc), fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
        return fmi2.fmi2CallbackFunctions(log, allocate, free, fmi2.fmi2StepFinishedTYPE(), None)

    def start(self) -> None:
        if not self.third:
            self.fmu.setupExperiment()
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def put(self, u: np.ndarray) -> None:
        (self.fmu.setFloat64 if self.third else self.fmu.setReal)(self.inputs, list(u))

    def get(self) -> np.ndarray:
        return np.array(self.fmu.getFloat64(self.outputs, self.size) if self.third else self.fmu.getReal(self.outputs))

    def save(self) -> Any:
        return self.fmu.getFMUState()

    def restore(self, saved: Any) -> None:
        self.fmu.setFMUState(saved)

    def run(self, u: np.ndarray, dt: float, start: int = 0) -> np.ndarray:
        y = []
        for k, now in enumerate(u.T, start):
            self.put(now)
            y.append(self.get())
            self.fmu.doStep(k * dt, dt)
        return np.array(y).T

    def close(self) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()


VERSIONS = pytest.mark.parametrize(
    "options", [{}, {"version": 3}, {"version": 3, "arrays": False}], ids=["2.0", "3.0", "3.0 scalars"]
)
