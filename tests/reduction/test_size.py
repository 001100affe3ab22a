"""A budget of coordinates: the best basis of a size, its bound, its error rows, and what it must not lose."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from reduction_models import BUS, FEET, OPTIC, corners, meshes, shocksat

import flexplant as fp
from flexplant.errors import SolverError
from flexplant.reduction import craig_bampton

TOP = 2500.0


def solid():
    model = meshes.solid((6, 4, 4))
    return model, corners(model)


def truth(model, top_hz=TOP):
    modes = fp.normal_modes(model, max_frequency_hz=top_hz)
    return modes.frequency_hz[modes.n_rigid :]


def worst(component, exact):
    modes = fp.normal_modes(component)
    error = modes.frequency_hz[modes.n_rigid :][: exact.size] / exact - 1
    assert error.min() > -1e-9
    return error.max()


@cache
def shocksat_models():
    return tuple(shocksat(name) for name in ("bus", "optic")), truth(shocksat("whole"), 300.0)


def shocksat_modes(bus_size, optic_size):
    """Coupled system, its modes, the errors of those below 300 Hz."""
    (bus, optic), exact = shocksat_models()
    parts = [
        craig_bampton(bus, [(n, "123456") for n in BUS], size=bus_size, max_frequency_hz=300),
        craig_bampton(optic, [(n, "123456") for n in OPTIC], size=optic_size, max_frequency_hz=300),
    ]
    joint = fp.Connection("bus", "optic", pairs=[(f, f) for f in FEET], directions="123456")
    system = fp.couple(parts, [joint], method="primal")
    modes = fp.normal_modes(system, max_frequency_hz=310)
    assert [c.n_modal for c in parts] == [bus_size, optic_size]
    return system, modes, modes.frequency_hz[modes.n_rigid :][: exact.size] / exact - 1


def test_shocksat_in_176_and_80_coordinates():
    """80 modes and two blocks, of the same size, are off by 1.0e-6 and 4.2e-10."""
    _, _, error = shocksat_modes(176, 80)
    assert error.size == 61
    assert abs(error).max() < 1e-8
    assert abs(error[:4]).max() < 3e-10


def test_shocksat_in_125_coordinates_with_an_estimate_from_above():
    system, modes, error = shocksat_modes(125, 60)
    assert abs(error).max() < 1e-6
    assert error.max() < sum(c.report.verified for c in system.components)
    estimate = fp.estimate_error(system, modes=modes).total[: error.size]
    known = error > 1e-9
    assert known.sum() > 20
    ratio = estimate[known] / error[known]
    assert 0.98 < ratio.min() <= ratio.max() < 3


def test_every_size_keeps_its_bound_and_more_is_better():
    model, boundary = solid()
    exact = truth(model)
    bounds, errors = [], []
    for size in (16, 24, 32, 60):
        component = craig_bampton(model, boundary, size=size, max_frequency_hz=TOP)
        assert component.n_modal == size
        assert component.report.drawn_from > size
        bounds.append(component.report.verified)
        errors.append(worst(component, exact))
    assert (np.diff(bounds) < 0).all()
    assert (np.array(errors) < np.array(bounds)).all()
    assert errors[2] < 1e-2 * errors[0]


def test_a_size_beats_the_fixed_split():
    model, boundary = solid()
    exact = truth(model)
    fixed = craig_bampton(model, boundary, max_frequency_hz=1.5 * TOP, residual_vectors=2)
    drawn = craig_bampton(model, boundary, size=fixed.n_modal, max_frequency_hz=TOP)
    assert worst(drawn, exact) < 0.1 * worst(fixed, exact)


def test_the_form_and_the_exact_modes():
    model, boundary = solid()
    component = craig_bampton(model, boundary, size=30, max_frequency_hz=TOP, keep_basis=True)
    n_b = component.n_boundary
    np.testing.assert_array_equal(component.mass[n_b:, n_b:], np.eye(30))
    assert not component.stiffness[:n_b, n_b:].any()
    t = component.basis
    np.testing.assert_allclose(t.T @ (model.mass @ t), component.mass, atol=1e-9 * abs(component.mass).max())
    np.testing.assert_allclose(t.T @ (model.stiffness @ t), component.stiffness, atol=1e-9 * abs(component.stiffness).max())
    held = craig_bampton(model, boundary, max_frequency_hz=component.report.complete_below_hz * (1 - 1e-9))
    kept = component.report.n_modes
    assert kept == held.n_modal
    np.testing.assert_allclose(component.fixed_interface_hz[:kept], held.fixed_interface_hz, rtol=1e-9)


def test_error_rows_are_the_residual_of_the_unreduced_interior():
    """|w^2 L p|^2 = r^T Kii^-1 r with the residual r of the full model, for motions that satisfy the reduced equations of q."""
    model, boundary = solid()
    component = craig_bampton(model, boundary, size=24, max_frequency_hz=TOP, keep_basis=True)
    rows = model.dofs.rows(component.boundary.pairs)
    inside = np.setdiff1d(np.arange(len(model.dofs)), rows)
    k, m = model.stiffness.toarray(), model.mass.toarray()
    n_b, rng = component.n_boundary, np.random.default_rng(0)
    for hz in (0.3 * TOP, 0.9 * TOP):
        w2 = (2 * np.pi * hz) ** 2
        b = rng.standard_normal((n_b, 3))
        gap = np.diagonal(component.stiffness)[n_b:] - w2
        p = np.vstack([b, w2 * (component.mass[n_b:, :n_b] @ b) / gap[:, None]])
        residual = ((k - w2 * m) @ (component.basis @ p))[inside]
        energy = np.einsum("ij,ij->j", residual, np.linalg.solve(k[np.ix_(inside, inside)], residual))
        np.testing.assert_allclose(np.sum((w2 * component.error_rows @ p) ** 2, axis=0), energy, rtol=1e-5)


@pytest.mark.parametrize("options", [{"size": 40}, {"accuracy": 1e-3}])
def test_answers_to_interior_loads_are_not_drawn_away(options):
    model, boundary = solid()
    load = [(62, 1), (62, 3)]
    component = craig_bampton(model, boundary, max_frequency_hz=TOP, loads=load, recover=load, **options)
    rows = model.dofs.rows(component.boundary.pairs)
    inside = np.setdiff1d(np.arange(len(model.dofs)), rows)
    at = np.searchsorted(inside, model.dofs.rows(load))
    k = model.stiffness.toarray()[np.ix_(inside, inside)]
    full = np.linalg.inv(k)[np.ix_(at, at)]
    answer = component.recovery["displacement"].displacement[:, component.n_boundary :]
    reduced = (answer / np.diagonal(component.stiffness)[component.n_boundary :]) @ answer.T
    np.testing.assert_allclose(reduced, full, rtol=1e-8, atol=1e-8 * abs(full).max())


def test_a_size_beyond_the_interior_is_the_whole_model():
    model = meshes.solid((3, 1, 1))
    boundary = corners(model)
    component = craig_bampton(model, boundary, size=500, max_frequency_hz=100.0)
    assert component.n == len(model.dofs)
    assert component.report.verified < 1e-8  # what rounding may cause


@pytest.mark.parametrize("asked", [1e-9, 1e-12, 1e-16])
def test_no_statement_goes_below_what_double_precision_tells(asked):
    """The whole model's dense solution and the reduced one part at some 1e-12: what that rules out is refused, and the accuracy
    that the refusal names is kept."""
    model = meshes.solid((4, 2, 2))
    boundary = corners(model)
    hz = 1.001 * float(fp.normal_modes(model, n_modes=12).frequency_hz[-1])
    accuracy = asked
    if asked < 1e-10:
        with pytest.raises(SolverError, match=rf"accuracy {asked:g} .*is out of reach.* ask for accuracy=") as refused:
            craig_bampton(model, boundary, max_frequency_hz=hz, accuracy=asked)
        accuracy = float(str(refused.value).split("accuracy=")[1].split()[0])
        assert 1e-13 < accuracy < 1e-10
    report = (component := craig_bampton(model, boundary, max_frequency_hz=hz, accuracy=accuracy)).report
    exact = fp.normal_modes(model, max_frequency_hz=hz).frequency_hz[6:]
    found = fp.normal_modes(component).frequency_hz[6 : 6 + exact.size]
    assert abs(found / exact - 1).max() <= report.verified + 1e-13
    assert 1e-13 < report.verified <= accuracy == component.report.accuracy
