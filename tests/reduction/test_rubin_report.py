"""What Rubin's report says of its free modes, against the whole model's matrices and a dense solution."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
from reduction_models import corners, plate

import flexplant as fp

MODEL = plate(6)


@pytest.mark.parametrize("request_", [{"n_modes": 9}, {"max_frequency_hz": 200.0}])
def test_residuals_are_those_of_the_free_model(request_):
    """From the component's own expanded shapes, which no part of the eigensolver has touched."""
    component = fp.rubin(MODEL, corners(MODEL), keep_basis=True, **request_)
    report = component.report
    assert len(report.residuals) == report.n_modes > 3
    assert 0 < max(report.residuals) < 1e-6
    modes = fp.normal_modes(component)
    elastic = slice(modes.n_rigid, modes.n_rigid + report.n_modes)
    x = fp.expand(component, modes.shapes[:, elastic])
    force = MODEL.stiffness @ x
    rest = np.linalg.norm(force - MODEL.mass @ x * modes.omega[elastic] ** 2, axis=0) / np.linalg.norm(force, axis=0)
    assert max(rest) < 10 * max(report.residuals) + 1e-8
    k, m = MODEL.stiffness.toarray(), MODEL.mass.toarray()
    np.testing.assert_allclose(modes.omega[elastic] ** 2, la.eigvalsh(k, m)[6 : 6 + report.n_modes], rtol=1e-8)


def test_no_modes_have_no_residuals():
    assert fp.rubin(MODEL, corners(MODEL), n_modes=0).report.residuals == ()


def test_the_sentence_names_the_worst():
    report = fp.rubin(MODEL, corners(MODEL), n_modes=4).report
    assert f"residuals at most {max(report.residuals):.0e}" in str(report)


def test_a_shape_that_is_none_shows_in_its_residual(monkeypatch):
    """Modes spoilt by 1 % of a higher one: the report must say so, whatever the solver thinks of its convergence."""
    module = importlib.import_module("flexplant.reduction.rubin")
    whole = module.lanczos

    def spoilt(*args, **options):
        found = whole(*args, **options)
        return replace(found, vectors=found.vectors + 0.01 * found.vectors[:, ::-1])

    monkeypatch.setattr(module, "lanczos", spoilt)
    report = fp.rubin(MODEL, corners(MODEL), n_modes=6).report
    assert max(report.residuals) > 1e-3


@pytest.mark.parametrize("request_", [{"n_modes": 3}, {"max_frequency_hz": 100.0}])
def test_without_interior_the_component_is_the_model(request_, capfd):
    model = plate(2)
    component = fp.rubin(model, model.dofs, **request_)
    assert component.n_modal == 0
    assert component.report.complete_below_hz == np.inf
    np.testing.assert_array_equal(component.mass, model.mass.toarray())
    np.testing.assert_array_equal(component.stiffness, model.stiffness.toarray())
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("reduce", [fp.craig_bampton, fp.rubin])
def test_of_a_number_and_a_frequency_the_fewer_modes_are_taken_and_said(reduce):
    top = 1.001 * float(fp.normal_modes(MODEL, n_modes=30).frequency_hz[-1])
    few, all_of_them = (reduce(MODEL, corners(MODEL), n_modes=n, max_frequency_hz=top) for n in (3, 60))
    assert few.report.n_modes == 3 < all_of_them.report.n_modes < 60
    assert few.report.complete_below_hz < top
    assert f"short of the {top:g} Hz asked" in str(few.report)
    assert "short of" not in str(all_of_them.report) + str(reduce(MODEL, corners(MODEL), n_modes=3).report)


def test_a_reduced_component_describes_itself_without_matrices():
    text = repr(fp.craig_bampton(MODEL, corners(MODEL), n_modes=4, keep_basis=True))
    assert text.startswith("ReducedComponent ")
    assert "boundary DOF, 4 modal\n" in text
    assert "  reduction       Hurty/Craig-Bampton: 4 modes + 0 residual vectors" in text
    assert "  basis           kept\n" in text
    assert "array(" not in text
    assert len(text.splitlines()) < 12
