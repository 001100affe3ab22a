"""A large interface in few shared coordinates: exact when whole, converging when not, statics exact, frames included."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

import flexplant as fp
from flexplant.errors import InputError

spec = importlib.util.spec_from_file_location("interface_meshes", Path(__file__).parents[2] / "benchmarks" / "meshes.py")
meshes = importlib.util.module_from_spec(spec)
spec.loader.exec_module(meshes)
CELLS = (4, 3, 3)
HZ = np.array([200.0, 900.0, 1700.0])


def blocks():
    """Two blocks end to end: face x = 1 of the left one meets face x = 0 of the right one, 16 nodes."""
    left, right = meshes.solid(CELLS), meshes.solid(CELLS)
    x = left.nodes.positions[:, 0]
    ends = {name: left.nodes.ids[abs(x - at) < 1e-9] for name, at in (("low", 0.0), ("high", 1.0))}
    return left, right, ends


def renamed(model, name):
    return fp.FiniteElementModel(name=name, mass=model.mass, stiffness=model.stiffness, dofs=model.dofs, nodes=model.nodes)


def joined(method="dual", turned=False, damped=False):
    left, right, ends = blocks()
    tips = {"left": int(ends["low"][0]), "right": int(ends["high"][-1])}
    options = {"structural_damping": 0.02} if damped else {}
    parts = [
        fp.craig_bampton(renamed(model, name), [(int(n), "123") for n in nodes] + [(tips[name], "123")], n_modes=12,
                         recover=[(20, 2)], loads=[(21, 3)], **options)
        for model, name, nodes in ((left, "left", ends["high"]), (right, "right", ends["low"]))
    ]  # fmt: skip
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) if turned else np.eye(3)
    placements = {
        "left": fp.Placement(rotation=turn, translation=np.zeros(3)),
        "right": fp.Placement(rotation=turn, translation=turn @ [1.0, 0, 0]),
    }
    pairs = [(int(a), int(b)) for a, b in zip(ends["high"], ends["low"], strict=True)]
    joint = fp.Connection("left", "right", pairs=pairs, directions="123", name="joint", frame="system")
    return fp.couple(parts, [joint], method=method, placements=placements), tips


def elastic(system, count=20):
    modes = fp.normal_modes(system)
    assert modes.n_rigid == 6
    return modes.frequency_hz[6 : 6 + count]


@pytest.mark.parametrize("method", ["dual", "primal"])
@pytest.mark.parametrize("turned", [False, True])
def test_all_interface_modes_change_coordinates_only(method, turned):
    system, tips = joined(method, turned)
    whole = fp.characteristic_interface(system, "joint", n_modes=48)
    assert [c.n_boundary for c in whole.components] == [51, 51]
    np.testing.assert_allclose(elastic(whole), elastic(system), rtol=1e-8)
    ours, before = (fp.mass_properties(s) for s in (whole, system))
    assert ours.mass == pytest.approx(before.mass, rel=1e-9)
    np.testing.assert_allclose(ours.center_of_gravity, before.center_of_gravity, atol=1e-9)
    assert fp.verify(whole).passed
    names = {
        "inputs": [f"left.{tips['left']}.1", "left.21.3"],
        "outputs": [f"right.{tips['right']}.2", "right.displacement.20.2", "right.21.3:a"],
    }
    ours, before = (fp.frequency_response(fp.modal_plant(s, **names, damping_ratio=0.01), HZ).values for s in (whole, system))
    np.testing.assert_allclose(ours, before, rtol=1e-6, atol=1e-8 * abs(before).max())


def test_few_modes_converge_from_above():
    system, _ = joined()
    exact = elastic(system, 10)
    errors = []
    for n_modes in (6, 12, 20, 30):
        small = fp.characteristic_interface(system, "joint", n_modes=n_modes)
        first, second = small.components
        assert first.n_boundary == second.n_boundary == 3 + n_modes + 6  # tips, modes, static shapes of two tips
        assert small.basis.shape[1] == system.basis.shape[1] - 48 + n_modes + 6
        error = elastic(small, 10) / exact - 1
        assert error.min() > -1e-8
        errors.append(error.max())
    assert (np.diff(errors) < 0).all()
    assert errors[0] < 0.05
    assert errors[-1] < 1e-3


def test_the_coupled_limit_is_the_unreduced_whole():
    """Against the free block of both: the interface's truncation adds less than the fixed-interface modes already cost."""
    _, _, ends = blocks()
    left, right, _ = blocks()
    n = len(left.dofs)
    here, there = (m.dofs.rows([(int(i), d) for i in ends[e] for d in (1, 2, 3)]) for m, e in ((left, "high"), (right, "low")))
    rows = np.arange(n, 2 * n)
    rows[there] = here
    others = np.setdiff1d(np.arange(n), there)
    rows[others] = n + np.arange(others.size)
    place = sp.csr_array((np.ones(2 * n), (np.arange(2 * n), np.r_[np.arange(n), rows])))
    k, m = (place.T @ sp.block_diag([x, x]) @ place for x in (left.stiffness, left.mass))
    full = fp.FiniteElementModel(name="whole", stiffness=k, mass=m, dofs=[(i + 1, 0) for i in range(k.shape[0])])
    elastic_hz = fp.normal_modes(full).frequency_hz[6:]
    exact = elastic_hz[:6]
    system, _ = joined()
    before = elastic(system, 6) / exact - 1
    after = elastic(fp.characteristic_interface(system, "joint", n_modes=30), 6) / exact - 1
    assert before.min() > -1e-8
    assert after.max() < 1.5 * before.max() + 1e-5
    small = fp.characteristic_interface(system, "joint", n_modes=12)
    estimate = fp.estimate_error(small, n_modes=16)
    vouched = np.isfinite(estimate.total)
    true = estimate.frequency_hz / elastic_hz[: vouched.size] - 1
    assert (estimate.total >= true * (1 - 1e-6))[vouched].all()
    assert vouched.sum() >= 6
    assert np.median((estimate.total / true)[vouched]) < 5
    assert small.components[0].report.interface_dofs == 48


def test_statics_are_exact_with_few_modes():
    """Both tips held but one direction: its flexibility passes through the interface, whatever the modes."""
    system, tips = joined()
    small = fp.characteristic_interface(system, "joint", n_modes=6)
    answers = []
    for s in (system, small):
        k = s.basis.T @ s.uncoupled_stiffness @ s.basis
        held = np.vstack([s.dof_row("left", tips["left"], d).toarray() for d in (1, 2, 3)])
        held = np.vstack([held, [s.dof_row("right", tips["right"], d).toarray()[0] for d in (2, 3)]]) @ s.basis
        free = np.linalg.svd(held)[2][5:].T
        force = free.T @ (s.basis.T @ s.dof_row("right", tips["right"], 1).toarray()[0])
        motion = free @ np.linalg.lstsq(free.T @ k @ free, force, rcond=1e-12)[0]
        answers.append((s.dof_row("right", tips["right"], 1) @ s.basis @ motion).item())
    assert answers[1] == pytest.approx(answers[0], rel=1e-7)


def test_structural_damping_comes_along():
    system, tips = joined(damped=True)
    names = {"inputs": [f"left.{tips['left']}.1"], "outputs": [f"right.{tips['right']}.1"], "frequency_hz": HZ}
    whole = fp.characteristic_interface(system, "joint", n_modes=48)
    ours, before = (fp.structural_frequency_response(s, **names).values for s in (whole, system))
    np.testing.assert_allclose(ours, before, rtol=1e-6)


def test_without_positions_all_coordinates_are_scalar():
    system, _ = joined()
    bare = fp.couple([replace(c, nodes=None) for c in system.components], [
        fp.Connection("left", "right", pairs=system.connections[0].pairs, directions="123", name="joint")
    ])  # fmt: skip
    whole = fp.characteristic_interface(bare, "joint", n_modes=48)
    assert all(d == 0 for _, d in whole.components[0].boundary.pairs[3:])
    ours, before = (fp.normal_modes(s).frequency_hz for s in (whole, system))
    np.testing.assert_allclose(ours[6:26], before[6:26], rtol=1e-8)


def test_by_frequency_and_what_is_refused():
    system, _ = joined()
    by_number = fp.characteristic_interface(system, "joint", n_modes=12)
    assert fp.characteristic_interface(system, "joint", max_frequency_hz=1e9).components[0].n_boundary == 51
    assert by_number.components[0].n_boundary < 51
    left, right = system.components
    pairs = [tuple(p) for p in system.connections[0].pairs]
    soft = fp.couple(
        [left, right], [fp.Connection("left", "right", pairs=pairs, directions="123", offset="ignore", stiffness=1e9)]
    )
    twice = fp.couple(
        [left, right],
        [
            fp.Connection("left", "right", pairs=pairs[:-1], directions="123", offset="ignore", name="joint"),
            fp.Connection("left", "ground", pairs=[pairs[0][0]], directions="1", name="wall"),
        ],
    )
    for given, name, options, words in (
        (left, "joint", {"n_modes": 6}, "takes a coupled System, got ReducedComponent"),
        (system, 5, {"n_modes": 6}, "there is no connection 5"),
        (system, "joint", {}, "give n_modes or max_frequency_hz"),
        (system, "joint", {"n_modes": 3, "max_frequency_hz": 10.0}, "give n_modes or max_frequency_hz"),
        (system, "joint", {"n_modes": 2.5}, "positive whole number, got 2.5"),
        (system, "joint", {"n_modes": 99}, "99 modes of 'joint' asked; its 48 DOF have 48"),
        (system, "joint", {"max_frequency_hz": -1.0}, "must be positive"),
        (system, "jiont", {"n_modes": 6}, "Did you mean 'joint'"),
        (soft, "left-right", {"n_modes": 6}, "must tie two components rigidly"),
        (twice, "joint", {"n_modes": 6}, "connection 'wall' uses left"),
    ):
        with pytest.raises(InputError, match=words) as caught:
            fp.characteristic_interface(given, name, **options)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("offset", [0, 7, 5000])
def test_the_new_node_is_new_to_every_node_of_the_components(offset):
    """Nodes that no DOF moves (a whole model's, its highest id among them) are no room for the new one."""
    system, _ = joined()
    before = elastic(system)
    parts = []
    for c in system.components:
        far = 1 + offset + int(c.nodes.ids.max())
        parts.append(replace(c, nodes=fp.Nodes(np.r_[c.nodes.ids, far], np.vstack([c.nodes.positions, [0.5, 0.5, 0.5]]))))
    more = fp.couple(parts, [r.connection for r in system.connections], placements=dict(system.placements))
    reduced = fp.characteristic_interface(more, "joint", n_modes=48)
    for c in reduced.components:
        assert len(set(c.nodes.ids.tolist())) == len(c.nodes.ids)
    np.testing.assert_allclose(elastic(reduced), before, rtol=1e-8)
