"""Promised accuracy is kept on every kind of model, errors are estimated without the full model, orders of convergence."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import scipy.linalg as la
from reduction_models import BUS, FEET, OPTIC, cofe_beams, corners, lumped_beam, meshes, plate, rotor, shocksat

import flexplant as fp
from flexplant.errors import InputError, SolverError
from flexplant.reduction import craig_bampton, rubin
from flexplant.verification.reduction_error import estimate_error


def cofe(part):
    model = cofe_beams()[part - 1]
    return model, [(6, "26")], 30_000.0


MODELS = {
    "solid": lambda: (m := meshes.solid((8, 4, 4)), corners(m), 4000.0),
    "plate": lambda: (m := plate(8), corners(m, 2), 300.0),
    "shell with double modes": lambda: (meshes.shell(12, 6), [(1, "123456"), (7, "123456")], 60.0),
    "singular mass": lambda: (lumped_beam(), [(1, "26"), (41, "26")], 100.0),
    "rotor": lambda: (rotor(), [(n, "123") for n in (37, 38, 39, 40)], 300.0),
    "cofe, first part": lambda: cofe(1),
    "cofe, second part": lambda: cofe(2),
}


def attached(matrix, rows, extra):
    """The dense matrix with `extra` (n_b, n_b) added at the boundary rows."""
    out = matrix.toarray() if hasattr(matrix, "toarray") else np.array(matrix)
    out[np.ix_(rows, rows)] += extra
    return out


def lowest_hz(k, m, above=0.0):
    """Frequencies above a floor that rigid-body motion stays under, massless directions condensed."""
    model = fp.FiniteElementModel(name="x", stiffness=k, mass=m, dofs=[(i + 1, 0) for i in range(len(k))])
    hz = fp.normal_modes(model).frequency_hz
    return hz[hz > above]


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6])
@pytest.mark.parametrize("name", MODELS)
def test_promises_are_kept_whatever_is_attached(name, accuracy):
    model, boundary, top_hz = MODELS[name]()
    component = craig_bampton(model, boundary, accuracy=accuracy, max_frequency_hz=top_hz)
    report = component.report
    assert report.verified <= accuracy == report.accuracy
    assert report.complete_below_hz > top_hz
    assert report.proved
    rows = model.dofs.rows(component.boundary.pairs)
    n_b, rng = rows.size, np.random.default_rng(4)
    for soft in (0.0, 0.3):
        a, b = rng.standard_normal((2, n_b, n_b))
        springs = soft * a @ a.T * abs(model.stiffness.diagonal()).max() * 1e-3
        masses = soft * b @ b.T * abs(model.mass.diagonal()).mean()
        full = lowest_hz(
            *(attached(x, rows, y) for x, y in ((model.stiffness, springs), (model.mass, masses))), above=1e-3 * top_hz
        )
        at = np.arange(n_b)
        small = lowest_hz(
            *(attached(x, at, y) for x, y in ((component.stiffness, springs), (component.mass, masses))), above=1e-3 * top_hz
        )
        inside = np.count_nonzero(full <= top_hz)
        assert inside > 1
        error = small[:inside] / full[:inside] - 1
        assert error.max() < accuracy
        assert error.min() > -1e-8


@cache
def shocksat_models():
    return shocksat("bus"), shocksat("optic"), shocksat("whole")


@cache
def shocksat_truth():
    modes = fp.normal_modes(shocksat_models()[2], max_frequency_hz=300)
    return modes.frequency_hz[modes.n_rigid :]


def shocksat_system(reduce_bus, reduce_optic):
    bus, optic, _ = shocksat_models()
    parts = [
        reduce_bus(bus, [(n, "123456") for n in BUS]),
        reduce_optic(optic, [(n, "123456") for n in OPTIC]),
    ]
    joint = fp.Connection("bus", "optic", pairs=[(f, f) for f in FEET], directions="123456")
    return parts, fp.couple(parts, [joint], method="primal")


def shocksat_error(system):
    modes = fp.normal_modes(system, max_frequency_hz=320)
    truth = shocksat_truth()
    return modes, modes.frequency_hz[modes.n_rigid :][: truth.size] / truth - 1


def test_shocksat_with_176_and_60_coordinates():
    (bus, optic), system = shocksat_system(
        lambda m, b: craig_bampton(m, b, n_modes=80, residual_vectors=2),
        lambda m, b: craig_bampton(m, b, n_modes=30, residual_vectors=1),
    )
    assert (bus.n_modal, optic.n_modal) == (176, 60)
    modes, error = shocksat_error(system)
    assert error.size == 61
    assert abs(error).max() < 1.05e-6  # 1e-4 %: measured 1.02e-6
    assert abs(error[:4]).max() < 1e-9
    estimate = estimate_error(system, modes=modes)
    known = error > 1e-9
    ratio = estimate.total[: error.size][known] / error[known]
    assert ratio.min() > 0.98
    assert ratio.max() < 2.5
    assert estimate.components == ("bus", "optic")


def test_shocksat_promise_beats_classic_at_half_the_size():
    reduce = lambda m, b: craig_bampton(m, b, accuracy=1e-6, max_frequency_hz=300)  # noqa: E731
    (bus, optic), system = shocksat_system(reduce, reduce)
    _, error = shocksat_error(system)
    assert abs(error).max() < 1e-6
    assert bus.n_modal < 170
    assert optic.n_modal < 60


def test_estimate_names_the_component_whose_basis_is_small():
    _, system = shocksat_system(
        lambda m, b: craig_bampton(m, b, max_frequency_hz=700), lambda m, b: craig_bampton(m, b, n_modes=30, residual_vectors=2)
    )
    modes, error = shocksat_error(system)
    modes = fp.normal_modes(system)
    estimate = estimate_error(system, modes=modes)
    assert (estimate.by_component[:40, 0] > 10 * estimate.by_component[:40, 1]).all()
    ratio = estimate.total[:40] / error[:40]
    assert 1.0 < np.median(ratio) < 1.2
    assert ratio.min() > 0.999  # although errors of 0.1 % mix close modes
    assert estimate.mixed.any()
    assert "bus" in str(estimate)


def dynamic_stiffness(model_or_component, rows, omega):
    """(n_b, n_b) K - w^2 M condensed to the boundary."""
    k, m = (
        np.asarray(x.toarray() if hasattr(x, "toarray") else x) for x in (model_or_component.stiffness, model_or_component.mass)
    )
    z = k - omega**2 * m
    others = np.setdiff1d(np.arange(len(k)), rows)
    return z[np.ix_(rows, rows)] - z[np.ix_(rows, others)] @ la.solve(z[np.ix_(others, others)], z[np.ix_(others, rows)])


@pytest.mark.parametrize(("blocks", "order"), [(0, 4), (1, 8)])
def test_transfer_functions_converge_with_the_order_of_their_moments(blocks, order):
    """k blocks match the moments of w^2 up to 2 k: the error of the dynamic stiffness grows as w^(4 + 4 k)."""
    model = meshes.solid((6, 3, 3))
    boundary = corners(model)
    component = craig_bampton(model, boundary, n_modes=4, residual_vectors=blocks)
    rows = model.dofs.rows(component.boundary.pairs)
    omega = 2 * np.pi * np.array([60.0, 85.0, 120.0])
    error = [la.norm(dynamic_stiffness(component, np.arange(rows.size), w) - dynamic_stiffness(model, rows, w)) for w in omega]
    slopes = np.diff(np.log(error)) / np.diff(np.log(omega))
    np.testing.assert_allclose(slopes, order, atol=0.35)


def test_each_block_divides_the_error_of_the_frequencies():
    """By (w / w_c)^4 or more, until round-off: the estimate's own law, here measured on the full model."""
    model = meshes.solid((8, 4, 4))
    exact = lowest_hz(model.stiffness.toarray(), model.mass.toarray(), above=1.0)[:2]
    errors, ratio = [], []
    for blocks in (0, 1, 2):
        component = craig_bampton(model, corners(model), n_modes=12, residual_vectors=blocks)
        errors.append((lowest_hz(component.stiffness, component.mass, above=1.0)[:2] / exact - 1).max())
        ratio.append((exact[1] / component.report.complete_below_hz) ** 4)
    assert errors[1] < errors[0] * ratio[0]
    assert errors[2] < errors[1] * ratio[1]


def test_rubin_keeps_free_modes_and_statics_exact():
    model = meshes.solid((6, 3, 3))
    boundary = corners(model)
    component = rubin(model, boundary, n_modes=6)
    exact = fp.normal_modes(model)
    modes = fp.normal_modes(component)
    assert modes.n_rigid == exact.n_rigid == 6
    np.testing.assert_allclose(modes.frequency_hz[6:12], exact.frequency_hz[6:12], rtol=1e-9)
    assert component.n_modal == 12
    rows = model.dofs.rows(component.boundary.pairs)
    static, full = dynamic_stiffness(component, np.arange(12), 0.0), dynamic_stiffness(model, rows, 0.0)
    np.testing.assert_allclose(static, full, atol=1e-9 * abs(full).max())
    by_frequency = rubin(model, boundary, max_frequency_hz=float(exact.frequency_hz[11]) + 1.0)
    assert by_frequency.n_modal == component.n_modal


def test_requests_that_cannot_be_met():
    model = meshes.solid((4, 2, 2))
    boundary = corners(model)
    for options, words in (
        ({"accuracy": 1e-6}, "max_frequency_hz"),
        ({"accuracy": 1e-6, "max_frequency_hz": 100.0, "n_modes": 3}, "not n_modes"),
        ({"accuracy": 2.0, "max_frequency_hz": 100.0}, "between 0 and 1"),
        ({"max_frequency_hz": float("nan")}, "positive and finite"),
        ({"n_modes": 10_000}, "only"),
        ({"n_modes": 2.5}, "n_modes 2.5 .* must be whole numbers"),
        ({"n_modes": float("nan")}, "must be whole numbers"),
        ({"n_modes": True}, "must be whole numbers"),
        ({"size": 20}, "give max_frequency_hz or n_modes"),
        ({"size": 20, "max_frequency_hz": 100.0, "residual_vectors": 1}, "size chooses modes"),
        ({"size": 20, "max_frequency_hz": 100.0, "accuracy": 1e-3}, "give accuracy .* or size"),
        ({"size": 2.5, "max_frequency_hz": 100.0}, "size 2.5 must be a whole number"),
        ({"size": -1, "max_frequency_hz": 100.0}, "size -1 must be a whole number"),
        ({"size": 3, "max_frequency_hz": 20_000.0}, "size 3 is too small: .* modes up to 21000 Hz"),
        ({"accuracy": "x", "max_frequency_hz": 100.0}, "between 0 and 1, got 'x'"),
        ({"n_modes": 3, "residual_vectors": "2"}, "residual_vectors '2' must be whole numbers"),
        ({"max_frequency_hz": "100"}, "positive and finite, got '100'"),
    ):
        with pytest.raises(InputError, match=words) as caught:
            craig_bampton(model, boundary, **options)
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="reduces a FiniteElementModel, got str"):
        craig_bampton("bus.bdf", boundary, n_modes=3)
    with pytest.raises(SolverError, match="GB"):
        craig_bampton(model, boundary, n_modes=3, memory_limit=1e3)
    with pytest.raises(InputError, match="rubin"):
        rubin(model, boundary)


def test_promises_are_kept_without_rslab(monkeypatch):
    model = meshes.solid((6, 4, 4))
    fast = craig_bampton(model, corners(model), accuracy=1e-5, max_frequency_hz=2500)
    monkeypatch.setattr("flexplant.numerics.factorization.rslab_backend.available", lambda: False)
    slow = craig_bampton(model, corners(model), accuracy=1e-5, max_frequency_hz=2500)
    assert slow.report.verified == pytest.approx(fast.report.verified, rel=1e-3)
    np.testing.assert_allclose(slow.fixed_interface_hz, fast.fixed_interface_hz, rtol=1e-6)


def test_the_report_says_what_was_chosen():
    model = meshes.solid((6, 4, 4))
    text = str(craig_bampton(model, corners(model), accuracy=1e-5, max_frequency_hz=2500).report)
    assert "residual vectors drawn from" in text
    assert "(counted)" in text
    assert "asked 1.0e-05" in text
    assert "MB" in text
    assert "Rubin" in str(rubin(model, corners(model), n_modes=3).report)


def test_blocks_beyond_a_complete_basis_add_nothing():
    model = meshes.solid((3, 1, 1))
    boundary = corners(model)
    inside = len(model.dofs) - len(fp.DofSet.of(boundary))
    for n_modes in (inside // 2, inside):
        assert craig_bampton(model, boundary, n_modes=n_modes, residual_vectors=5).n_modal == inside
