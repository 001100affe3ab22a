"""Random response: closed forms, exact integrals against fine grids, cross-spectra, and white noise."""

from dataclasses import replace

import numpy as np
import pytest

from flexplant.errors import InputError
from flexplant.loop import random
from flexplant.loop.close import close
from flexplant.loop.frequency import frequency_response
from flexplant.loop.line_of_sight import line_of_sight_diagram
from flexplant.loop.random import random_response
from flexplant.plant.modal import ModalPlant
from flexplant.plant.rigid_body import without_rigid_body
from flexplant.plant.state_space import state_space
from flexplant.response import band_variance
from flexplant.response.grids import adaptive_grid
from flexplant.response.h2 import white_noise_rms

W, Z = 2 * np.pi * 12.0, 0.01
ONE = ModalPlant(omega=[W], zeta=Z, shape_in=[[2.0]], shape_out=[[1.0]], inputs=["f"], outputs=["x"])


def test_miles_formula():
    """White noise of one-sided PSD g through one mode: sigma^2 = g / (8 zeta omega^3) b^2."""
    expected = np.sqrt(0.3 * 4 / (8 * Z * W**3))
    found = random_response(ONE, {"f": 0.3}, [0.0, 1.0, 1e3, 1e7])
    assert found.rms.item() == pytest.approx(expected, rel=1e-8)
    assert white_noise_rms(ONE, np.array([[0.15]])).item() == pytest.approx(expected, rel=1e-12)
    grid = np.r_[1e-9, adaptive_grid(ONE, 1e-3, 1e4, per_mode=401, per_decade=400)]
    assert random_response(ONE, {"f": 0.3}, grid).rms_grid.item() == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("form", [lambda p: p, state_space])
def test_exact_band_against_fine_quadrature(plant, form):

    flexible, hz = without_rigid_body(plant), np.linspace(60, 400, 8)
    rng = np.random.default_rng(0)
    spectra = {name: rng.uniform(1, 3, 8) for name in plant.inputs[:3]}
    found = random_response(form(flexible), spectra, hz)
    fine = np.linspace(60, 400, 400_001)
    tables = {name: (hz, values) for name, values in spectra.items()}
    dense = random_response(flexible, tables, fine)
    assert found.rms.values == pytest.approx(dense.rms_grid.values, rel=1e-6)


def test_closed_loop_and_cumulative(published, make_plant):
    system = line_of_sight_diagram(published, make_plant(n_rigid=0, zeta=0.02))
    hz = adaptive_grid(close(system), 1.0, 2000.0, per_mode=201, per_decade=500)
    found = random_response(system, {next(iter(system.inputs)): 1.0}, hz, cross=True)
    assert found.rms_grid.values == pytest.approx(found.rms.values, rel=1e-3)
    assert found.cumulative_rms[:, -1].values == pytest.approx(found.rms.values, rel=1e-12)
    assert found.cumulative_rms_down[:, 0].values == pytest.approx(found.rms.values, rel=1e-12)
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
    assert a.rms.values == pytest.approx(b.rms.values, rel=1e-9)
    # fully coherent inputs add as amplitudes
    direction = np.array([1.0, 1j, 0, 0, 0, -2.0])
    coherent = random_response(plant, np.repeat(np.outer(direction, direction.conj())[:, :, None], 50, axis=2), hz)

    amplitude = np.einsum("oif,i->of", frequency_response(plant, hz).values, direction)
    assert np.allclose(coherent.psd, abs(amplitude) ** 2, rtol=1e-9)


def test_rigid_body_mode_is_the_closed_form():
    """x'' = u: PSD g / (2 pi f)^4, and its integral."""
    free = ModalPlant(omega=[0.0], zeta=0.0, shape_in=[[1.0]], shape_out=[[1.0]], inputs=["f"], outputs=["x"])
    found = random_response(free, {"f": 2.0}, [0.5, 1.0, 40.0])
    assert found.rms.item() == pytest.approx(np.sqrt(2 / (2 * np.pi) ** 4 * (0.5**-3 - 40.0**-3) / 3), rel=1e-9)
    with pytest.raises(InputError, match="rigid-body mode 0"):
        random_response(free, {"f": 2.0}, [0.0, 1.0])


def test_critically_damped_mode_is_the_closed_form():
    """|G|^2 = 1 / (w^2 + w0^2)^2, whose integral over all frequencies is pi / (2 w0^3), one-sided pi / (4 w0^3)."""
    critical = ModalPlant(omega=[W], zeta=1.0, shape_in=[[1.0]], shape_out=[[1.0]], inputs=["f"], outputs=["x"])
    found = random_response(critical, {"f": 1.0}, [0.0, 10.0, 1e6])
    assert found.rms.item() == pytest.approx(np.sqrt(np.pi / (4 * W**3) / (2 * np.pi)), rel=1e-8)


def coherent_spectra(hz, nu, seed=0):
    """Hermitian, positive, different at every frequency."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(hz.size, nu, nu)) + 1j * rng.normal(size=(hz.size, nu, nu))
    return np.moveaxis(root @ root.conj().transpose(0, 2, 1), 0, -1)


def test_exact_cross_spectra_are_the_fine_quadrature(make_plant):
    plant, hz = make_plant(n_rigid=0, zeta=0.02), np.linspace(40, 500, 9)
    spectra = coherent_spectra(hz, 6)
    fine = np.linspace(40, 500, 40_001)
    between = np.stack([np.interp(fine, hz, row) for row in spectra.reshape(36, -1)]).reshape(6, 6, -1)
    dense = random_response(plant, between, fine)
    found = random_response(plant, spectra, hz)
    assert found.rms.values == pytest.approx(dense.rms_grid.values, rel=1e-6)
    assert random_response(state_space(plant), spectra, hz).rms.values == pytest.approx(found.rms.values, rel=1e-8)


def test_quadrature_and_residues_agree(published, make_plant, monkeypatch):
    system = line_of_sight_diagram(published, make_plant(n_rigid=0, zeta=0.005))
    hz = np.array([1.0, 30.0, 200.0, 900.0])
    spectra = coherent_spectra(hz, 6)
    closed = random_response(system, spectra, hz).rms
    monkeypatch.setattr(random, "SMALL", 0)
    quadrature = random_response(system, spectra, hz).rms
    assert quadrature.values == pytest.approx(closed.values, rel=1e-8)


def test_poles_are_taken_in_blocks(make_plant, monkeypatch):
    plant, hz = make_plant(n_rigid=0), np.linspace(10, 900, 7)
    whole = random_response(plant, coherent_spectra(hz, 6), hz).rms.values
    monkeypatch.setattr(band_variance, "CHUNK", 5)
    assert random_response(plant, coherent_spectra(hz, 6), hz).rms.values == pytest.approx(whole, rel=1e-12)


@pytest.mark.parametrize("form", [lambda p: p, state_space])
def test_cumulative_rms_does_not_depend_on_the_grid(make_plant, form):
    """The RMS up to a frequency is the RMS of the band that ends there, with residues and with quadrature."""
    for plant in (make_plant(n_rigid=0, zeta=0.01), make_plant(n_rigid=2, zeta=0.01)):
        hz = np.array([3.0, 41.0, 97.0, 250.0, 600.0])
        psd = {plant.inputs[0]: 1.5, plant.inputs[4]: ([2.0, 500.0], [1.0, 4.0])}
        found = random_response(form(plant), psd, hz)
        for k in range(1, hz.size - 1):
            below, above = (random_response(plant, psd, part).rms.values for part in (hz[: k + 1], hz[k:]))
            assert found.cumulative_rms[:, k].values == pytest.approx(below, rel=1e-7)
            assert found.cumulative_rms_down[:, k].values == pytest.approx(above, rel=1e-7, abs=1e-7 * found.rms.values.max())


def test_lines_of_a_table_between_the_frequencies_count(make_plant):
    """A narrow table on a coarse grid: G is nearly constant over it, so the variance is |G|^2 times the table's area."""
    hz = np.linspace(1, 300, 20)
    found = random_response(ONE, {"f": ([119.9, 120.0, 120.1], [0.0, 3.0, 0.0])}, hz)
    gain = abs(frequency_response(ONE, [120.0]).values.item())
    assert found.rms.item() == pytest.approx(gain * np.sqrt(0.3), rel=1e-4)
    assert found.rms_grid.item() == 0
    steps = random_response(ONE, {"f": ([100.0, 140.0], [2.0, 2.0])}, hz)  # jumps to zero at both ends
    assert steps.rms.item() == pytest.approx(random_response(ONE, {"f": 2.0}, [100.0, 140.0]).rms.item(), rel=1e-12)


@pytest.mark.parametrize("n_rigid", [0, 1])
def test_logarithmic_tables_are_a_test_specification(make_plant, n_rigid):
    """Random vibration from 20 to 2000 Hz, rising 6 dB an octave, flat, falling: 14.1 g RMS on double logarithmic paper."""
    lines, values = [20.0, 50.0, 800.0, 2000.0], [0.026, 0.16, 0.16, 0.026]
    through = ModalPlant(
        omega=[1.0], zeta=0.5, shape_in=[[0.0]], shape_out=[[1.0]], feedthrough=[[1.0]], inputs=["g"], outputs=["g"]
    )
    found = random_response(through, {"g": (lines, values)}, [20.0, 333.0, 2000.0], interpolation="log")
    rise, fall = np.log(values[1] / values[0]) / np.log(2.5), np.log(values[3] / values[2]) / np.log(2.5)
    area = (50 * 0.16 - 20 * 0.026) / (rise + 1) + 0.16 * 750 + (2000 * 0.026 - 800 * 0.16) / (fall + 1)
    assert found.rms.item() == pytest.approx(np.sqrt(area), rel=1e-9)
    plant = make_plant(n_rigid=n_rigid, zeta=0.02)
    fine = np.geomspace(20, 2000, 100_001)
    tables = {plant.inputs[0]: (np.array(lines), np.array(values))}
    dense = random_response(plant, tables, fine, interpolation="log").rms_grid.values
    assert random_response(plant, tables, [20.0, 2000.0], interpolation="log").rms.values == pytest.approx(dense, rel=1e-5)


def test_the_grid_rms_converges_with_order_two():
    errors = []
    for n in (2001, 4001, 8001):
        found = random_response(ONE, {"f": 1.0}, np.linspace(11.0, 13.0, n))
        errors.append(abs(found.rms_grid.item() / found.rms.item() - 1))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2, abs=0.1)


def test_undamped_modes_inside_and_outside_the_band():
    plant = ModalPlant(
        omega=2 * np.pi * np.array([10.0, 50.0]), zeta=[0.01, 0.0], shape_in=[[1.0], [1.0]], shape_out=[[1.0, 1.0]],
        inputs=["f"], outputs=["x"],
    )  # fmt: skip
    found = random_response(plant, {"f": 1.0}, [1.0, 20.0, 45.0, 60.0, 70.0])
    assert found.rms.item() == np.inf
    assert np.isfinite(found.cumulative_rms.values[0]).tolist() == [True, True, True, False, False]
    assert np.isfinite(found.cumulative_rms_down.values[0]).tolist() == [False, False, False, True, True]
    fine = random_response(plant, {"f": 1.0}, np.linspace(1.0, 30.0, 200_001)).rms_grid.item()
    assert random_response(plant, {"f": 1.0}, [1.0, 30.0]).rms.item() == pytest.approx(fine, rel=1e-6)


def test_unstable_systems_are_refused_with_their_pole(published, make_plant):
    growing = state_space(ONE)
    growing = replace(growing, A=growing.A + 2 * np.eye(2))
    with pytest.raises(InputError, match=r"unstable, with a pole at .*rad/s"):
        random_response(growing, {"f": 1.0}, [1.0, 2.0])
    wrong = replace(published, gain=-1800.0)
    for n in (4, 200):  # a small and a large diagram
        with pytest.raises(InputError, match=r"unstable.* pole.*rad/s"):
            random_response(line_of_sight_diagram(wrong, make_plant(n_flexible=n, n_rigid=0)), {}, [1.0, 2.0])


@pytest.mark.parametrize(
    ("psd", "hz", "message"),
    [
        ({"g": 1.0}, [1, 2], "no input 'g'"),
        ({"f": -1.0}, [1, 2], "not negative"),
        ({"f": [1.0, 2.0, 3.0]}, [1, 2], r"shape \(3,\)"),
        ({"f": ([1, 1], [2, 3])}, [1, 2], "hz ascending"),
        ({"f": ([1], [2])}, [1, 2], "at least two lines"),
        ({"f": ([1, 2], [np.nan, 2])}, [1, 2], "finite and not negative"),
        ({"f": 1.0}, [2, 1], "must ascend"),
        (np.ones((2, 2, 2)), [1, 2], r"\(1, 1, 2\) is needed"),
        (1j * np.ones((1, 1, 2)), [1, 2], "Hermitian"),
        (-np.ones((1, 1, 2)), [1, 2], "not positive at 1 Hz"),
    ],
)
def test_random_errors(psd, hz, message):
    with pytest.raises(InputError, match=message):
        random_response(ONE, psd, hz)


def test_interpolation_errors():
    with pytest.raises(InputError, match="interpolation='cubic' is not a choice"):
        random_response(ONE, {"f": 1.0}, [1, 2], interpolation="cubic")
    with pytest.raises(InputError, match="above zero"):
        random_response(ONE, {"f": ([0, 2], [1, 1])}, [1, 2], interpolation="log")
