"""Plants of every kind, for the tests of C source and FMUs."""

from __future__ import annotations

import shutil
from typing import Any

import numpy as np
import pytest

from flexplant.plant.discretize import discretize
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, state_space

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
