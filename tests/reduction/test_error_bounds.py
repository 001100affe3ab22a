"""The estimated error lies above the true one: close modes, crossing modes, Rubin's basis."""

from __future__ import annotations

import numpy as np
import pytest
from reduction_models import BUS, FEET, OPTIC, corners, meshes, shocksat

import flexplant as fp
from flexplant.errors import InputError

N = 14


def held_chain(name: str, stiffness: float) -> fp.FiniteElementModel:
    """N unit masses; the first, on a spring to the ground, is the boundary."""
    k = 2 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1)
    k[-1, -1] = 1.0
    return fp.FiniteElementModel(name=name, mass=np.eye(N), stiffness=stiffness * k, dofs=[(i + 1, 1) for i in range(N)])


def pair(detuning: float, spring: float, n_modes: int = 2):
    """A coarsely reduced chain and an exact one beside it, a spring between their boundaries; system and full frequencies.

    detuning: where between the reduced and the true second frequency of the first the second chain has its own.
    """
    a = held_chain("a", 1e4)
    coarse = fp.craig_bampton(a, [(1, 1)], n_modes=n_modes)
    true, high = (fp.normal_modes(m).frequency_hz[1] for m in (a, coarse))
    b = held_chain("b", 1e4 * ((true + detuning * (high - true)) / true) ** 2)
    exact = fp.craig_bampton(b, [(1, 1)], n_modes=N - 1)
    joints = [fp.Connection("a", "b", pairs=[(1, 1)], directions="1", stiffness=np.array([[spring]]))] if spring else []
    k = np.zeros((2 * N, 2 * N))
    k[:N, :N], k[N:, N:] = a.stiffness, b.stiffness
    k[np.ix_([0, N], [0, N])] += spring * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return fp.couple([coarse, exact], joints), np.sqrt(np.linalg.eigvalsh(k)) / (2 * np.pi)


@pytest.mark.parametrize("spring", [0.0, 1.0, 30.0, 1000.0])
@pytest.mark.parametrize("detuning", [0.0, 0.3, 0.5, 0.9, 1.0, 1.1])
def test_nearly_repeated_pairs_are_bounded(detuning, spring):
    system, full = pair(detuning, spring)
    estimate = fp.estimate_error(system)
    error = estimate.frequency_hz / full[: estimate.frequency_hz.size] - 1
    known = np.isfinite(estimate.total) & (error > 1e-9)
    assert known[:4].any()
    assert (estimate.total >= error * (1 - 1e-6) - 1e-12).all()
    assert estimate.total[3] < 3 * error[2:4].max()


def test_a_mode_that_another_one_crosses_is_flagged():
    """The exact chain's mode is third by number only because the coarse chain's is too high: it is the fourth in truth."""
    system, full = pair(0.5, 0.0)
    estimate = fp.estimate_error(system)
    error = estimate.frequency_hz / full[: estimate.frequency_hz.size] - 1
    own = estimate.by_component[2]
    assert error[2] > 1e-5
    assert estimate.mixed[2]
    assert own.sum() >= error[2]
    assert "mixed" in str(estimate)
    assert not fp.estimate_error(pair(-5.0, 0.0)[0]).mixed[:4].any()


@pytest.mark.parametrize("n_modes", [4, 8, 20])
@pytest.mark.parametrize("loads", [(), [(40, 1)]])
def test_rubin_is_estimated_too(n_modes, loads):
    """Grounded through soft springs at the boundary, so that no mode of the system is one of the free modes."""
    model = meshes.solid((6, 3, 3))
    boundary = corners(model)
    component = fp.rubin(model, boundary, n_modes=n_modes, loads=loads)
    rows = model.dofs.rows(component.boundary.pairs)
    spring = 1e-2 * abs(model.stiffness.diagonal()).max()
    nodes = sorted(set(component.boundary.node.tolist()))
    ground = fp.Connection("solid", "ground", pairs=nodes, directions="123", stiffness=spring * np.eye(3))
    estimate = fp.estimate_error(fp.couple([component], [ground]))
    k = model.stiffness.toarray()
    k[rows, rows] += spring
    full = fp.FiniteElementModel(name="held", mass=model.mass, stiffness=k, dofs=model.dofs)
    inside = estimate.frequency_hz < component.report.complete_below_hz
    exact = fp.normal_modes(full, n_modes=60).frequency_hz
    known = np.flatnonzero(inside)
    error = estimate.frequency_hz[known] / exact[known] - 1
    assert error.max() > 1e-7
    assert (estimate.total[known] >= error * (1 - 1e-6) - 1e-10).all()
    assert np.isinf(estimate.total[~inside]).all()
    assert "all free modes below" in str(component.report)


def test_rubin_rows_are_the_residual_of_the_unreduced_interior():
    model = meshes.solid((6, 3, 3))
    component = fp.rubin(model, corners(model), n_modes=8, loads=[(40, 1)], keep_basis=True)
    rows = model.dofs.rows(component.boundary.pairs)
    inside = np.setdiff1d(np.arange(len(model.dofs)), rows)
    k, m, n_b = model.stiffness.toarray(), model.mass.toarray(), component.n_boundary
    w2 = (2 * np.pi * 0.7 * component.report.complete_below_hz) ** 2
    b = np.random.default_rng(0).standard_normal((n_b, 3))
    gap = np.diagonal(component.stiffness)[n_b:] - w2
    p = np.vstack([b, w2 * (component.mass[n_b:, :n_b] @ b) / gap[:, None]])
    residual = ((k - w2 * m) @ (component.basis @ p))[inside]
    energy = np.einsum("ij,ij->j", residual, np.linalg.solve(k[np.ix_(inside, inside)], residual))
    np.testing.assert_allclose(np.sum((w2 * component.error_rows @ p) ** 2, axis=0), energy, rtol=1e-5)


def test_guyan_says_why_not():
    model = meshes.solid((3, 1, 1))
    with pytest.raises(InputError, match="not by guyan"):
        fp.estimate_error(fp.couple([fp.guyan(model, corners(model))]))


@pytest.mark.parametrize(
    "reduce",
    [lambda m, b: fp.craig_bampton(m, b, n_modes=160), lambda m, b: fp.rubin(m, b, n_modes=100)],
    ids=["classic", "Rubin"],
)
def test_every_mode_of_the_shocksat_like_structure_is_bounded(reduce):
    bus, optic, whole = (shocksat(name) for name in ("bus", "optic", "whole"))
    parts = [
        reduce(bus, [(n, "123456") for n in BUS]),
        fp.craig_bampton(optic, [(n, "123456") for n in OPTIC], size=70, max_frequency_hz=300),
    ]
    system = fp.couple(parts, [fp.Connection("bus", "optic", pairs=[(f, f) for f in FEET], directions="123456")])
    exact = fp.normal_modes(whole, max_frequency_hz=300)
    truth = exact.frequency_hz[exact.n_rigid :]
    estimate = fp.estimate_error(system)
    error = estimate.frequency_hz[: truth.size] / truth - 1
    ratio = estimate.total[: truth.size][error > 1e-8] / error[error > 1e-8]
    assert ratio.min() > 1.0
    assert np.median(ratio) < 1.4
