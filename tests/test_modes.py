"""Normal modes: closed forms, exact rigid-body zeros, mechanisms, soft suspensions, large models, bad requests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from structures import CHAIN, TUBE, chain, chain_halves, elastic_hz, frame_model, random_rotation, whole_component

from flexplant.assembly import Connection, component_rigid_body, couple, system_rigid_body
from flexplant.errors import InputError, SolverError
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.geometry import Nodes, Placement, rigid_body_vectors
from flexplant.modes import Modes, effective_mass, mac, normal_modes


def rod(n, *, clamped=False, sparse=True):
    """n equal masses and springs in a line: w = 2 sqrt(k/m) sin(...), in closed form."""
    main = np.r_[1.0, 2 * np.ones(n - 2), 1.0]
    k = 1e4 * sp.diags_array([main, -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1])
    k = sp.csr_array(k)
    if clamped:
        k = k + sp.csr_array(([1e4], ([0], [0])), shape=(n, n))
    m = sp.eye_array(n, format="csr")
    fields = {"dofs": [(i + 1, 1) for i in range(n)], "nodes": Nodes(np.arange(1, n + 1), np.c_[np.arange(n), np.zeros((n, 2))])}
    return FiniteElementModel(name="rod", stiffness=k if sparse else k.toarray(), mass=m, **fields)


def rod_hz(n, count):
    return 2 * np.sqrt(1e4) * np.sin(np.arange(count) * np.pi / (2 * n)) / (2 * np.pi)


def assert_mass_normalised(model, modes, tolerance=1e-9):
    m = model.uncoupled_mass if hasattr(model, "uncoupled_mass") else model.mass
    k = model.uncoupled_stiffness if hasattr(model, "uncoupled_stiffness") else model.stiffness
    phi = modes.shapes
    np.testing.assert_allclose(phi.T @ (m @ phi), np.eye(len(modes)), atol=tolerance)
    scale = max(modes.omega.max() ** 2, 1.0)
    np.testing.assert_allclose(phi.T @ (k @ phi), np.diag(modes.omega**2), atol=tolerance * scale)


@pytest.mark.parametrize("n", [5, 300])
def test_rod_in_closed_form(n):
    model = rod(n)
    modes = normal_modes(model)
    assert modes.n_rigid == 1
    assert modes.frequency_hz[0] == 0.0
    np.testing.assert_allclose(modes.frequency_hz, rod_hz(n, n), rtol=1e-9)
    assert_mass_normalised(model, modes)
    assert modes.residuals.max() < 1e-9


def test_large_sparse_rod_uses_lanczos_and_keeps_the_exact_zero():
    model = rod(2500)
    modes = normal_modes(model, n_modes=12)
    assert modes.n_rigid == 1
    np.testing.assert_array_equal(modes.frequency_hz[0], 0.0)
    np.testing.assert_allclose(modes.frequency_hz, rod_hz(2500, 12), rtol=1e-7)
    limited = normal_modes(model, max_frequency_hz=float(rod_hz(2500, 40)[39]) * 1.001)
    assert len(limited) == 40
    assert_mass_normalised(model, modes, 1e-7)


def test_large_model_without_geometry_finds_its_rigid_mode():
    model = replace(rod(2500), nodes=None)
    modes = normal_modes(model, n_modes=6)
    assert modes.n_rigid == 1
    np.testing.assert_allclose(modes.frequency_hz, rod_hz(2500, 6), rtol=1e-6)


def test_a_free_beam_reaches_euler_bernoulli():
    """Free-free uniform beam, 24 elements: f = (4.73004, 7.85320, 10.99561)^2 sqrt(EI / rho A L^4) / 2 pi, in pairs."""
    length, n = 2.0, 24
    line = {i: np.array([length * i / n, 0, 0]) for i in range(n + 1)}
    modes = normal_modes(frame_model("beam", line, [(i, i + 1) for i in range(n)]))
    assert modes.n_rigid == 6
    beta = np.repeat([4.730040744862704, 7.853204624095838, 10.995607838001671], 2)
    expected = beta**2 * np.sqrt(TUBE["ei"] / (TUBE["rho_a"] * length**4)) / (2 * np.pi)
    np.testing.assert_allclose(modes.frequency_hz[6:10], expected[:4], rtol=2e-5)


@pytest.mark.parametrize("seed", range(5))
def test_six_exact_zeros_whatever_the_frames_and_the_units(seed):
    frames = {n: random_rotation(100 * seed + n) for n in CHAIN}
    model = chain(frames)
    scale = 10.0 ** np.random.default_rng(seed).uniform(-6, 6)
    model = replace(model, stiffness=scale * model.stiffness)
    modes = normal_modes(model)
    assert modes.n_rigid == 6
    np.testing.assert_array_equal(modes.frequency_hz[:6], 0.0)
    assert (modes.frequency_hz[6:] > 0).all()
    assert_mass_normalised(model, modes)
    motion = rigid_body_vectors(model.nodes, model.dofs)
    total = effective_mass(modes, model, motion).sum(axis=0)
    np.testing.assert_allclose(total, np.diagonal(motion.T @ model.mass @ motion), rtol=1e-9)
    assert effective_mass(modes, model, motion)[6:].max() < 1e-12 * total.max()


@pytest.mark.parametrize("seed", range(3))
def test_zeros_survive_without_positions(seed):
    model = replace(chain({n: random_rotation(seed + n) for n in CHAIN}), nodes=None)
    modes = normal_modes(model)
    assert modes.n_rigid == 6
    np.testing.assert_allclose(modes.frequency_hz[6:], elastic_hz(model.mass, model.stiffness, 6), rtol=1e-9)


@pytest.mark.parametrize("digits", [5, 7, 16])
def test_positions_rounded_by_a_file_still_give_exact_zeros(digits):
    model = chain()
    rounded = Nodes(model.nodes.ids, np.round(model.nodes.positions * (1 + 1e-3) / (1 + 1e-3), digits) + 0.0)
    noisy = Nodes(model.nodes.ids, rounded.positions + 10.0**-digits * np.random.default_rng(1).uniform(-0.5, 0.5, (6, 3)))
    modes = normal_modes(replace(model, nodes=noisy))
    assert modes.n_rigid == 6


def test_a_clamped_model_has_no_zero():
    modes = normal_modes(couple([whole_component(chain())], [Connection("whole", "ground", [1])]))
    assert modes.n_rigid == 0
    assert modes.frequency_hz.min() > 1.0


@pytest.mark.parametrize("directions", ["123", "1246", "35"])
def test_a_free_mechanism_is_exactly_zero(directions):
    modes = normal_modes(couple(chain_halves(), [Connection("left", "right", [(4, 4)], directions=directions)]))
    assert modes.n_rigid == 12 - len(directions)
    np.testing.assert_array_equal(modes.frequency_hz[: modes.n_rigid], 0.0)


def test_an_internal_mechanism_is_found_by_the_null_space():
    """Two bars on ball joints in series inside one model: geometry of the whole does not know the kink."""
    k = np.zeros((6, 6))
    pair = 1e5 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    for a, b in ((0, 1), (1, 2)):
        k[np.ix_([2 * a, 2 * b], [2 * a, 2 * b])] += pair
    line = Nodes([1, 2, 3], [[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    model = FiniteElementModel(name="m", mass=np.eye(6), stiffness=k, dofs=[(i, "12") for i in (1, 2, 3)], nodes=line)
    modes = normal_modes(model)
    assert modes.n_rigid == 4, "x, y, rotation, kink"
    np.testing.assert_allclose(modes.omega[4:], [np.sqrt(1e5), np.sqrt(3e5)], rtol=1e-12)


@pytest.mark.parametrize("stiffness", [1e3, 1.0, 0.1])
def test_a_soft_spring_inside_a_model_is_not_rigid(stiffness):
    model = chain()
    k = model.stiffness.copy()
    k[0, 0] += stiffness
    modes = normal_modes(replace(model, stiffness=k))
    assert modes.n_rigid == 5
    assert 0 < modes.frequency_hz[5] < np.sqrt(stiffness)
    assert modes.frequency_hz[5] == pytest.approx(first_order_hz(model, stiffness), rel=2e-2)


def first_order_hz(model, stiffness):
    """A soft spring on u_1: w^2 = k r^T M_RR^-1 r with r the rigid motions at that DOF (perturbation theory)."""
    r = rigid_body_vectors(model.nodes, model.dofs)
    return float(np.sqrt(stiffness * r[0] @ la.solve(r.T @ model.mass @ r, r[0]))) / (2 * np.pi)


@pytest.mark.parametrize("method", ["dual", "primal"])
def test_shapes_are_compatible_and_labelled(method):
    places = {"right": Placement(translation=[0.1, 0.0, 0.2])}
    system = couple(chain_halves(), [Connection("left", "right", [(4, 4)])], method=method, placements=places)
    modes = normal_modes(system)
    assert abs(system.constraints @ modes.shapes).max() < 1e-12
    assert_mass_normalised(system, modes)
    assert modes.labels == system.labels
    rigid = system_rigid_body(system)
    assert la.subspace_angles(rigid, modes.shapes[:, :6]).max() < 1e-9
    with pytest.raises(ValueError, match="read-only"):
        modes.shapes[0, 0] = 1.0


def test_a_component_by_itself_is_free_at_its_boundary():
    part = chain_halves()[0]
    modes = normal_modes(part)
    assert modes.n_rigid == 6
    np.testing.assert_allclose(modes.frequency_hz[6:], elastic_hz(part.mass, part.stiffness, 6), rtol=1e-9)
    assert la.subspace_angles(component_rigid_body(part), modes.shapes[:, :6]).max() < 1e-9


def test_tiny_rotary_inertia_is_neither_lost_nor_harmful():
    """Lumped masses with rotary inertia 1e-9 of the rest: the low modes are the massless ones to 1e-6."""
    model = chain()
    lumped = np.diag([1.0 if d <= 3 else 0.0 for _, d in model.dofs.pairs])
    tiny = lumped + np.diag([0.0 if d <= 3 else 1e-9 for _, d in model.dofs.pairs])
    massless, small = (normal_modes(replace(model, mass=m)) for m in (lumped, tiny))
    assert len(massless) == 18
    assert massless.n_rigid == small.n_rigid == 6
    np.testing.assert_allclose(small.frequency_hz[6:18], massless.frequency_hz[6:], rtol=1e-6)


def test_negative_stiffness_shows_as_a_negative_frequency():
    part = Component(name="x", mass=np.eye(2), stiffness=np.diag([-4.0, 9.0]), boundary=[])
    np.testing.assert_allclose(normal_modes(part).omega, [-2.0, 3.0], rtol=1e-12)


def test_modes_are_repeatable_to_the_last_bit():
    a, b = (normal_modes(rod(2000), n_modes=8) for _ in range(2))
    np.testing.assert_array_equal(a.shapes, b.shapes)


def test_requests_that_cannot_be_met():
    model = rod(6)
    for bad in (
        {"max_frequency_hz": 0.0},
        {"max_frequency_hz": -1.0},
        {"max_frequency_hz": np.nan},
        {"n_modes": 0},
        {"n_modes": 2.5},
    ):
        with pytest.raises(InputError, match=r"must be a? ?positive"):
            normal_modes(model, **bad)
    with pytest.raises(InputError, match="7 modes were asked for, but the model has only 6"):
        normal_modes(model, n_modes=7)
    with pytest.raises(InputError, match="got str"):
        normal_modes("bus")
    with pytest.raises(InputError, match=r"all modes of a model of 20000 coordinates do not fit"):
        normal_modes(rod(20_000))
    assert len(normal_modes(model, n_modes=3)) == 3
    assert len(normal_modes(model, max_frequency_hz=1e-6)) == 1


def test_a_mechanism_without_mass_is_an_error():
    part = Component(name="x", mass=np.diag([1.0, 0.0]), stiffness=np.diag([4.0, 0.0]), boundary=[])
    with pytest.raises(SolverError, match=r"moves no mass|neither mass nor stiffness"):
        normal_modes(part)


def test_mac():
    rng = np.random.default_rng(2)
    a = rng.normal(size=(7, 3))
    q = la.qr(a, mode="economic")[0]
    np.testing.assert_allclose(mac(q, -5 * q), np.eye(3), atol=1e-12)
    b = rng.normal(size=(7, 2)) + 1j * rng.normal(size=(7, 2))
    values = mac(a, b)
    assert values.shape == (3, 2)
    assert ((values >= 0) & (values <= 1)).all()
    np.testing.assert_allclose(mac(b * np.exp(0.7j), b).diagonal(), 1.0)
    with pytest.raises(InputError, match="7 and 5 rows"):
        mac(a, np.ones((5, 1)))


def test_effective_mass_names_the_sizes_that_disagree():
    modes = normal_modes(rod(6))
    assert isinstance(modes, Modes)
    with pytest.raises(InputError, match="rows"):
        effective_mass(modes, rod(6), np.ones((5, 1)))


@pytest.mark.parametrize("bad", [{"n_modes": "3"}, {"n_modes": np.nan}, {"max_frequency_hz": "50"}, {"max_frequency_hz": [50]}])
def test_requests_that_are_no_numbers(bad):
    with pytest.raises(InputError, match=f"{next(iter(bad))} must be"):
        normal_modes(chain(), **bad)


@pytest.mark.parametrize("hz", [1.0, 1e-2, 1e-4])
def test_a_soft_mount_without_geometry_is_no_rigid_body_mode(hz):
    """Round-off is told from a soft spring by its sign, not by its size."""
    mount = 10.0 * (2 * np.pi * hz) ** 2
    part = Component(name="c", mass=[[10.0, 0.5], [0.5, 1.0]], stiffness=np.diag([mount, (2e3 * np.pi) ** 2]), boundary=[(1, 1)])
    modes = normal_modes(part)
    assert modes.n_rigid == 0
    assert modes.frequency_hz[0] == pytest.approx(hz, rel=1e-3)
