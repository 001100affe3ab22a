"""Dampers inside a model get residual vectors of their own, so that their motion is that of the unreduced model."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from reduction_models import meshes

import flexplant as fp

MODEL = fp.with_dampers(meshes.solid((5, 3, 3)), [((40, 1), (77, 1), 3e4), ((58, 3), None, 1e4)])
BOUNDARY = [(1, "123"), (4, "123"), (13, "123"), (16, "123")]


def receptance(model, hz):
    """At the boundary, by direct solution of the free model."""
    rows = MODEL.dofs.rows(fp.DofSet.of(BOUNDARY).pairs) if isinstance(model, fp.FiniteElementModel) else np.arange(12)
    k, z, m = (np.asarray(sp.csr_array(a).toarray()) for a in (model.stiffness, model.damping, model.mass))
    w = 2 * np.pi * hz
    return np.linalg.inv(k + 1j * w * z - w**2 * m)[np.ix_(rows, rows)]


@pytest.mark.parametrize(("blocks", "below", "at_resonance"), [(0, 1e-7, 1e-2), (1, 1e-7, 1e-2), (2, 1e-11, 1e-5)])
def test_the_damped_response_converges_to_that_of_the_unreduced_model(blocks, below, at_resonance):
    """Without vectors of their own, dampers leave 2e-4 below the first mode and 2e-2 at it, whatever the boundary gets."""
    component = fp.craig_bampton(MODEL, BOUNDARY, n_modes=30, residual_vectors=blocks)
    first = fp.normal_modes(MODEL, n_modes=8).frequency_hz[6]
    for hz, limit in ((0.5 * first, below), (first, at_resonance)):
        exact, found = receptance(MODEL, hz), receptance(component, hz)
        assert abs(found - exact).max() < limit * abs(exact).max()


@pytest.mark.parametrize("cells", [(5, 3, 3), (1, 3, 3)])
def test_spread_damping_needs_no_vectors(cells):
    model = fp.with_proportional_damping(meshes.solid(cells), stiffness_factor=1e-6)
    assert fp.craig_bampton(model, BOUNDARY, n_modes=20).n_modal == 20


def test_dampers_that_ratios_replace_need_no_vectors():
    assert fp.craig_bampton(MODEL, BOUNDARY, n_modes=20, damping_ratio=0.01).n_modal == 20
