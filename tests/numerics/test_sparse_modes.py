"""The sparse route of normal modes on a beam of 320 nodes: massless, nearly massless and indefinite mass, rounded files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from structures import elastic_hz, frame_model

from flexplant.errors import SolverError
from flexplant.model.geometry import Nodes
from flexplant.modes import normal_modes

N = 320
LINE = {i: np.array([0.05 * i, 0.3 * np.sin(0.2 * i), 0.2 * np.cos(0.13 * i)]) for i in range(N)}
DENSE = frame_model("beam", LINE, [(i, i + 1) for i in range(N - 1)])
BEAM = replace(DENSE, mass=sp.csr_array(DENSE.mass), stiffness=sp.csr_array(DENSE.stiffness))
ROTATION = np.array([d > 3 for _, d in DENSE.dofs.pairs])
REFERENCE_ACCURACY = 1e-6  # of LAPACK's lowest modes here: machine epsilon times (highest over lowest frequency)^2


@pytest.fixture(scope="module")
def lumped_hz():
    """Massless rotations condensed by hand."""
    k, heavy, light = DENSE.stiffness, np.flatnonzero(~ROTATION), np.flatnonzero(ROTATION)
    condensed = k[np.ix_(heavy, heavy)] - k[np.ix_(heavy, light)] @ la.solve(k[np.ix_(light, light)], k[np.ix_(light, heavy)])
    return elastic_hz(0.1 * np.eye(heavy.size), 0.5 * (condensed + condensed.T), 6)[:10]


@pytest.fixture(scope="module")
def consistent_hz():
    return elastic_hz(DENSE.mass, DENSE.stiffness, 6)[:10]


@pytest.mark.parametrize("positions", ["exact", "rounded", "unknown"])
def test_six_exact_zeros_and_the_same_elastic_modes(positions, consistent_hz):
    """A file's five decimals leave rigid motion a little energy; no positions leave it to the null space."""
    nodes = {"exact": BEAM.nodes, "rounded": Nodes(BEAM.nodes.ids, np.round(BEAM.nodes.positions, 5)), "unknown": None}
    modes = normal_modes(replace(BEAM, nodes=nodes[positions]), n_modes=16)
    assert modes.n_rigid == 6
    np.testing.assert_array_equal(modes.frequency_hz[:6], 0.0)
    np.testing.assert_allclose(modes.frequency_hz[6:], consistent_hz, rtol=REFERENCE_ACCURACY)
    assert modes.residuals.max() < 1e-9


@pytest.mark.parametrize("inertia", [0.0, 1e-12])
def test_massless_and_nearly_massless_rotations(inertia, lumped_hz):
    mass = sp.csr_array(sp.diags_array(np.where(ROTATION, inertia, 0.1)))
    modes = normal_modes(replace(BEAM, mass=mass), n_modes=16)
    assert modes.n_rigid == 6
    np.testing.assert_allclose(modes.frequency_hz[6:], lumped_hz, rtol=REFERENCE_ACCURACY)


def test_an_indefinite_mass_is_refused():
    values = np.where(ROTATION, 0.0, 0.1)
    values[6 * 100 + 1] = -0.5
    with pytest.raises(SolverError, match=r"indefinite \(1 negative"):
        normal_modes(replace(BEAM, mass=sp.csr_array(sp.diags_array(values))), n_modes=16)


def test_a_spring_to_ground_is_not_rounding():
    spring = sp.csr_array(([1e3], ([0], [0])), shape=BEAM.stiffness.shape)
    modes = normal_modes(replace(BEAM, stiffness=BEAM.stiffness + spring), n_modes=8)
    assert modes.n_rigid == 5
    assert 0 < modes.frequency_hz[5] < 3


def test_a_limit_and_a_count_agree(consistent_hz):
    limit = 0.5 * (consistent_hz[4] + consistent_hz[5])
    by_limit = normal_modes(BEAM, max_frequency_hz=float(limit))
    by_count = normal_modes(BEAM, n_modes=11)
    assert len(by_limit) == 11
    np.testing.assert_allclose(by_limit.frequency_hz, by_count.frequency_hz, rtol=1e-9)
