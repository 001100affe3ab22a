"""Lumped masses, and nearly all modes kept: the boundary's own mass is what cancelling leaves, nearly nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from structures import frame_model

from flexplant.assembly import Connection, System, couple
from flexplant.modes import normal_modes
from flexplant.plant.descriptor import descriptor
from flexplant.plant.modal import modal_plant
from flexplant.reduction import craig_bampton
from flexplant.response.frequency import frequency_response
from flexplant.verification import verify

HZ = [0.5, 3.0, 20.0]
CHANNELS = ["b.20.3", "b.20.5"]


def lumped(name: str, seed: int, start: float):
    """Six nodes in two rows, beams between them; half of the DOF, the rotations, without mass."""
    rng = np.random.default_rng(seed)
    line = {10 * i + j: np.array([0.5 * i + start, 0.4 * j, 0.1 * rng.random()]) for i in range(3) for j in range(2)}
    bars = [(10 * i + j, 10 * i + 10 + j) for i in range(2) for j in range(2)] + [(10 * i, 10 * i + 1) for i in range(3)]
    model = frame_model(name, line, bars)
    share = model.mass.diagonal().reshape(-1, 6)[:, :3].mean(axis=1)
    return replace(model, mass=np.diag(np.kron(share, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0])))


def coupled(seed: int, kept: tuple[int, int]) -> System:
    a, b = lumped("a", seed, 0.0), lumped("b", seed + 10, 1.05)
    parts = [
        craig_bampton(model, [(n, d) for n in nodes for d in range(1, 7)], n_modes=n_modes)
        for model, nodes, n_modes in ((a, (20, 21), kept[0]), (b, (0, 1, 20), kept[1]))
    ]
    return couple(parts, [Connection("a", "b", pairs=[(20, 0), (21, 1)], offset="rigid")])


@pytest.mark.parametrize(("seed", "kept"), [(0, (10, 6)), (2, (10, 6)), (0, (8, 5)), (0, (11, 7))])
def test_modal_and_descriptor_agree_beside_modes_of_a_million_hertz(seed, kept):
    system = coupled(seed, kept)
    form = {"inputs": CHANNELS, "outputs": CHANNELS}
    modal, direct = (
        frequency_response(plant, HZ).values
        for plant in (modal_plant(system, damping_ratio=0.0, **form), descriptor(system, **form))
    )
    np.testing.assert_allclose(modal, direct, rtol=3e-8)
    modes = normal_modes(system)
    assert modes.n_rigid == 6
    assert modes.residuals.max() < 1e-11
    assert verify(system, modes=modes).passed


def test_verify_sees_what_a_solver_leaves_of_stiff_modes_in_soft_ones():
    """As eigh(K, M) does beside a nearly massless motion: little in the shape, more in its strain energy."""
    system = coupled(0, (10, 6))
    modes = normal_modes(system)
    shapes = modes.shapes.copy()
    shapes[:, 6] += 1e-4 * modes.omega[6] / modes.omega[-1] * shapes[:, -1]
    (check,) = [
        c for c in verify(system, modes=replace(modes, shapes=shapes)).checks if c.name == "strain energy shared by modes"
    ]
    assert not check.passed
    assert check.value == pytest.approx(1e-4, rel=1e-3)
