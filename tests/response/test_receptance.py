"""The sum over modes: interpolated far modes against plain sums, on every kind of grid, compiled or not."""

import numpy as np
import pytest

from flexplant.plant.modal import ModalPlant
from flexplant.response import receptance as module
from flexplant.response.frequency import frequency_response
from flexplant.response.receptance import ModalSum

GRIDS = {
    "dense": np.linspace(0.5, 1200, 3000),
    "dense from zero": np.linspace(0, 900, 3000),
    "logarithmic": np.geomspace(1e-3, 1e4, 2000),
    "narrow": np.linspace(99.9, 100.1, 1000),
    "shuffled": np.random.default_rng(0).permutation(np.linspace(0.5, 1200, 1000)),
    "one": np.array([50.0]),
    "equal": np.full(200, 50.0),
}


def plain(columns, omega, zeta, w):
    """Long double, term by term."""
    wn, z, x = (np.asarray(a, dtype=np.longdouble) for a in (omega, zeta, w))
    real, imaginary = (wn[:, None] - x) * (wn[:, None] + x), 2 * z[:, None] * wn[:, None] * x
    scale = 1 / (real**2 + imaginary**2)
    return columns @ (real * scale) - 1j * (columns @ (imaginary * scale))


@pytest.mark.parametrize("zeta", [0.0, 0.005, 0.7, 1.0, 3.0])
@pytest.mark.parametrize("grid", list(GRIDS))
def test_sums_keep_twelve_digits(grid, zeta):
    rng = np.random.default_rng(1)
    omega, w = 2 * np.pi * np.sort(rng.uniform(1, 1000, 200)), 2 * np.pi * GRIDS[grid]
    columns = rng.normal(size=(4, 200))
    total = ModalSum(columns, omega, np.full(200, zeta))
    found = np.concatenate([values for _, values in total.blocks(w)], axis=1)
    expected = plain(columns, omega, np.full(200, zeta), w)
    # relative to the modes' own sizes: the sum of their magnitudes
    size = abs(plain(abs(columns), omega, np.full(200, zeta), w))
    bound = np.maximum(abs(expected), 1e-3 * size)
    assert float((abs(found - expected) / bound).max()) < 1e-12
    assert float((abs(found - expected).max(axis=1) / abs(expected).max(axis=1)).max()) < 1e-12


@pytest.mark.parametrize("kernel", ["receptance", "chebyshev"])
def test_compiled_kernels_equal_plain_ones(kernel):
    rng = np.random.default_rng(0)
    if kernel == "receptance":
        arguments, shapes = (rng.uniform(1, 9, 7), rng.uniform(0, 2, 7), rng.uniform(1, 9, 30)), [(7, 30), (7, 30)]
    else:
        arguments, shapes = (rng.uniform(-1, 1, 30),), [(9, 30)]
    results = []
    for run in (getattr(module, kernel), getattr(module, kernel).fallback, getattr(module, kernel).loops):
        out = [np.empty(shape) for shape in shapes]
        run(*arguments, *out)
        results.append(np.concatenate(out))
    assert np.allclose(results[0], results[1], rtol=1e-12, atol=1e-14)
    assert np.allclose(results[2], results[1], rtol=1e-12, atol=1e-14)


def test_direct_and_general_paths_are_one_response():
    """A plant written without buffers, and the same with an acceleration row or a static correction beside it."""
    rng = np.random.default_rng(3)
    shapes = {"shape_in": rng.normal(size=(150, 3)), "shape_out": rng.normal(size=(2, 150))}
    omega, hz = np.sort(rng.uniform(10, 6000, 150)), np.linspace(1, 900, 1500)
    plain_plant = ModalPlant(omega=omega, zeta=0.01, inputs=list("abc"), outputs=list("xy"), **shapes)
    corrected = ModalPlant(
        omega=omega, zeta=0.01, static_correction=np.ones((2, 3)), inputs=list("abc"), outputs=list("xy"), **shapes
    )
    wide = {"shape_in": shapes["shape_in"], "shape_out": np.vstack([shapes["shape_out"], np.zeros((1, 150))])}
    rows = np.vstack([np.zeros((2, 150)), shapes["shape_out"][:1]])
    mixed = ModalPlant(omega=omega, zeta=0.01, shape_out_acceleration=rows, inputs=list("abc"), outputs=list("xya"), **wide)
    first = frequency_response(plain_plant, hz).values
    assert np.allclose(frequency_response(corrected, hz).values, first + 1, rtol=1e-13)
    both = frequency_response(mixed, hz).values
    assert abs(both[:2] - first).max() < 1e-13 * abs(first).max()
    assert np.allclose(both[2], -((2 * np.pi * hz) ** 2) * first[0], rtol=1e-9)
