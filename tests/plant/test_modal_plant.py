"""Modal and descriptor plants of coupled systems against matrices assembled by hand."""

from __future__ import annotations

import numpy as np
import pytest
from beam_systems import beam, one_beam_matrices, two_beams

from flexplant.assembly import Connection, System, couple
from flexplant.errors import InputError, LeftOutWarning, ModelError
from flexplant.model.component import Component
from flexplant.modes import normal_modes
from flexplant.plant.descriptor import descriptor
from flexplant.plant.modal import modal_plant, select
from flexplant.plant.state_space import Descriptor, state_space
from flexplant.response.frequency import frequency_response

HZ = np.array([8.0, 13.0, 55.5, 171.0, 400.0, 2100.0])
INPUTS = ["a.2.12", "b.14.3"]
OUTPUTS = ["b.14.2", "b.14.3", "a.3.3:v", "b.12.5:a", "a.gauge.bend.z", "a.gauge.axial:v"]
IN_COLUMNS = [6, 7, 44]


def direct_answer(hz: np.ndarray) -> np.ndarray:
    """(ny, nu, nf) by a dense solve with the hand-assembled matrices."""
    K, M, Z = one_beam_matrices()
    F = np.eye(48)[:, IN_COLUMNS]
    gauge_z, gauge_x = np.eye(48)[8] - np.eye(48)[2], np.eye(48)[6] - np.eye(48)[0]
    out = np.empty((6, 3, hz.size), dtype=complex)
    for k, w in enumerate(2 * np.pi * hz):
        u = np.linalg.solve(K + 1j * w * Z - w**2 * M, F)
        rows = [u[43], u[44], 1j * w * u[14], -(w**2) * u[34], gauge_z @ u, 1j * w * gauge_x @ u]
        out[:, :, k] = np.array(rows)
    return out


def relative(got, expected):
    """Largest error of each output at each frequency, relative to its largest response there."""
    expected = np.asarray(expected)
    return (abs(np.asarray(got) - expected).max(axis=1) / abs(expected).max(axis=1)).max()


@pytest.mark.parametrize("method", ["dual", "primal"])
def test_descriptor_and_modal_plant_equal_the_hand_assembled_structure(method):
    system = two_beams(method)
    expected = direct_answer(HZ)
    plant = descriptor(system, inputs=INPUTS, outputs=OUTPUTS)
    assert relative(frequency_response(plant, HZ), expected) < 1e-9
    modal = modal_plant(system, inputs=INPUTS, outputs=OUTPUTS)
    assert modal.n_rigid == 6
    assert modal.damping is not None
    assert relative(frequency_response(modal, HZ), expected) < 1e-9


def test_names_expand_and_keep_their_order_and_units():
    plant = modal_plant(two_beams(), inputs=INPUTS, outputs=[*OUTPUTS[:4], "a.gauge", "b.13.46:a"])
    assert plant.inputs == ("a.2.1", "a.2.2", "b.14.3")
    assert plant.outputs[-3:] == ("a.gauge.axial", "b.13.4:a", "b.13.6:a")
    assert plant.input_units == ("N", "N", "N")
    assert plant.output_units == ("m", "m", "m/s", "rad/s^2", "m", "m", "rad/s^2", "rad/s^2")


@pytest.mark.parametrize("method", ["dual", "primal"])
@pytest.mark.parametrize("grounded", [False, True])
def test_static_correction_equals_the_sum_over_all_truncated_modes(method, grounded):
    system = two_beams(method, grounded=grounded)
    modes = normal_modes(system)
    kept = modal_plant(system, inputs=INPUTS, outputs=["b.14.2", "b.14.3", "a.gauge"], n_modes=14)
    everything = modal_plant(system, inputs=INPUTS, outputs=["b.14.2", "b.14.3", "a.gauge"], modes=modes)
    truncated = slice(14, None)
    explicit = (everything.shape_out[:, truncated] / modes.omega[truncated] ** 2) @ everything.shape_in[truncated]
    assert everything.static_correction is None
    assert np.allclose(kept.static_correction, explicit, rtol=0, atol=1e-9 * abs(explicit).max())
    assert kept.n_rigid == (0 if grounded else 6)


def test_static_correction_restores_low_frequency_response_and_is_optional():
    system = two_beams(damping=0.0)
    hz = np.array([3.0, 30.0])
    arguments = {"inputs": INPUTS, "outputs": ["b.14.3", "a.gauge.axial"], "damping_ratio": 0.005}
    exact = frequency_response(modal_plant(system, **arguments), hz)
    corrected = frequency_response(modal_plant(system, **arguments, max_frequency_hz=500.0), hz)
    bare = frequency_response(modal_plant(system, **arguments, max_frequency_hz=500.0, static_correction=False), hz)
    assert relative(corrected[1:], exact[1:]) < (30 / 500) ** 2
    assert relative(bare[1:], exact[1:]) > 1e-1


@pytest.mark.parametrize("grounded", [False, True])
def test_interface_forces_are_the_dual_multipliers_in_every_form(grounded):
    names = ["a-b.force.5.123", "a-b.force.5.5"]
    hz = HZ
    dual = two_beams("dual", grounded=grounded)
    plant = descriptor(dual, inputs=INPUTS, outputs=["b.14.3"])
    rows = [dual.constraint_labels.index(f"a-b.5.{d}") for d in (1, 2, 3, 5)]
    lam = np.zeros((4, plant.n_states))
    lam[np.arange(4), [dual.n + r for r in rows]] = 1.0
    literal = Descriptor(plant.E, plant.A, plant.B, lam, np.zeros((4, 3)), plant.inputs, ("1", "2", "3", "5"))
    expected = frequency_response(literal, hz)
    for method in ("dual", "primal"):
        system = two_beams(method, grounded=grounded)
        recovered = frequency_response(descriptor(system, inputs=INPUTS, outputs=names), hz)
        assert relative(recovered, expected) < 1e-9
        modal = frequency_response(modal_plant(system, inputs=INPUTS, outputs=names), hz)
        assert np.allclose(modal, expected, rtol=0, atol=1e-8 * float(abs(expected).max()))


def test_interface_force_of_the_free_body_beyond_the_joint():
    """Rigid body, low frequency: a pushes b with the force that accelerates b's share of the mass."""
    system = two_beams(damping=0.0)
    plant = modal_plant(
        system, inputs=["a.1.1"], outputs=["a-b.force.5.1", "b.13.1:a"], damping_ratio=0.01, max_frequency_hz=700.0
    )
    force, acceleration = np.asarray(frequency_response(plant, [0.5]))[:, 0, 0]
    assert force.real == pytest.approx(0.6 / 1.6, rel=1e-6)
    assert acceleration.real == pytest.approx(1 / (2700 * 4e-4 * 1.6), rel=1e-6)
    assert plant.output_units == ("N", "m/s^2")


def test_compliant_interface_force_is_stiffness_times_gap():
    parts = [beam("a", 0.0, 1.0, 2), beam("b", 1.0, 1.6, 2, first=11)]
    system = couple(parts, [Connection("a", "b", pairs=[(3, 11)], stiffness=[1e6, 2e6, 3e6, 1e3, 1e3, 1e3], damping=5.0)])
    names = ["a-b.force.3.2", "a.3.2", "b.11.2"]
    plant = modal_plant(system, inputs=["b.13.2"], outputs=names)
    force, left, right = np.asarray(frequency_response(plant, [20.0, 90.0]))[:, 0, :]
    expected = (2e6 + 2j * np.pi * np.array([20.0, 90.0]) * 5.0) * (left - right)
    assert np.allclose(force, expected, rtol=1e-8)


def test_dropped_damping_is_reported_and_the_default_keeps_it():
    system = two_beams()
    kept = modal_plant(system, inputs=INPUTS, outputs=["b.14.3"], n_modes=12)
    dropped = modal_plant(system, inputs=INPUTS, outputs=["b.14.3"], n_modes=12, off_diagonal_damping="drop")
    Z = kept.damping
    assert dropped.damping is None
    assert np.allclose(np.diag(2 * dropped.zeta * dropped.omega), np.diag(np.diag(Z)))
    found = dropped.report["off_diagonal_damping"]
    i, j = found["modes"]
    assert found["dropped"]
    assert not kept.report["off_diagonal_damping"]["dropped"]
    assert found["largest"] == pytest.approx(abs(Z[i, j]) / np.sqrt(Z[i, i] * Z[j, j]))
    assert found["frequency_hz"] == pytest.approx(kept.frequency_hz[[i, j]])
    flexible = Z[6:, 6:]
    size = np.sqrt(np.diag(flexible))
    assert found["largest"] == pytest.approx(np.max(abs(flexible / np.outer(size, size)) - np.eye(6)))


def test_stiffness_proportional_damping_of_the_whole_is_diagonal():
    system = couple([beam("a", 0.0, 1.0, 3, damping=1e-5)], [])
    plant = modal_plant(system, inputs=["a.1.3"], outputs=["a.4.3"])
    assert plant.damping is None
    assert (plant.zeta[:6] == 0).all()
    assert np.allclose(plant.zeta[6:], 1e-5 * plant.omega[6:] / 2, rtol=1e-6)


def test_grounded_damper_damps_a_rigid_body_mode():
    damper = Connection("a", "ground", pairs=[1], directions="3", damping=40.0)
    system = couple([beam("a", 0.0, 1.0, 3)], [damper])
    plant = modal_plant(system, inputs=["a.1.3"], outputs=["a.1.3"])
    assert plant.n_rigid == 6
    assert plant.damping is not None
    direct = frequency_response(descriptor(system, inputs=["a.1.3"], outputs=["a.1.3"]), [0.3, 4.0])
    assert relative(frequency_response(plant, [0.3, 4.0]), direct) < 1e-8


def test_ratio_tables_follow_frequency():
    system = two_beams(damping=0.0)
    plant = modal_plant(system, inputs=INPUTS, outputs=["b.14.3"], n_modes=20, damping_ratio=[(100.0, 0.01), (1000.0, 0.03)])
    assert np.allclose(plant.zeta, np.interp(plant.frequency_hz, [100, 1000], [0.01, 0.03]))
    with pytest.raises(InputError, match="damping ratio"):
        modal_plant(system, inputs=INPUTS, outputs=["b.14.3"], n_modes=20, damping_ratio=[0.1, 0.2, 0.3])


def test_reciprocity_and_passivity_of_collocated_velocity():
    system = two_beams()
    plant = modal_plant(system, inputs=["a.1.3", "b.14.3"], outputs=["a.1.3:v", "b.14.3:v"], max_frequency_hz=3000.0)
    G = frequency_response(plant, np.geomspace(1, 5000, 200)).values
    assert np.allclose(G[0, 1], G[1, 0], rtol=1e-9)
    hermitian = (G + G.conj().transpose(1, 0, 2)).transpose(2, 0, 1)
    assert np.linalg.eigvalsh(hermitian).min() > -1e-12 * abs(G).max()


def test_select_orders_channels_and_reports_unknown_ones():
    plant = modal_plant(two_beams(), inputs=INPUTS, outputs=OUTPUTS, n_modes=15)
    part = select(plant, inputs=["b.14.3", "a.2.2"], outputs=["a.3.3:v", "b.14.2"])
    whole = frequency_response(plant, HZ)
    assert part.output_units == ("m/s", "m")
    picked = whole.sel(input=list(part.inputs), output=list(part.outputs))
    assert relative(frequency_response(part, HZ), picked) < 1e-13
    with pytest.raises(InputError, match=r"has no output 'a.3.3:w'.*'a.3.3:v'"):
        select(plant, outputs=["a.3.3:w"])


@pytest.mark.parametrize(
    ("inputs", "outputs", "message"),
    [
        (["a.1.2", "bbus.1.1"], ["a.1.2"], r"no component 'bbus'"),
        (["a.9.2"], ["a.1.2"], r"'a.9.2'.*no node 9.*Did you mean"),
        (["a.1.7"], ["a.1.2"], r"directions must be distinct digits"),
        (["a.1.x"], ["a.1.2"], r"is not 'component.node.direction'"),
        (["a.1.2", "a.1.12"], ["a.1.2"], r"inputs listed twice: a.1.2"),
        ("a.1.2", ["a.1.2"], r"must be a list of names"),
        (None, ["a.1.2"], r"inputs must be a list of names.*got None"),
        (["a.1.2"], 5, r"outputs must be a list of names.*got 5"),
        (["a.1.²"], ["a.1.2"], r"is not 'component.node.direction'"),
        (["a.1.2"], ["a.gauge.bend.y"], r"no such row in recovery 'gauge'.*bend.z"),
        (["a.1.2"], ["a.gage"], r"neither a DOF nor a recovery of component 'a'.*a.gauge"),
        (["a.1.2"], ["a-c.force.5.1"], r"no connection 'a-c'.*'a-b'"),
        (["a.1.2"], ["a-b.force.4.1"], r"no such row.*a-b.force.5.1"),
        (["a.1.2"], ["a-b.force.5.1:v"], r"have no ':v'"),
        (["a.1.2"], ["c.1.1"], r"no component or connection 'c'"),
    ],
)
def test_unknown_names_are_answered_with_near_ones(inputs, outputs, message):
    for build in (modal_plant, descriptor):
        with pytest.raises(InputError, match=message):
            build(two_beams(), inputs=inputs, outputs=outputs)


def test_unknown_damping_choice():
    with pytest.raises(InputError, match=r"off_diagonal_damping='dropp'.*drop"):
        modal_plant(two_beams(), inputs=INPUTS, outputs=OUTPUTS, off_diagonal_damping="dropp")


def three_beams() -> System:
    """Three beams that meet at x = 1: every pair is connected, so one of the three connections is redundant."""
    parts = [beam("a", 0.0, 1.0, 2), beam("b", 1.0, 1.6, 2, first=11), beam("c", 1.0, 2.5, 2, first=21)]
    pairs = {"a-b": ("a", "b", (3, 11)), "b-c": ("b", "c", (11, 21)), "a-c": ("a", "c", (3, 21))}
    return couple(parts, [Connection(x, y, pairs=[pair], name=name) for name, (x, y, pair) in pairs.items()])


def test_forces_of_redundant_constraints_are_refused_and_the_others_balance():
    system = three_beams()
    assert len(system.redundant) == 6
    left_out = system.redundant[0].split(".")[0]
    with pytest.raises(InputError, match="follows from other constraints, so its force is not unique"):
        modal_plant(system, inputs=["a.1.1"], outputs=[f"{left_out}.force.{system.redundant[0].split('.')[1]}.1"])
    kept = sorted({label.split(".")[0] for label in system.constraint_labels})
    force = {name: next(x for x in system.constraint_labels if x.startswith(name) and x.endswith(".1")) for name in kept}
    outputs = [x.replace(f"{name}.", f"{name}.force.") for name, x in force.items()] + ["a.1.1:a"]
    G = np.asarray(frequency_response(modal_plant(system, inputs=["a.1.1"], outputs=outputs, damping_ratio=0.01), [0.2]))[:, 0, 0]
    on_a = sum(g for name, g in zip(kept, G, strict=False) if name.startswith("a-"))
    assert (1 - on_a).real == pytest.approx(1.0 / 3.1, rel=1e-5)  # a keeps the share of its own mass


def test_a_massless_coordinate_is_static_compliance():
    """A massless extra DOF on a spring: no mode carries it, the static correction does."""
    K = np.array([[4.0, -3.0], [-3.0, 3.0]]) * 1e4
    part = Component(name="c", mass=np.diag([2.0, 0.0]), stiffness=K, boundary=[(1, 1), (2, 1)])
    plant = modal_plant(couple([part], []), inputs=["c.2.1"], outputs=["c.2.1", "c.1.1"], damping_ratio=0.01)
    assert plant.n_modes == 1
    assert np.allclose(frequency_response(plant, [0.0]).values[:, 0, 0], np.linalg.solve(K, [0.0, 1.0])[::-1], rtol=1e-12)
    assert plant.static_correction[0, 0] == pytest.approx(1 / 3e4, rel=1e-12)


def massless_tip(*, damped=False) -> System:
    """A wheel on a shaft to ground, and beyond it a shaft to a massless end; inputs there have no inertia to work against."""
    K, Z = np.array([[2e4, -1e4, 0.0], [-1e4, 2e4, -1e4], [0.0, -1e4, 1e4]]), np.diag([3.0, 1.0, 0.0])
    Z[0, 1] = Z[1, 0] = -1.0
    ends = [(1, 4), (3, 4), (2, 4)]
    order = np.ix_([0, 2, 1], [0, 2, 1])
    part = Component(
        name="c", mass=np.diag([1.0, 0.0, 0.3]), stiffness=K[order], boundary=ends, damping=Z[order] if damped else None
    )
    return couple([part], [])


@pytest.mark.parametrize(("damped", "n_modes"), [(False, 2), (False, 1), (True, 2)])
def test_rates_without_mass_are_fast_modes_or_a_warning(damped, n_modes):
    """The descriptor holds s K_mm^-1 F exactly; fast modes at 1e4 times the highest frequency differ by 1e-4, in phase."""
    system, hz = massless_tip(damped=damped), np.array([0.1, 2.0, 10.0])
    names = ["c.3.4", "c.3.4:v", "c.3.4:a", "c.1.4:v", "c.2.4:a"]
    given = {"inputs": ["c.3.4", "c.1.4"], "outputs": names}
    exact = frequency_response(descriptor(system, **given), hz).values
    damping = None if damped else 0.0
    plant = modal_plant(system, **given, n_modes=n_modes, damping_ratio=damping, static_correction="modes")
    assert (plant.damping is not None) == damped
    assert (plant.report["residual_modes"], plant.report["massless_modes"]) == (2 + 2 - n_modes, 2)
    assert plant.report["massless_hz"] == pytest.approx(1e4 * plant.frequency_hz[:-2].max())
    found = frequency_response(plant, hz).values
    tolerance = 2e-4 if n_modes == 2 else 0.1
    assert (abs(found - exact).max(axis=1) < tolerance * abs(exact).max(axis=1)).all()
    if n_modes == 2:
        assert (abs(abs(found) - abs(exact)).max(axis=1) < 1e-6 * abs(exact).max(axis=1)).all()
        assert np.allclose(found[0], exact[0], rtol=1e-11)
    assert abs(state_space(plant).D).max() < 4  # 1 / 0.3: steps of an input do not jump into the accelerations
    with pytest.warns(LeftOutWarning, match=r"'c\.3\.4' moves .* 'c\.3\.4:v' \(and 1 pairs more\) lacks .*descriptor") as told:
        lacking = modal_plant(system, **given, damping_ratio=damping)
    assert told[0].filename == __file__
    assert "'c.3.4:v' (and 1 pairs more) lacks" in lacking.report["notice"]
    silent = modal_plant(system, inputs=["c.3.4", "c.1.4"], outputs=["c.3.4", "c.1.4:v"], damping_ratio=0.0)
    assert "lacks" not in silent.report.get("notice", "")


def test_only_a_coupled_system_has_a_plant():
    part = two_beams().components[0]
    for build in (modal_plant, descriptor):
        with pytest.raises(InputError, match=rf"{build.__name__} takes a coupled System, got Component; use couple"):
            build(part, inputs=["a.1.2"], outputs=["a.1.2"])


def test_modes_of_another_object_are_refused():
    system = two_beams()
    for other in (normal_modes(system.components[0]), "modes"):
        with pytest.raises(InputError, match=rf"modes must be those of this system, with shapes over its {system.n} coord"):
            modal_plant(system, inputs=["a.1.2"], outputs=["a.1.2"], modes=other)


def truncated_error(hz, static_correction, outputs):
    """(ny, nf) worst error of the truncated plant, relative to the largest of each output."""
    system = two_beams(damping=0.0)
    arguments = {"inputs": INPUTS, "outputs": outputs, "damping_ratio": 0.0}
    exact = frequency_response(modal_plant(system, **arguments), hz).values
    plant = modal_plant(system, **arguments, max_frequency_hz=500.0, static_correction=static_correction)
    assert (plant.static_correction is None) == (static_correction == "modes")
    return abs(frequency_response(plant, hz).values - exact).max(axis=1) / abs(exact).max(axis=1)


def test_residual_modes_correct_velocities_and_accelerations_too():
    outputs = ["b.14.3", "b.14.3:v", "b.14.3:a", "a.2.2:a", "a-b.force.5.123"]
    hz = np.array([11.0, 50.0])
    static, residual = (truncated_error(hz, how, outputs) for how in (True, "modes"))
    assert (residual < 0.5 * static).all()
    assert (residual[[1, 2, 3]] < 1e-2 * static[[1, 2, 3]]).all()


def test_residual_modes_converge_with_the_fourth_power_at_collocated_outputs():
    """The direct term leaves out w^2 Phi phi^T / w_k^4; residual modes of a load match it at that load: two orders more."""
    outputs, hz = ["b.14.3", "a.2.2"], np.array([20.0, 40.0])
    for how, order in ((True, 2), ("modes", 4)):
        system = two_beams("primal", damping=0.0, grounded=True)
        arguments = {"inputs": ["b.14.3", "a.2.2"], "outputs": outputs, "damping_ratio": 0.0}
        exact = frequency_response(modal_plant(system, **arguments), hz).values
        plant = modal_plant(system, **arguments, max_frequency_hz=500.0, static_correction=how)
        error = abs(frequency_response(plant, hz).values - exact).max(axis=(0, 1))
        assert np.log2(error[1] / error[0]) == pytest.approx(order, abs=0.3)


def test_residual_modes_of_equal_and_of_massless_inputs():
    """Equal inputs share a residual mode; what has no inertia stays a direct term."""
    system = two_beams(damping=0.0)
    once = modal_plant(system, inputs=["b.14.3"], outputs=["b.14.3"], n_modes=14, damping_ratio=0.01, static_correction="modes")
    both = modal_plant(
        system, inputs=["b.14.3", "a.2.1"], outputs=["b.14.3"], n_modes=14, damping_ratio=0.01, static_correction="modes"
    )
    assert (once.report["residual_modes"], both.report["residual_modes"]) == (1, 2)
    joined = ["a.5.3", "b.11.3"]  # one node, seen from both sides of the joint
    equal = modal_plant(system, inputs=joined, outputs=["b.14.3"], n_modes=14, damping_ratio=0.01, static_correction="modes")
    assert equal.report["residual_modes"] == 1
    assert np.allclose(equal.shape_in[:, 0], equal.shape_in[:, 1], rtol=0, atol=1e-9 * abs(equal.shape_in).max())
    assert (once.report["modes_kept"], once.n_modes, once.n_rigid) == (14, 15, 6)
    assert np.array_equal(np.sort(once.omega), once.omega)
    K = np.diag([4.0, 3.0, 3.0]) * 1e4 - 3e4 * (np.eye(3, k=1) * [0, 1, 0] + np.eye(3, k=-1) * [[0], [1], [0]])
    K[1:, 1:] += np.diag([1e4, 0.0])
    part = Component(name="c", mass=np.diag([2.0, 0.5, 0.0]), stiffness=K, boundary=[(1, 1), (2, 1), (3, 1)])
    plant = modal_plant(
        couple([part], []), inputs=["c.3.1"], outputs=["c.3.1"], n_modes=1, damping_ratio=0.01, static_correction="modes"
    )
    assert plant.static_correction is not None
    assert frequency_response(plant, [0.0]).item() == pytest.approx(np.linalg.inv(K)[2, 2], rel=1e-12)


def test_residual_modes_keep_reciprocity_and_the_static_answer():
    system = two_beams(grounded=True)
    names = ["a.2.1", "b.14.3", "b.12.5"]
    plant = modal_plant(system, inputs=names, outputs=names, n_modes=4, static_correction="modes")
    G = frequency_response(plant, [0.0, 77.0]).values
    assert np.allclose(G, G.transpose(1, 0, 2), rtol=1e-9, atol=1e-15)
    exact = frequency_response(modal_plant(system, inputs=names, outputs=names), [0.0]).values
    assert np.allclose(G[:, :, :1], exact, rtol=1e-9, atol=1e-9 * abs(exact).max())


def test_the_kind_of_static_correction_is_checked():
    with pytest.raises(InputError, match="static_correction"):
        modal_plant(two_beams(), inputs=INPUTS, outputs=["b.14.3"], static_correction="mode")


def test_a_buckled_structure_is_told_as_such():
    part = Component(name="x", mass=np.eye(3), stiffness=np.diag([-860.0, 9.0, -1.0]), boundary=[(1, 1), (1, 2), (1, 3)])
    system = couple([part], [])
    form = {"inputs": ["x.1.1"], "outputs": ["x.1.1"]}
    with pytest.raises(ModelError, match=r"buckles: 2 modes of negative stiffness, mode 1 .* -860 .*-4\.667 Hz.*descriptor"):
        modal_plant(system, damping_ratio=0.0, **form)
    direct = frequency_response(descriptor(system, **form), HZ).values[0, 0]
    np.testing.assert_allclose(direct, 1 / (-860.0 - (2 * np.pi * HZ) ** 2), rtol=1e-12)
