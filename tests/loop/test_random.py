"""Random response: closed forms, exact integrals against fine grids, cross-spectra, and white noise."""

import numpy as np
import pytest

from flexplant.errors import InputError
from flexplant.loop.close import close
from flexplant.loop.frequency import frequency_response
from flexplant.loop.line_of_sight import line_of_sight_diagram
from flexplant.loop.random import random_response
from flexplant.plant.modal import ModalPlant
from flexplant.plant.rigid_body import without_rigid_body
from flexplant.plant.state_space import state_space
from flexplant.response.grids import adaptive_grid
from flexplant.response.h2 import white_noise_rms

W, Z = 2 * np.pi * 12.0, 0.01
ONE = ModalPlant(omega=[W], zeta=Z, shape_in=[[2.0]], shape_out=[[1.0]], inputs=["f"], outputs=["x"])


def test_miles_formula():
    """White noise of one-sided PSD g through one mode: sigma^2 = g / (8 zeta omega^3) b^2."""
    expected = np.sqrt(0.3 * 4 / (8 * Z * W**3))
    found = random_response(ONE, {"f": 0.3}, [0.0, 1.0, 1e3, 1e7])
    assert found.rms_exact.item() == pytest.approx(expected, rel=1e-8)
    assert white_noise_rms(ONE, np.array([[0.15]])).item() == pytest.approx(expected, rel=1e-12)
    grid = np.r_[1e-9, adaptive_grid(ONE, 1e-3, 1e4, per_mode=401, per_decade=400)]
    assert random_response(ONE, {"f": 0.3}, grid).rms.item() == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("form", [lambda p: p, state_space])
def test_exact_band_against_fine_quadrature(plant, form):

    flexible, hz = without_rigid_body(plant), np.linspace(60, 400, 8)
    rng = np.random.default_rng(0)
    spectra = {name: rng.uniform(1, 3, 8) for name in plant.inputs[:3]}
    found = random_response(form(flexible), spectra, hz)
    fine = np.linspace(60, 400, 400_001)
    tables = {name: (hz, values) for name, values in spectra.items()}
    dense = random_response(flexible, tables, fine)
    assert found.rms_exact.values == pytest.approx(dense.rms.values, rel=1e-6)


def test_closed_loop_and_cumulative(published, make_plant):
    system = line_of_sight_diagram(published, make_plant(n_rigid=0, zeta=0.02))
    hz = adaptive_grid(close(system), 1.0, 2000.0, per_mode=201, per_decade=500)
    found = random_response(system, {next(iter(system.inputs)): 1.0}, hz, cross=True)
    assert found.rms.values == pytest.approx(found.rms_exact.values, rel=1e-3)
    assert found.cumulative_rms[:, -1].values == pytest.approx(found.rms.values)
    assert found.cumulative_rms_down[:, 0].values == pytest.approx(found.rms.values)
    total = np.hypot(found.cumulative_rms, found.cumulative_rms_down)
    assert np.allclose(total, found.rms.values[:, None])
    assert np.allclose(found.cross.values[[0, 1], [0, 1]].real, found.psd)


def test_cross_spectra(make_plant):
    plant, hz = make_plant(n_rigid=0), np.linspace(10, 300, 50)
    diagonal = np.zeros((6, 6, 50), dtype=complex)
    diagonal[[0, 2], [0, 2]] = np.array([2.0, 5.0])[:, None]
    a = random_response(plant, diagonal, hz)
    b = random_response(plant, {plant.inputs[0]: 2.0, plant.inputs[2]: 5.0}, hz)
    assert np.allclose(a.psd, b.psd, rtol=1e-10)
    assert np.isnan(a.rms_exact).all()
    # fully coherent inputs add as amplitudes
    direction = np.array([1.0, 1j, 0, 0, 0, -2.0])
    coherent = random_response(plant, np.repeat(np.outer(direction, direction.conj())[:, :, None], 50, axis=2), hz)

    amplitude = np.einsum("oif,i->of", frequency_response(plant, hz).values, direction)
    assert np.allclose(coherent.psd, abs(amplitude) ** 2, rtol=1e-9)


def test_rigid_body_modes_have_no_exact_band(plant):
    assert np.isnan(random_response(plant, {plant.inputs[0]: 1.0}, [1.0, 2.0]).rms_exact).all()


@pytest.mark.parametrize(
    ("psd", "hz", "message"),
    [
        ({"g": 1.0}, [1, 2], "no input 'g'"),
        ({"f": -1.0}, [1, 2], "not negative"),
        ({"f": [1.0, 2.0, 3.0]}, [1, 2], r"shape \(3,\)"),
        ({"f": ([1, 1], [2, 3])}, [1, 2], "hz ascending"),
        ({"f": 1.0}, [2, 1], "must ascend"),
        (np.ones((2, 2, 2)), [1, 2], r"\(1, 1, 2\) is needed"),
        (1j * np.ones((1, 1, 2)), [1, 2], "Hermitian"),
        (-np.ones((1, 1, 2)), [1, 2], "not positive at 1 Hz"),
    ],
)
def test_random_errors(psd, hz, message):
    with pytest.raises(InputError, match=message):
        random_response(ONE, psd, hz)
