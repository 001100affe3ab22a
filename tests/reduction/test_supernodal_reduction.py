"""Reductions whose interior is factored by the supernodal Cholesky, as large ones are, against those by rslab."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from reduction_models import lumped_beam, meshes, plate

import flexplant as fp
from flexplant.errors import SolverError
from flexplant.reduction.partition import Partition

pytest.importorskip("numba")

SOLID = meshes.solid((7, 5, 4))
HELD = meshes.held(SOLID, 24)


def chains(copies: int, length: int = 30) -> tuple[fp.FiniteElementModel, list[tuple[int, int]]]:
    """Equal chains, each held at one end: every mode comes `copies` times."""
    k = sp.diags_array([np.full(length, 2e4), np.full(length - 1, -1e4), np.full(length - 1, -1e4)], offsets=[0, 1, -1])
    stiffness = sp.csr_array(sp.block_diag([k] * copies))
    dofs = [(i + 1, 1) for i in range(copies * length)]
    model = fp.FiniteElementModel(name="chains", stiffness=stiffness, mass=sp.eye_array(copies * length), dofs=dofs)
    return model, [(c * length + 1, 1) for c in range(copies)]


def both(model, boundary, digits=1e-9, **options):
    """Reductions by both factors, equal to `digits`: machine epsilon times the condition of the interior."""
    made = [fp.craig_bampton(model, boundary, backend=b, **options) for b in ("supernodal", "rslab")]
    np.testing.assert_allclose(made[0].stiffness, made[1].stiffness, rtol=digits, atol=digits * abs(made[1].stiffness).max())
    n_b = made[0].n_boundary
    np.testing.assert_allclose(made[0].stiffness.diagonal()[n_b:], made[1].stiffness.diagonal()[n_b:], rtol=digits)
    np.testing.assert_allclose(made[0].mass[:n_b, :n_b], made[1].mass[:n_b, :n_b], rtol=0, atol=digits * abs(made[1].mass).max())
    return made


def test_the_factor_is_the_one_asked_for():
    part = Partition.of(SOLID, HELD, backend="supernodal")
    assert part.factor.backend == "supernodal"
    b = np.random.default_rng(0).standard_normal((part.i.size, 11))
    np.testing.assert_allclose(part.kii @ part.factor.solve(b), b, atol=1e-9 * abs(b).max())


@pytest.mark.parametrize(
    "options",
    [
        {"n_modes": 25, "verify_count": True},
        {"n_modes": 25, "verify_count": False},
        {"max_frequency_hz": 6000.0, "residual_vectors": 2},
        {"n_modes": 12, "loads": [(150, 3)]},
    ],
)
def test_modes_counts_and_residual_vectors_of_a_solid(options):
    ours, other = both(SOLID, HELD, **options)
    assert ours.report.proved == other.report.proved
    assert ours.report.n_modes == other.report.n_modes
    assert max(ours.report.residuals) < 1e-7


def test_a_plate_and_a_beam_with_massless_rotations():
    model = plate(8)
    both(model, [(1, "123456"), (9, "123456")], n_modes=20, verify_count=True)
    both(lumped_beam(150), [(1, "26")], digits=1e-6, n_modes=30, verify_count=True)


def test_a_mode_repeated_more_often_than_a_block_is_wide():
    model, boundary = chains(40)
    ours, _ = both(model, boundary, n_modes=45, verify_count=True)
    assert ours.report.proved
    values = ours.stiffness.diagonal()[40:]
    np.testing.assert_allclose(values[:40], values[0], rtol=1e-9)
    assert values[40] > 1.5 * values[0]


def test_mechanisms_and_indefinite_interiors_are_named():
    loose = SOLID.stiffness.tolil()
    rows = SOLID.dofs.rows([(200, 1)])
    loose[rows, :] = 0.0
    loose[:, rows] = 0.0
    with pytest.raises(SolverError, match="still moves without stiffness"):
        fp.craig_bampton(replace(SOLID, stiffness=sp.csr_array(loose)), HELD, n_modes=10, backend="supernodal")
    with pytest.raises(SolverError, match="still moves without stiffness"):
        fp.craig_bampton(SOLID, [(1, "123")], n_modes=10, backend="supernodal")
    buckled = sp.csr_array(SOLID.stiffness - 2e9 * sp.eye_array(len(SOLID.dofs)))
    with pytest.raises(SolverError, match="buckles"):
        fp.craig_bampton(replace(SOLID, stiffness=buckled), HELD, n_modes=10, backend="supernodal")


def test_too_little_memory_is_refused_before_the_work():
    with pytest.raises(SolverError, match="would need"):
        fp.craig_bampton(SOLID, HELD, n_modes=10, backend="supernodal", memory_limit=1e5)
