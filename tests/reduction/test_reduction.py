"""Reduction: exactness when nothing is truncated, the HCB form, statics, convergence from above, bad input."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import flexplant as fp
from flexplant.errors import InputError, ModelError, SolverError


def chain(n: int = 12, seed: int = 3) -> fp.FiniteElementModel:
    """A free chain of masses and springs along x, unequal on purpose."""
    rng = np.random.default_rng(seed)
    k = rng.uniform(1e4, 3e4, n - 1)
    stiffness = np.zeros((n, n))
    for i, value in enumerate(k):
        stiffness[i : i + 2, i : i + 2] += value * np.array([[1, -1], [-1, 1]])
    return fp.FiniteElementModel(
        name="chain",
        mass=np.diag(rng.uniform(0.5, 2, n)),
        stiffness=stiffness,
        dofs=[(i + 1, 1) for i in range(n)],
        nodes=fp.Nodes(np.arange(1, n + 1), np.c_[np.arange(n), np.zeros((n, 2))]),
    )


def beam(n_elements: int = 30) -> fp.FiniteElementModel:
    """A free plane Euler-Bernoulli beam, DOF 2 and 6, consistent mass."""
    h, ei, ra = 1.0 / n_elements, 100.0, 2.0
    ke = ei / h**3 * np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h]] * 2)
    ke[2] = -ke[0]
    ke[3] = ei / h**3 * np.array([6 * h, 2 * h * h, -6 * h, 4 * h * h])
    a, b = 22 * h, 13 * h
    rows = [[156, a, 54, -b], [a, 4 * h * h, b, -3 * h * h], [54, b, 156, -a], [-b, -3 * h * h, -a, 4 * h * h]]
    me = ra * h / 420 * np.array(rows)
    n = 2 * (n_elements + 1)
    k, m = np.zeros((n, n)), np.zeros((n, n))
    for e in range(n_elements):
        at = slice(2 * e, 2 * e + 4)
        k[at, at] += ke
        m[at, at] += me
    nodes = fp.Nodes(np.arange(1, n_elements + 2), np.c_[np.linspace(0, 1, n_elements + 1), np.zeros((n_elements + 1, 2))])
    dofs = [(i, d) for i in range(1, n_elements + 2) for d in (2, 6)]
    return fp.FiniteElementModel(name="beam", mass=sp.csr_array(m), stiffness=sp.csr_array(k), dofs=dofs, nodes=nodes)


def elastic_hz(model) -> np.ndarray:
    modes = fp.normal_modes(model)
    return modes.frequency_hz[modes.n_rigid :]


def test_all_modes_kept_is_the_full_model():
    model = beam(8)
    component = fp.craig_bampton(model, [(1, "26"), (9, "26")], n_modes=14)
    assert component.n == len(model.dofs)
    np.testing.assert_allclose(elastic_hz(component), elastic_hz(model), rtol=1e-9)


def test_the_smallest_models_keep_all_their_modes():
    for n in (2, 3, 4, 6, 11, 21):
        model = chain(n)
        component = fp.craig_bampton(model, [(n // 2 + 1, 1)], n_modes=n - 1)
        assert component.report.proved
        np.testing.assert_allclose(elastic_hz(component), elastic_hz(model), rtol=1e-9)


@pytest.mark.parametrize("small", [0, 3000])
def test_parts_of_the_matrices_follow_the_order_of_the_boundary(monkeypatch, small):
    from flexplant.reduction import partition

    monkeypatch.setattr(partition, "SMALL", small)
    model, boundary = beam(), [(31, 6), (1, 2), (16, 2), (1, 6)]
    part = partition.Partition.of(model, boundary)
    b = model.dofs.rows(boundary)
    i = np.setdiff1d(np.arange(62), b)
    for whole, parts in ((model.stiffness, part.stiffness), (model.mass, part.mass)):
        full = whole.toarray()
        for mine, rows, columns in zip(parts, (i, i, b), (i, b, b), strict=True):
            np.testing.assert_array_equal(mine.toarray() if sp.issparse(mine) else mine, full[np.ix_(rows, columns)])
    assert not (part.kii.data == 0).any()


def test_standard_form_and_free_motion():
    component = fp.craig_bampton(beam(), [(1, "26"), (31, "26")], n_modes=5, residual_vectors=2)
    n_b = component.n_boundary
    assert component.n_modal == 5 + 2 * n_b
    assert not component.stiffness[:n_b, n_b:].any()
    np.testing.assert_array_equal(component.mass[n_b:, n_b:], np.eye(component.n_modal))
    kqq = component.stiffness[n_b:, n_b:]
    np.testing.assert_array_equal(kqq, np.diag(np.diagonal(kqq)))
    assert fp.normal_modes(component).n_rigid == 2
    assert fp.mass_properties(fp.guyan(chain(), [(1, 1), (12, 1)])).mass * 3 == pytest.approx(np.trace(chain().mass), rel=1e-12)


def test_static_condensation_keeps_the_interface_flexibility():
    model = beam()
    held = [(1, "26"), (31, "26")]
    load = np.array([1.0, -0.3])
    component = fp.guyan(model, held)
    grounded = np.linalg.solve(component.stiffness[2:, 2:], load)
    full = np.linalg.solve(model.stiffness.toarray()[2:, 2:], np.r_[np.zeros(58), load])
    np.testing.assert_allclose(grounded, full[-2:], rtol=1e-8)


def test_frequencies_converge_from_above():
    model = beam()
    exact = elastic_hz(model)[:6]
    errors = []
    for n_modes in (6, 10, 14):
        hz = elastic_hz(fp.craig_bampton(model, [(1, "26"), (31, "26")], n_modes=n_modes))[:6]
        errors.append(hz / exact - 1)
        assert (errors[-1] > -1e-9).all()
    assert errors[0].max() > errors[1].max() > errors[2].max()


def test_ritz_vectors_beat_modes_of_the_same_number():
    model = beam()
    held = [(1, "26"), (31, "26")]
    exact = elastic_hz(model)[:5]
    ritz = fp.craig_bampton(model, held, n_modes=6, residual_vectors=2)
    classic = fp.craig_bampton(model, held, n_modes=ritz.n_modal)
    error = {name: abs(elastic_hz(c)[:5] / exact - 1).max() for name, c in (("ritz", ritz), ("classic", classic))}
    assert error["ritz"] < error["classic"] / 50


def test_singular_mass_is_reduced():
    model = beam()
    lumped = np.diag(np.tile([1.0, 0.0], 31))
    massless = fp.FiniteElementModel(name="lumped", mass=lumped, stiffness=model.stiffness, dofs=model.dofs, nodes=model.nodes)
    component = fp.craig_bampton(massless, [(1, "26"), (31, "26")], max_frequency_hz=1e9)
    assert component.n_modal == 29
    np.testing.assert_allclose(elastic_hz(component)[:10], elastic_hz(massless)[:10], rtol=1e-7)


def test_recovery_expands_the_interior():
    model = beam(8)
    component = fp.craig_bampton(model, [(1, "26"), (9, "26")], n_modes=14, recover=[(5, "26")])
    modes = fp.normal_modes(component)
    full = fp.normal_modes(model)
    shape = component.recovery["displacement"].displacement @ modes.shapes[:, 2:8]
    rows = model.dofs.rows([(5, 2), (5, 6)])
    np.testing.assert_allclose(abs(shape), abs(full.shapes[rows, 2:8]), rtol=1e-6, atol=1e-8)


def test_physical_damping_is_projected_and_ratios_replace_it():
    model = beam(8)
    damped = fp.FiniteElementModel(
        name="beam",
        mass=model.mass,
        stiffness=model.stiffness,
        damping=1e-4 * model.stiffness,
        dofs=model.dofs,
        nodes=model.nodes,
    )
    component = fp.craig_bampton(damped, [(1, "26"), (9, "26")], n_modes=4)
    np.testing.assert_allclose(component.damping, 1e-4 * component.stiffness, atol=1e-9 * abs(component.stiffness).max())
    ratios = fp.craig_bampton(damped, [(1, "26"), (9, "26")], n_modes=4, damping_ratio=0.01)
    expected = 2 * 0.01 * 2 * np.pi * component.fixed_interface_hz
    np.testing.assert_allclose(np.diagonal(ratios.damping)[4:], expected, rtol=1e-12)
    assert not ratios.damping[:4].any()


@pytest.mark.parametrize(
    ("boundary", "options", "error", "words"),
    [
        ([(99, 1)], {"n_modes": 2}, ModelError, "99"),
        ([(1, 1), (1, 1)], {"n_modes": 2}, ModelError, "twice"),
        ([], {"n_modes": 2}, ModelError, "empty"),
        ([(1, 1)], {"n_modes": 50}, InputError, "50 modes"),
        ([(1, 1)], {}, InputError, "max_frequency_hz"),
        ([(1, 1)], {"n_modes": 2, "residual_vectors": -1}, InputError, "negative"),
        ([(1, 2)], {"n_modes": 2}, ModelError, "1-2"),
    ],
)
def test_bad_requests_are_one_clear_line(boundary, options, error, words):
    with pytest.raises(error, match=words) as caught:
        fp.craig_bampton(chain(), boundary, **options)
    assert "\n" not in str(caught.value)


def test_a_mechanism_inside_is_named():
    k = la.block_diag(np.array([[1.0, -1], [-1, 1]]), np.array([[1.0, -1], [-1, 1]]))
    loose = fp.FiniteElementModel(name="loose", mass=np.eye(4), stiffness=1e6 * k, dofs=[(i, 1) for i in (1, 2, 3, 4)])
    with pytest.raises(SolverError, match=r"loose.*(3-1|4-1)"):
        fp.craig_bampton(loose, [(1, 1)], n_modes=1)


@pytest.mark.parametrize("options", [{"n_modes": 0}, {"max_frequency_hz": 100.0}, {"accuracy": 1e-6, "max_frequency_hz": 100.0}])
def test_a_boundary_of_all_dof_is_the_model_itself(options):
    model = chain(4)
    component = fp.craig_bampton(model, [(i, 1) for i in (1, 2, 3, 4)], recover=[(2, 1)], keep_basis=True, **options)
    assert component.n_modal == 0
    np.testing.assert_array_equal(component.mass, model.mass)
    np.testing.assert_array_equal(component.stiffness, model.stiffness)
    np.testing.assert_array_equal(component.basis, np.eye(4))
    np.testing.assert_array_equal(component.recovery["displacement"].displacement, [[0, 1, 0, 0]])


def test_matrices_that_are_no_numbers_or_not_symmetric():
    stiffness = chain().stiffness.copy()
    for entry, words in ((np.nan, "not finite"), (1e6, "not symmetric")):
        wrong = stiffness.copy()
        wrong[2, 5] = entry
        with pytest.raises(ModelError, match=words):
            fp.FiniteElementModel(name="x", mass=np.eye(12), stiffness=wrong, dofs=[(i + 1, 1) for i in range(12)])
