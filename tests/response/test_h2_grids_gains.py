"""H2 norms against Lyapunov and slycot, grids that meet every peak, and gain sweeps against dense closed loops."""

import control
import numpy as np
import pytest

from flexplant.errors import InputError
from flexplant.plant.discretize import discretize
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, state_space
from flexplant.response.frequency import frequency_response
from flexplant.response.gain_sweep import GainSweep
from flexplant.response.grids import adaptive_grid
from flexplant.response.h2 import h2_norm, white_noise_rms


def modal(n=12, *, zeta=0.01, rigid=0, seed=0, velocity=True) -> ModalPlant:
    rng = np.random.default_rng(seed)
    return ModalPlant(
        omega=np.r_[np.zeros(rigid), np.sort(rng.uniform(5, 500, n - rigid))],
        zeta=zeta,
        shape_in=rng.normal(size=(n, 3)),
        shape_out=rng.normal(size=(2, n)),
        shape_out_velocity=rng.normal(size=(2, n)) if velocity else None,
        inputs=list("abc"),
        outputs=list("xy"),
    )


def test_h2_of_one_mode_is_the_closed_form():
    w, z = 30.0, 0.02
    plant = ModalPlant(omega=[w], zeta=z, shape_in=[[2.0]], shape_out=[[3.0]], inputs=["f"], outputs=["x"])
    assert h2_norm(plant) == pytest.approx(6 / np.sqrt(4 * z * w**3), rel=1e-13)


@pytest.mark.parametrize("zeta", [1e-4, 0.05, 1.0, 3.0])
def test_h2_of_modes_is_the_lyapunov_one(zeta):
    plant, W = modal(zeta=zeta), np.diag([1.0, 0.2, 3.0])
    assert white_noise_rms(plant, W) == pytest.approx(white_noise_rms(state_space(plant), W), rel=1e-7)


def test_h2_is_python_controls():
    s = state_space(modal(zeta=0.2))
    assert h2_norm(s) == pytest.approx(control.norm(control.ss(s.A, s.B, s.C, s.D), 2), rel=1e-8)
    d = discretize(modal(zeta=0.2), 1e-2)
    assert h2_norm(d) == pytest.approx(control.norm(control.ss(d.A, d.B, d.C, d.D, 1e-2), 2), rel=1e-8)


def test_repeated_modes_and_infinite_norms():
    plant = ModalPlant(omega=[9.0, 9.0], zeta=0.01, shape_in=[[1.0], [1.0]], shape_out=[[1.0, -1.0]], inputs=["f"], outputs=["x"])
    assert h2_norm(plant) == pytest.approx(0.0, abs=1e-12)
    assert h2_norm(modal(rigid=2)) == np.inf
    assert h2_norm(modal(zeta=0.0)) == np.inf
    assert h2_norm(StateSpace(-np.eye(1), np.eye(1), np.eye(1), np.eye(1), ["u"], ["y"])) == np.inf
    with pytest.raises(InputError, match=r"intensity of shape \(2, 2\)"):
        white_noise_rms(modal(), np.eye(2))


@pytest.mark.parametrize("zeta", [1e-5, 1e-3, 0.02])
def test_grid_meets_every_peak(zeta):
    plant = modal(zeta=zeta, velocity=False)
    grid = adaptive_grid(plant, 0.1, 200.0)
    assert (np.diff(grid) > 0).all()
    assert (grid[0], grid[-1]) == (0.1, 200.0)
    found = abs(frequency_response(plant, grid).values)
    for w in plant.omega:
        near = w / (2 * np.pi) * (1 + np.linspace(-3, 3, 20001) * zeta)
        fine = abs(frequency_response(plant, near).values)
        inside = (grid > near[0]) & (grid < near[-1])
        # where the window holds a peak, not a flank of a stronger neighbour
        peak = np.isin(fine.argmax(axis=2), np.arange(5000, 15001))
        assert (found[:, :, inside].max(axis=2)[peak] > 0.99 * fine.max(axis=2)[peak]).all()
    assert np.allclose(adaptive_grid(state_space(plant), 0.1, 200.0), grid, rtol=1e-6)


def test_grid_says_where_its_points_stand():
    omega = 2 * np.pi * np.array([0.01, 2.0, 30.0, 40.0, 4000.0])
    plant = ModalPlant(
        omega=omega,
        zeta=[0.01, 0.01, 0.0, 0.9, 0.01],
        shape_in=np.ones((5, 1)),
        shape_out=np.ones((1, 5)),
        inputs=["u"],
        outputs=["y"],
    )
    grid = adaptive_grid(plant, 0.1, 200.0)
    assert grid.resonance_hz == pytest.approx([2.0 * np.sqrt(1 - 2e-4), 30.0])
    assert grid.undamped_hz == pytest.approx([30.0])
    assert grid.explanation.startswith(f"{grid.size} points from 0.1 to 200 Hz: 60 a decade, and 13 about each resonance")
    assert "2 resonances, those at 30 Hz without damping: bracketed, not hit" in grid.explanation
    for at in grid.resonance_hz:
        assert np.count_nonzero(abs(grid / at - 1) < 0.2) >= 12
    assert frequency_response(plant, grid).frequency.size == grid.size
    assert grid[2:5].explanation == ""
    assert (2 * grid).explanation == ""
    assert np.unique(grid).size == grid.size


def test_grid_never_sits_on_an_undamped_mode():
    plant = modal(zeta=0.0, rigid=2)
    grid = adaptive_grid(plant, 0.1, 200.0)
    assert np.isfinite(frequency_response(plant, grid)).all()
    with pytest.raises(InputError, match="0 < low < high"):
        adaptive_grid(plant, 0.0, 10.0)
    with pytest.raises(InputError, match="at least 3"):
        adaptive_grid(plant, 1.0, 10.0, per_mode=1)


@pytest.mark.parametrize("r", [1, 2])
def test_gain_sweep_is_the_dense_closed_loop(r):
    s, hz = state_space(modal(zeta=0.05)), np.geomspace(0.5, 100, 60)
    G = frequency_response(s, hz).values
    loops = GainSweep(G[:, :1], G[:, 1 : 1 + r], G[:r, :1], G[:r, 1 : 1 + r])
    for gain in (-40.0, 0.0, 5.0):
        A = s.A + gain * s.B[:, 1 : 1 + r] @ s.C[:r]
        closed = StateSpace(A, s.B[:, :1], s.C, np.zeros((2, 1)), ["a"], list("xy"))
        dense = np.stack([closed.C @ np.linalg.solve(2j * np.pi * f * np.eye(24) - A, closed.B) for f in hz], axis=-1)
        found = loops(gain, np.empty_like(G[:, :1]))
        assert abs(found - dense).max() < 1e-11 * abs(dense).max()


def test_gain_sweep_shapes():
    with pytest.raises(InputError, match=r"G_zu has shape \(2, 2, 3\), but \(2, 1, 3\)"):
        GainSweep(np.ones((2, 3, 3)), np.ones((2, 2, 3)), np.ones((1, 3, 3)), np.ones((1, 1, 3)))
    with pytest.raises(InputError, match="cannot be diagonalised"):
        GainSweep(np.ones((1, 1, 1)), np.ones((1, 2, 1)), np.ones((2, 1, 1)), np.array([[1.0, 1.0], [0.0, 1.0]])[:, :, None])
