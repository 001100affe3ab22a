"""The peaks that adaptive grids promise, of close narrow MIMO modes and of closed loops, against norms and dense sampling."""

import numpy as np
import pytest

import flexplant as fp
from flexplant.errors import InputError
from flexplant.loop import grids
from flexplant.loop.close import close
from flexplant.plant.modal import ModalPlant

PROMISED = 1 - np.cos(np.pi / 28)


def close_modes(zeta, seed, n=12) -> ModalPlant:
    """Pairs of modes within a few half bandwidths of each other."""
    rng = np.random.default_rng(seed)
    base = 2 * np.pi * np.sort(rng.uniform(10, 1000, n))
    omega = np.sort(np.r_[base, base * (1 + zeta * rng.uniform(-5, 5, n))])
    return ModalPlant(
        omega=omega, zeta=zeta, shape_in=rng.normal(size=(2 * n, 4)), shape_out=rng.normal(size=(3, 2 * n)),
        inputs=list("abcd"), outputs=list("xyz"),
    )  # fmt: skip


@pytest.mark.parametrize("zeta", [1e-5, 1e-3, 0.02])
@pytest.mark.parametrize("seed", range(4))
def test_every_peak_of_close_modes_is_met_as_promised(zeta, seed):
    plant = close_modes(zeta, seed)
    grid = fp.adaptive_grid(plant, 1.0, 2000.0)
    gains = fp.singular_values(plant, grid).values[:, 0]
    assert gains.max() >= (1 - PROMISED) * fp.hinf_norm(plant).value
    for w in plant.omega:
        near = w / (2 * np.pi) * (1 + zeta * np.linspace(-12, 12, 3001))
        fine = fp.singular_values(plant, near).values[:, 0]
        if 0 < fine.argmax() < 3000:
            inside = (grid > near[0]) & (grid < near[-1])
            assert gains[inside].max() >= (1 - PROMISED) * fine.max()


@pytest.mark.parametrize("limit", [300, 0])
def test_peaks_of_closed_loops(monkeypatch, limit):
    """Rate feedback shifts and damps the modes; the grid of the closed loop still meets its peaks, by poles and by refinement."""
    monkeypatch.setattr(grids, "SMALL", limit)
    rng = np.random.default_rng(0)
    b = rng.normal(size=(20, 2))
    plant = ModalPlant(
        omega=2 * np.pi * np.sort(rng.uniform(5, 300, 20)), zeta=1e-3, shape_in=b, shape_out=b.T,
        inputs=["f", "w"], outputs=["x", "z"],
    )  # fmt: skip
    law = fp.transfer_function([-30.0, -3000.0], [1e-7, 6e-4, 1.0], input_name="e", output_name="f")
    diagram = fp.Diagram(
        blocks={"plant": plant, "law": law},
        connections=[("plant.x", "law.e"), ("law.f", "plant.f")],
        inputs={"w": "plant.w"},
        outputs={"z": "plant.z", "force": "law.f"},
    )
    hz = fp.adaptive_grid(diagram, 1.0, 2000.0)
    gains = fp.singular_values(fp.frequency_response(diagram, hz)).values[:, 0]
    poles = np.linalg.eigvals(close(diagram).A)
    assert gains.max() >= (1 - PROMISED) * fp.hinf_norm(diagram).value
    for pole in poles[(poles.imag > 2 * np.pi) & (abs(poles.real) < 0.1 * abs(poles))]:
        near = abs(pole.imag) / (2 * np.pi) + abs(pole.real) * np.linspace(-2, 2, 2001)
        fine = fp.singular_values(fp.frequency_response(diagram, near[near > 0])).values[:, 0]
        if 0 < fine.argmax() < fine.size - 1:
            inside = (hz > near[0]) & (hz < near[-1])
            assert gains[inside].max() >= (1 - 2 * PROMISED) * fine.max()


@pytest.mark.parametrize("limit", [300, 0])
def test_grids_of_diagrams_say_where_their_points_stand(monkeypatch, limit):
    monkeypatch.setattr(grids, "SMALL", limit)
    plant = close_modes(0.01, 0, n=3)
    inputs, outputs = ({name: f"p.{name}" for name in names} for names in (plant.inputs, plant.outputs))
    grid = fp.adaptive_grid(fp.Diagram(blocks={"p": plant}, inputs=inputs, outputs=outputs), 1.0, 2000.0)
    assert grid.resonance_hz == pytest.approx(plant.frequency_hz * np.sqrt(1 - 2e-4))
    assert grid.explanation.startswith(f"{grid.size} points from 1 to 2000 Hz: ")
    assert ("about the poles of every block by itself" in grid.explanation) == (limit == 0)


def test_bad_systems():
    with pytest.raises(InputError, match="got int"):
        fp.adaptive_grid(3, 1.0, 2.0)
