"""The sum over modes: interpolated far modes against plain sums, on every kind of grid, compiled or not."""

import numpy as np
import pytest

from flexplant.plant.modal import ModalPlant
from flexplant.response import blocks, tiles
from flexplant.response import receptance as module
from flexplant.response.frequency import frequency_response
from flexplant.response.receptance import ModalSum
from flexplant.response.tiles import summed

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
    found = total(w)
    expected = plain(columns, omega, np.full(200, zeta), w)
    # relative to the sum of the magnitudes, of which 3e-15 is a dozen units of round-off
    size = abs(plain(abs(columns), omega, np.full(200, zeta), w))
    bound = np.maximum(abs(expected), 3e-3 * size)
    assert float((abs(found - expected) / bound).max()) < 1e-12
    assert float((abs(found - expected).max(axis=1) / abs(expected).max(axis=1)).max()) < 1e-12


KERNELS = {"compiled": summed, "numpy": summed.fallback, "plain Python": summed.loops}


@pytest.fixture(params=list(KERNELS))
def kernel(request, monkeypatch):
    """Every form of the inner loops in turn."""
    monkeypatch.setattr(module, "summed", KERNELS[request.param])
    return request.param


@pytest.mark.parametrize("count", [1, 2, 24, 25, 100, 203])
@pytest.mark.parametrize("rows", [1, 3, 4, 6])
def test_all_forms_of_the_loops_fill_every_tile(kernel, rows, count):
    """Rows and frequencies that fill no tile, derivatives, direct terms, a rigid-body mode, rows in a larger array."""
    rng = np.random.default_rng(rows)
    omega = np.r_[0.0, rng.uniform(300, 6000, 29)]
    zeta = np.r_[0.0, rng.uniform(1e-3, 1.5, 29)]
    columns, direct = rng.normal(size=(rows, 30)), rng.normal(size=rows)
    w = np.linspace(2.0, 900.0, count)
    where = rng.permutation(rows + 2)[:rows]
    for derivative in range(3):
        out = np.full((rows + 2, count), np.nan, dtype=complex)
        ModalSum(columns, omega, zeta)(w, derivative=derivative, direct=direct, out=out, rows=where)
        expected = plain(columns, omega, zeta, w) * (1j * w) ** derivative + direct[:, None]
        assert (abs(out[where] - expected).max(axis=1) / abs(expected).max(axis=1)).max() < 1e-13
        assert np.isnan(np.delete(out, where, axis=0)).all()


@pytest.mark.parametrize("count", [1, 30, 500])
def test_groups_are_sums_at_frequencies_of_their_own(kernel, count):
    rng = np.random.default_rng(5)
    omega, zeta, columns = np.r_[0.0, rng.uniform(300, 6000, 60)], np.r_[0.0, np.full(60, 0.01)], rng.normal(size=(3, 5, 61))
    w = np.outer([1.0, 2.5, 7.0], np.linspace(2.0, 900.0, count))
    found = ModalSum(columns, omega, zeta).groups(w)
    for g in range(3):
        one = ModalSum(columns[g], omega, zeta)(w[g])
        assert (abs(found[:, g] - one).max(axis=1) / abs(one).max(axis=1)).max() < 1e-14


def test_blocks_cover_all_frequencies_once():
    rng = np.random.default_rng(3)
    poles, w = np.sort(rng.uniform(0, 6000, 150)), np.linspace(1, 7000, 24 * 13 - 5)[None]
    table = module.work_blocks(w, poles, 2)
    order = np.argsort(table[:, 0])
    ends = table[order, :2]
    assert ends[0, 0] == 0
    assert ends[-1, 1] == w.size
    assert (ends[1:, 0] <= ends[:-1, 1]).all()  # only the last one is moved back to fill its strip
    assert ((ends[1:, 0] == ends[:-1, 1])[:-1]).all()
    assert len(table) > 3


def test_modes_at_the_edge_of_a_block_are_summed_one_by_one():
    """Poles everywhere around one block, one at a time: inside and outside the ellipse the error stays round-off."""
    w = np.linspace(1000.0, 1100.0, 480)
    for pole in np.r_[np.linspace(800, 1300, 26), 1000.0, 1100.0]:
        for zeta in (0.0, 1e-6, 0.01):
            one = np.array([pole + 1e-3])
            # many modes far above make interpolation pay
            omega = np.r_[one, np.linspace(5e4, 9e4, 100)]
            columns = np.r_[1.0, np.zeros(100)][None, :]
            expected = plain(columns, omega, np.full(101, zeta), w)
            found = ModalSum(columns, omega, np.full(101, zeta))(w)
            assert abs(found - expected).max() < 3e-14 * abs(expected).max(), (pole, zeta)


@pytest.mark.parametrize("shape", [(8, 3), (4, 1), (2, 2)])
def test_vectors_of_every_length_give_one_result(shape, monkeypatch):
    """The registers of other processors, compiled afresh."""
    numba = pytest.importorskip("numba")
    summed(*arguments())  # tells numba about the functions that the loops call
    monkeypatch.setattr(tiles, "vector_shape", lambda: shape)
    found, expected = arguments(), arguments()
    numba.njit(tiles.sum_blocks)(*found)
    summed.fallback(*expected)
    assert np.allclose(found[-1], expected[-1], rtol=1e-12, atol=1e-13 * abs(expected[-1]).max())


def arguments():
    """Of the inner loops: 40 modes, two tiles, three strips, modes 3 to 8 near."""
    rng = np.random.default_rng(0)
    n, nf = 40, 72
    transform = module.TO_COEFFICIENTS.ravel()
    return (
        rng.normal(size=8 * n), np.sort(rng.uniform(500, 900, n)), rng.uniform(1, 9, n), np.linspace(1, 20, nf),
        np.array([[0, nf, 3, 9, 0, 8]]), np.cos(module.ANGLES), transform, 0, rng.normal(size=8), np.arange(8),
        np.empty((n + 3 * 6) * 48), np.empty(3 * 24 * 24), np.zeros(8 * nf * 2),
    )  # fmt: skip


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


@pytest.mark.parametrize("scale", [1e-60, 1e-20, 1e-6, 1e9, 1e30, 1e60])
def test_units_of_time_do_not_matter(scale):
    """1 / (wn^2 - w^2 + ...) scales with the square of the unit, far beyond where the squares of its parts fit three by three."""
    rng = np.random.default_rng(2)
    omega, columns = np.r_[0.0, rng.uniform(300, 6000, 40)], rng.normal(size=(4, 41))
    w, zeta = np.linspace(0.0, 5000.0, 300), np.full(41, 0.01) * (omega > 0)
    one = ModalSum(columns, omega, zeta)(w)
    other = ModalSum(columns, omega * scale, zeta)(w * scale)
    assert np.isfinite(other).all()
    assert other * scale**2 == pytest.approx(one, rel=1e-11, abs=1e-13 * abs(one).max())


def test_repeated_frequencies_on_an_undamped_mode_keep_the_others():
    """Where three frequencies share a division, one of them on a pole leaves the other two as they are."""
    omega = np.array([7.0, 20.0])
    w = np.sort(np.r_[np.full(9, 7.0), np.linspace(1.0, 30.0, 39)])
    found = ModalSum(np.array([[1.0, 0.0], [0.0, 1.0]]), omega, np.zeros(2))(w)
    assert found[1] == pytest.approx(1 / (20.0**2 - w**2), rel=1e-13)
    assert found[0, w != 7.0] == pytest.approx(1 / (7.0**2 - w[w != 7.0] ** 2), rel=1e-13)
    assert (found[0, w == 7.0] == 0).all()


@pytest.mark.parametrize("tiles", [1, 5])
@pytest.mark.parametrize("grid", [name for name in GRIDS if name not in ("shuffled", "one")])
def test_all_forms_choose_blocks_of_the_same_least_work(grid, tiles):
    """Compiled, in plain Python and level by level: the same blocks, which cover every frequency once."""
    rng = np.random.default_rng(3)
    poles, w = np.sort(rng.uniform(0, 7000, 150)), np.outer([0.3, 1.0, 4.0], 2 * np.pi * GRIDS[grid])
    found = []
    for form in (blocks._chosen, blocks._chosen.loops, blocks._chosen.fallback):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(blocks, "_chosen", form)
            table = blocks.work_blocks(w, poles, tiles)
        found.append(table[np.lexsort(table.T[::-1])])
    assert np.array_equal(found[0], found[1])
    assert np.array_equal(found[0], found[2])
    covered = np.zeros(w.size, dtype=int)
    for start, stop in found[0][:, :2]:
        covered[start:stop] += 1
    assert (covered >= 1).all()
    assert covered.sum() - w.size < 24 * len(found[0])
