"""Twelve digits of a channel's largest value: modal responses against their definition in extended precision."""

import numpy as np
import pytest

from flexplant.plant.modal import ModalPlant
from flexplant.response import receptance
from flexplant.response.frequency import frequency_response
from flexplant.response.tiles import summed

RNG = np.random.default_rng(11)
SPREAD = 2 * np.pi * np.sort(RNG.uniform(1, 1000, 120))
MODES = {
    "lightly damped": (SPREAD, 0.005),
    "undamped": (SPREAD, 0.0),
    "critically damped": (SPREAD, 1.0),
    "around critical": (SPREAD, np.linspace(0.999999, 1.000001, 120)),
    "overdamped": (SPREAD, 4.0),
    "of all dampings": (SPREAD, RNG.uniform(0, 2, 120)),
    "nearly undamped": (SPREAD, 1e-6),
    "clustered": (2 * np.pi * 100 * (1 + 1e-9 * np.arange(120)), 1e-4),
    "repeated": (np.repeat(2 * np.pi * np.array([50.0, 51.0, 400.0]), 40), 0.01),
    "one": (SPREAD[:1], 0.01),
    "over twelve decades": (np.geomspace(1e-6, 1e6, 120), 0.01),
}
GRIDS = {
    "linear": np.linspace(0.5, 1200, 1501),
    "logarithmic": np.geomspace(1e-3, 1e5, 1000),
    "random": np.sort(RNG.uniform(0.1, 1500, 997)),
    "at the modes": np.sort((SPREAD[:, None] / (2 * np.pi) * (1 + np.array([-1e-5, -1e-6, 1e-7, 1e-6]))).ravel()),
    "in one resonance": np.linspace(99.999, 100.001, 300),
    "with repeats": np.repeat(np.linspace(1, 900, 60), 9),
    "one": np.array([77.7]),
    "two": np.array([3.0, 900.0]),
    "a strip and one": np.linspace(1, 600, 25),
}


def plant(modes: str, *, rigid: int = 0) -> ModalPlant:
    """Three displacement, velocity, acceleration outputs, one of each kind and one of all kinds together, static correction."""
    rng = np.random.default_rng(12)
    omega, zeta = MODES[modes]
    omega, zeta = np.r_[np.zeros(rigid), omega], np.r_[np.zeros(rigid), np.broadcast_to(zeta, omega.shape)]
    kinds = {"shape_out": [1, 1, 0, 0, 1], "shape_out_velocity": [0, 0, 1, 0, 1], "shape_out_acceleration": [0, 0, 0, 1, 1]}
    return ModalPlant(
        omega=omega,
        zeta=zeta,
        shape_in=rng.normal(size=(omega.size, 3)),
        static_correction=1e-9 * rng.normal(size=(5, 3)),
        inputs=list("abc"),
        outputs=["x", "y", "v", "a", "all"],
        **{kind: rng.normal(size=(5, omega.size)) * np.array(used)[:, None] for kind, used in kinds.items()},
    )


def definition(p: ModalPlant, hz) -> np.ndarray:
    """The equations of `ModalPlant`, mode by mode, in extended precision at the double-precision frequencies."""
    w = (2 * np.pi * np.asarray(hz)).astype(np.longdouble)
    wn, zeta = p.omega.astype(np.longdouble)[:, None], p.zeta.astype(np.longdouble)[:, None]
    eta = 1 / ((wn - w) * (wn + w) + 2j * zeta * wn * w)
    out = np.repeat(p.direct.astype(np.clongdouble)[:, :, None], w.size, axis=2)
    for order, rows in enumerate((p.shape_out, p.shape_out_velocity, p.shape_out_acceleration)):
        for i, row in enumerate(rows.astype(np.longdouble)):
            if row.any():
                out[i] += ((row[:, None] * p.shape_in).T @ eta) * (1j * w) ** order
    return out


def error(found, expected) -> float:
    """Relative to each channel's largest value."""
    return float((abs(found - expected).max(axis=2) / abs(expected).max(axis=2)).max())


@pytest.fixture(params=["compiled", "numpy"])
def route(request, monkeypatch):
    if request.param == "numpy":
        monkeypatch.setattr(receptance, "summed", summed.fallback)
    return request.param


@pytest.mark.parametrize("grid", list(GRIDS))
@pytest.mark.parametrize("modes", list(MODES))
def test_modal_response_keeps_twelve_digits(route, modes, grid):
    p, hz = plant(modes), GRIDS[grid]
    assert error(frequency_response(p, hz).values, definition(p, hz)) < 1e-12


@pytest.mark.parametrize("grid", list(GRIDS))
def test_rigid_body_modes_keep_twelve_digits(route, grid):
    p, hz = plant("lightly damped", rigid=3), GRIDS[grid]
    assert error(frequency_response(p, hz).values, definition(p, hz)) < 1e-12


def test_twelve_digits_above_the_rigid_body_modes(route):
    """Each frequency by itself: a rigid body's large response at the first frequency hides nothing at the others."""
    p, hz = plant("lightly damped", rigid=3), np.geomspace(1e-2, 2e3, 900)
    found, expected = frequency_response(p, hz).values, definition(p, hz)
    assert float(np.median(abs(found - expected) / abs(expected))) < 1e-14
    assert float((abs(found - expected) / abs(expected)).max()) < 1e-11


def test_at_rest(route):
    """0 Hz: the static response of flexible modes, and rigid-body accelerations, beside other frequencies."""
    hz = np.r_[0.0, GRIDS["linear"]]
    p = plant("of all dampings")
    found = frequency_response(p, hz).values
    assert error(found, definition(p, hz)) < 1e-12
    static = (p.shape_out / p.omega**2) @ p.shape_in + p.static_correction
    assert np.allclose(found[:2, :, 0], static[:2], rtol=1e-12)
    assert np.allclose(found[2:4, :, 0], p.static_correction[2:4], rtol=1e-12)
    free = plant("lightly damped", rigid=2)
    only = ModalPlant(
        omega=free.omega,
        zeta=free.zeta,
        shape_in=free.shape_in,
        shape_out_acceleration=free.shape_out_acceleration[3:],
        inputs=free.inputs,
        outputs=free.outputs[3:],
    )
    rigid = only.shape_out_acceleration[:, :2] @ only.shape_in[:2]
    assert np.allclose(frequency_response(only, hz).values[:, :, 0], rigid, rtol=1e-13)


def test_acceleration_of_a_rigid_body_beside_a_relative_displacement(route):
    """One output of two kinds, of which only the acceleration sees the rigid-body mode: finite at 0 Hz."""
    mixed = ModalPlant(
        omega=[0.0, 40.0],
        zeta=[0.0, 0.02],
        shape_in=[[2.0], [1.0]],
        shape_out=[[0.0, 3.0]],
        shape_out_acceleration=[[5.0, 1.0]],
        inputs=["f"],
        outputs=["y"],
    )
    hz = np.r_[0.0, np.linspace(0.1, 30, 60)]
    found, w = frequency_response(mixed, hz).values[0, 0], 2 * np.pi * hz
    expected = 10.0 + (3.0 - w**2) / (40.0**2 - w**2 + 2j * 0.02 * 40.0 * w)
    assert np.allclose(found, expected, rtol=1e-12)
