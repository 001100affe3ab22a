"""An FMU of either version driven through FMPy, for the tests of FMUs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

fmpy = pytest.importorskip("fmpy")


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
