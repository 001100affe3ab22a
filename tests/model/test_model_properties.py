"""Laws of DOF sets, nodes, frames, units and rigid-body motion, over random cases."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from structures import chain, random_rotation, whole_component

from flexplant.assembly import couple
from flexplant.errors import InputError
from flexplant.model.arrays import checked_symmetric
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.conversion import component_to_si, model_to_si
from flexplant.model.damping import with_modal_damping
from flexplant.model.dofs import DofSet, expand_directions
from flexplant.model.geometry import Nodes, Placement, check_rotation, cross_matrix, cylindrical_frame, rigid_body_vectors
from flexplant.model.recovery import Recovery
from flexplant.model.units import UNIT_SYSTEMS, unit_system
from flexplant.modes import normal_modes
from flexplant.plant.modal import modal_plant
from flexplant.reduction import craig_bampton, expand
from flexplant.verification import mass_properties

pairs = st.lists(st.tuples(st.integers(1, 10**9), st.integers(0, 6)), unique=True, max_size=30)
seeds = st.integers(0, 2**31)
vectors = st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3)


@given(pairs)
def test_every_dof_is_found_where_it_was_put(given_pairs):
    dofs = DofSet.of(given_pairs)
    assert dofs.pairs == given_pairs
    assert len(dofs) == len(given_pairs)
    assert dofs.rows(given_pairs).tolist() == list(range(len(given_pairs)))
    assert all(p in dofs for p in given_pairs)
    assert (0, 0) not in dofs
    assert DofSet.of(dofs) is dofs
    assert set(dofs.nodes) == {n for n, d in given_pairs if d}


@given(st.permutations("123456"), st.integers(1, 6))
def test_directions_in_every_spelling(order, count):
    text = "".join(order[:count])
    digits = tuple(int(c) for c in text)
    assert expand_directions(text) == expand_directions(int(text)) == expand_directions(list(digits)) == digits
    assert DofSet.of([(7, text)]).pairs == [(7, d) for d in digits]


@given(seeds, st.integers(1, 8))
def test_frames_are_kept_and_orthonormal(seed, count):
    rng = np.random.default_rng(seed)
    frames = np.array([random_rotation(seed + i) for i in range(count)])
    rounded = np.round(frames, 7)  # what a file with seven digits delivers
    nodes = Nodes(np.arange(count) + 5, rng.normal(size=(count, 3)), rounded)
    for i in range(count):
        f = nodes.frame(5 + i)
        np.testing.assert_allclose(f @ f.T, np.eye(3), atol=5e-16 * 10)
        np.testing.assert_allclose(f, frames[i], atol=1e-6)
    with pytest.raises(ValueError, match="read-only"):
        nodes.positions[0, 0] = 1.0


@given(vectors, vectors, seeds)
def test_cylindrical_axes_are_a_rotation_that_sees_the_radius(position, origin, seed):
    axes = random_rotation(seed)
    f = cylindrical_frame(position, origin, axes)
    np.testing.assert_allclose(f @ f.T, np.eye(3), atol=1e-13)
    assert np.linalg.det(f) == pytest.approx(1.0)
    np.testing.assert_allclose(f[2], axes[2], atol=1e-14)
    arm = np.subtract(position, origin)
    if np.linalg.norm(np.cross(axes[2], arm)) > 1e-6:
        assert f[1] @ arm == pytest.approx(0.0, abs=1e-9), "no tangential part in the radius"
        assert f[0] @ arm > 0


@given(vectors, vectors)
def test_cross_matrix(a, b):
    np.testing.assert_allclose(cross_matrix(a) @ b, np.cross(a, b), atol=1e-9)


@given(seeds)
@settings(max_examples=30)
def test_placement_keeps_distances_and_rotation_is_exact(seed):
    rng = np.random.default_rng(seed)
    place = Placement(random_rotation(seed), rng.normal(size=3))
    points = rng.normal(size=(4, 3))
    moved = place.apply(points)
    np.testing.assert_allclose(np.diff(moved, axis=0) @ place.rotation, np.diff(points, axis=0), atol=1e-14)
    np.testing.assert_array_equal(check_rotation(place.rotation, "again"), place.rotation)


@given(seeds)
@settings(max_examples=20)
def test_rigid_body_vectors_move_points_as_a_rigid_body_does(seed):
    """By finite rotation: x -> Q x with Q = exp(theta) to first order, in any placement and node frame."""
    rng = np.random.default_rng(seed)
    nodes = Nodes([3, 8], rng.normal(size=(2, 3)), [random_rotation(seed), random_rotation(seed + 1)])
    dofs = DofSet.of([(8, "123456"), (1, 0), (3, "312")])
    place = Placement(random_rotation(seed + 2), rng.normal(size=3))
    about = rng.normal(size=3)
    r = rigid_body_vectors(nodes, dofs, about=about, placement=place)
    twist = rng.normal(size=6)
    u = r @ twist
    for node, rows in ((8, [0, 1, 2]), (3, [8, 9, 7])):
        arm = place.apply(nodes.position(node)) - about
        motion = twist[:3] + np.cross(twist[3:], arm)
        np.testing.assert_allclose(u[rows], nodes.frame(node) @ place.rotation.T @ motion, atol=1e-12)
    np.testing.assert_allclose(u[3:6], nodes.frame(8) @ place.rotation.T @ twist[3:], atol=1e-12)
    assert u[6] == 0.0


def test_a_free_model_does_not_strain_in_rigid_motion():
    model = chain({n: random_rotation(n) for n in range(1, 7)})
    r = rigid_body_vectors(model.nodes, model.dofs)
    assert abs(model.stiffness @ r).max() < 1e-9 * abs(model.stiffness).max()


@pytest.mark.parametrize("kind", [np.array, sp.csr_array, sp.csc_matrix, sp.coo_array])
def test_round_off_asymmetry_is_averaged_and_inputs_are_left_alone(kind):
    raw = np.array([[2.0, 1.0 + 3e-8], [1.0 - 3e-8, 5.0]])
    given_matrix = kind(raw)
    out = checked_symmetric(given_matrix, 2, "stiffness")
    result = out.toarray() if sp.issparse(out) else out
    np.testing.assert_array_equal(result, [[2.0, 1.0], [1.0, 5.0]])
    unchanged = given_matrix.toarray() if sp.issparse(given_matrix) else given_matrix
    np.testing.assert_array_equal(unchanged, raw)
    with pytest.raises(ValueError, match="read-only"):
        (out.data if sp.issparse(out) else out)[0] = 1.0


def test_modal_damping_is_equation_4():
    part = Component(name="x", mass=np.diag([3.0, 1.0, 2.0]), stiffness=np.diag([0.0, 9.0, 50.0]), boundary=[(1, 1)])
    damped = with_modal_damping(part, [0.01, 0.02])
    np.testing.assert_allclose(damped.damping, np.diag([0.0, 2 * 0.01 * 3.0, 2 * 0.02 * 5.0 * 2.0]), rtol=1e-14)
    assert part.damping is None
    sparse = Component(name="x", mass=sp.csr_array(part.mass), stiffness=sp.csr_array(part.stiffness), boundary=[(1, 1)])
    np.testing.assert_allclose(with_modal_damping(sparse, [0.01, 0.02]).damping.toarray(), damped.damping)


@pytest.mark.parametrize("name", list(UNIT_SYSTEMS))
def test_units_change_numbers_and_no_physics(name):
    """A model written in other units, converted: same frequencies, mass in kg, centre in m, recovery in its own row units."""
    units = unit_system(name)
    si = whole_component(chain())
    d = np.where([direction <= 3 for _, direction in si.dofs.pairs], units.length, 1.0)  # u_SI = d u_old
    energy = units.mass * units.length**2
    rows = np.random.default_rng(0).normal(size=(2, si.n))
    old = Component(
        name="whole",
        mass=d[:, None] * si.mass * d / (energy * units.mass_factor),
        stiffness=d[:, None] * si.stiffness * d / energy,
        damping=d[:, None] * np.eye(si.n) * d / energy,
        boundary=si.boundary,
        nodes=Nodes(si.nodes.ids, si.nodes.positions / units.length),
        recovery=[Recovery("s", ["a", "b"], rows, acceleration=rows)],
        units=name,
    )
    back = component_to_si(old, name)
    np.testing.assert_allclose(back.mass, si.mass, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(back.stiffness, si.stiffness, rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(back.damping, np.eye(si.n), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(back.recovery["s"].displacement, rows / d, rtol=1e-12)
    assert back.units == "SI"
    assert mass_properties(back).mass == pytest.approx(mass_properties(si).mass)
    model = model_to_si(chain(), "SI")
    np.testing.assert_array_equal(model.stiffness, chain().stiffness)


def test_mass_written_as_weight_gives_the_same_model():
    """One structure, once with mass in slinch, once with weight in lbf and modes normalised to that: g = 386.0886 in/s^2."""
    g = 386.0886
    rng = np.random.default_rng(3)
    half = rng.normal(size=(5, 5))
    mass, stiffness = half @ half.T + 5 * np.eye(5), np.diag([2e5, 3e5, 1e5, 4e6, 9e6])
    mass[3:, 3:] = np.eye(2)
    dashpots = np.diag([3.0, 0.0, 1.0, 0.0, 0.0])
    boundary = [(1, 1), (1, 2), (1, 6)]
    slinch = Component(name="b", mass=mass, stiffness=stiffness, damping=dashpots, boundary=boundary)
    q = np.r_[1.0, 1.0, 1.0, np.full(2, 1 / np.sqrt(g))]  # modal coordinates with unit weight instead of unit mass
    weight = Component(
        name="b", mass=q[:, None] * mass * g * q, stiffness=q[:, None] * stiffness * q, damping=dashpots, boundary=boundary
    )
    one, other = component_to_si(slinch, "inch-slinch-s"), component_to_si(weight, "inch-lbf")
    for kind in ("mass", "stiffness", "damping"):
        np.testing.assert_allclose(getattr(other, kind), getattr(one, kind), rtol=1e-7, err_msg=kind)
    np.testing.assert_allclose(other.mass[3:, 3:], np.eye(2), atol=1e-12)
    pound = FiniteElementModel(name="m", mass=np.eye(3), stiffness=np.eye(3), dofs=[(1, "123")])
    assert model_to_si(pound, "inch-lbf").mass[0, 0] == pytest.approx(0.45359237, rel=1e-12)  # the international pound
    assert model_to_si(pound, "inch-lbf").stiffness[0, 0] == pytest.approx(4.4482216152605 / 0.0254, rel=1e-12)


def test_the_presets_that_are_documented_exist():
    assert {"SI", "mm-tonne-s", "mm-kg-s", "inch-slinch-s", "inch-lbf", "ft-slug-s"} == set(UNIT_SYSTEMS)
    assert UNIT_SYSTEMS["inch-lbf"].force == pytest.approx(4.4482216152605)
    assert unit_system("inch-lbf").mass_factor == pytest.approx(1 / 386.0886, rel=1e-7)


def test_unit_conversion_keeps_modal_coordinates_normal():
    part = Component(name="q", mass=np.eye(2), stiffness=np.diag([0.0, 40.0]), boundary=[(1, 1)])
    back = component_to_si(part, (0.001, 1000.0))
    assert back.mass[1, 1] == pytest.approx(1.0)
    assert back.fixed_interface_hz[0] == pytest.approx(part.fixed_interface_hz[0])
    assert back.mass[0, 0] == pytest.approx(1000.0), "one tonne a unit"
    assert normal_modes(back).frequency_hz[0] == 0.0


@pytest.mark.parametrize("units", ["SI", "mm-tonne-s"])  # as the model says; "SI" is also what a model says that says nothing
def test_rows_that_a_reduction_recovers_become_si_with_the_matrices(units):
    """recover=: a force in N gives the same metres and radians whether the model or its component is converted."""
    model = replace(chain(), units=units)
    reduced = craig_bampton(model, [(1, "123456")], n_modes=2, recover=[(3, 1), (3, 5)], keep_basis=True)
    assert reduced.recovery["displacement"].units == {"SI": "m or rad", "mm-tonne-s": "mm or rad"}[units]
    late = component_to_si(reduced, "mm-tonne-s")
    early = craig_bampton(model_to_si(model, "mm-tonne-s"), [(1, "123456")], n_modes=2, recover=[(3, 1), (3, 5)])
    for one in (late, early):
        assert one.recovery["displacement"].units == "m or rad"
        assert one.source["units"] == "mm-tonne-s"
    frequency = [c.recovery["displacement"].displacement @ np.linalg.solve(c.stiffness - 4e4 * c.mass, np.eye(c.n)[:, :6])
                 for c in (late, early)]  # fmt: skip
    np.testing.assert_allclose(frequency[0], frequency[1], rtol=1e-8, atol=1e-12 * abs(frequency[1]).max())
    with pytest.raises(InputError, match="changed units after its reduction"):
        expand(late, np.zeros(late.n))
    plant = modal_plant(couple([late]), inputs=["whole.1.1"], outputs=["whole.displacement.3.1", "whole.displacement.3.5:v"])
    assert plant.output_units == ("m", "rad/s")


def test_a_row_of_unknown_quantity_says_in_which_units_it_stayed():
    rows = [Recovery("stress", ["7.1"], np.ones((1, 1))), Recovery("gauge", ["a"], np.ones((1, 1)), units="MPa")]
    part = Component(name="q", mass=np.eye(1), stiffness=np.eye(1), boundary=[(1, 1)], recovery=rows)
    back = component_to_si(part, "mm-tonne-s").recovery
    assert (back["stress"].units, back["gauge"].units) == ("units of the file (mm-tonne-s)", "MPa")
    assert back["stress"].displacement[0, 0] == 1e3


def test_what_is_in_si_is_not_converted_again():
    part = Component(name="q", mass=np.eye(2), stiffness=np.diag([0.0, 40.0]), boundary=[(1, 1)])
    for convert, model in ((model_to_si, chain()), (component_to_si, part)):
        once = convert(model, "mm-tonne-s")
        with pytest.raises(InputError, match=r"'(whole|q)' is in SI already.*'mm-tonne-s'.*'inch-lbf' would scale it again"):
            convert(once, "inch-lbf")
        assert convert(once, "SI").units == "SI"
        with pytest.raises(InputError, match="is in 'mm-kg-s', as its units say, and not in 'mm-tonne-s'"):
            convert(replace(model, units="mm-kg-s"), "mm-tonne-s")
        silent = replace(model, units="not stated", source={"units": "not stated: numbers as in the file"})
        np.testing.assert_array_equal(convert(silent, (1e-3, 1e3)).mass, once.mass)
