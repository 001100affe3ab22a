"""Structural damping of components, carried to the response of the coupled system; forces and motions inside components."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import flexplant as fp
from flexplant.errors import InputError, ModelError, SolverError
from flexplant.response import structural
from flexplant.response.structural import direct_response, structural_frequency_response, structural_response

N = 9


def chain(name: str, first: int, seed: int) -> fp.FiniteElementModel:
    """A free chain of uneven masses and springs, nodes first, first + 1, ..."""
    k = np.random.default_rng(seed).uniform(1e4, 3e4, N - 1)
    difference = np.diff(np.eye(N), axis=0)
    nodes = np.arange(first, first + N)
    return fp.FiniteElementModel(
        name=name,
        mass=sp.csr_array(np.diag(np.random.default_rng(seed + 1).uniform(0.5, 2, N))),
        stiffness=sp.csr_array(difference.T @ (k[:, None] * difference)),
        dofs=[(int(i), 1) for i in nodes],
        nodes=fp.Nodes(nodes, np.c_[nodes.astype(float), np.zeros((N, 2))]),
    )


def patchy(model: fp.FiniteElementModel, factor: float) -> sp.csr_array:
    """Structural damping of the first half of the springs only: not proportional to K."""
    k = model.stiffness.toarray()
    springs = -np.diagonal(k, 1) * (np.arange(N - 1) < N // 2)
    difference = np.diff(np.eye(N), axis=0)
    return sp.csr_array(factor * difference.T @ (springs[:, None] * difference))


A, B = chain("a", 1, 3), chain("b", N, 7)  # they share node N
DAMPED = {"a": patchy(A, 0.05), "b": patchy(B, 0.2)}
HZ = np.linspace(1.0, 45.0, 23)
NAMES = {"inputs": ["a.1.1", f"b.{2 * N - 1}.1"], "outputs": [f"b.{2 * N - 1}.1", "a.1.1:v", f"a.{N}.1:a"]}


def components(loads=()):
    return [
        fp.craig_bampton(m, ends, n_modes=N - 2, structural_damping=DAMPED[m.name], loads=loads if m is A else ())
        for m, ends in ((A, [(1, 1), (N, 1)]), (B, [(N, 1), (2 * N - 1, 1)]))
    ]


def joined(parts, method="dual"):
    return fp.couple(parts, [fp.Connection("a", "b", pairs=[(N, N)], directions="1")], method=method)


def whole(structural_part=1.0, viscous=None):
    """Dense response of the unreduced pair at displacements of all 2 N - 1 nodes to unit forces."""
    left, right = np.eye(2 * N - 1)[:, :N], np.eye(2 * N - 1)[:, N - 1 :]
    k, m, d = (
        left @ a.toarray() @ left.T + right @ b.toarray() @ right.T
        for a, b in ((A.stiffness, B.stiffness), (A.mass, B.mass), (DAMPED["a"], DAMPED["b"]))
    )
    return np.stack([np.linalg.inv(k + 1j * structural_part * d - (2 * np.pi * f) ** 2 * m) for f in HZ], axis=-1)


@pytest.mark.parametrize("method", ["dual", "primal"])
def test_two_components_of_different_damping_are_the_unreduced_pair(method):
    response = structural_frequency_response(joined(components(), method), **NAMES, frequency_hz=HZ)
    full, omega = whole(), 2 * np.pi * HZ
    last = 2 * N - 2
    expected = np.stack([full[last], 1j * omega * full[0], -(omega**2) * full[N - 1]])[:, [0, last]]
    np.testing.assert_allclose(response.values, expected, rtol=1e-8, atol=1e-10 * abs(expected).max())
    assert response.coords["output_units"].values.tolist() == ["m", "m/s", "m/s^2"]
    assert abs(whole(0.0)[last, 0] - full[last, 0]).max() > 0.1 * abs(full[last, 0]).max()  # the damping does matter here


def test_interface_forces_contain_the_damping_force():
    """The force that a exerts on b, from the balance of b alone: f_b = (K + i D - w^2 M) u_b less what is applied."""
    system = joined(components())
    name = str(system.connections[0].connection.name)
    force = structural_frequency_response(system, inputs=["a.1.1"], outputs=[f"{name}.force.{N}.1"], frequency_hz=HZ)
    u = whole()[N - 1 :, 0]
    z = B.stiffness.toarray() + 1j * DAMPED["b"].toarray()
    needed = [(z - (2 * np.pi * f) ** 2 * B.mass.toarray())[0] @ u[:, k] for k, f in enumerate(HZ)]
    np.testing.assert_allclose(abs(force.values[0, 0]), np.abs(needed), rtol=1e-8)
    ratio = force.values[0, 0] / needed
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-8)


def test_a_loss_factor_is_the_response_of_the_modes_with_it():
    parts = [fp.craig_bampton(m, e, n_modes=N - 2, structural_damping=0.03) for m, e in ((A, [(1, 1), (N, 1)]), (B, [(N, 1)]))]
    system = joined(parts)
    names = {"inputs": ["a.1.1"], "outputs": ["a.1.1", f"b.{N}.1"]}
    direct = structural_frequency_response(system, **names, frequency_hz=HZ)
    undamped = fp.couple([fp.craig_bampton(A, [(1, 1), (N, 1)], n_modes=N - 2), fp.craig_bampton(B, [(N, 1)], n_modes=N - 2)],
                         [fp.Connection("a", "b", pairs=[(N, N)], directions="1")])  # fmt: skip
    modal = structural_response(fp.modal_plant(undamped, **names), HZ, 0.03)
    np.testing.assert_allclose(direct.values, modal.values, rtol=1e-6, atol=1e-8 * abs(modal.values).max())


def test_an_unreduced_model_with_a_damping_matrix_and_its_own_dampers():
    model = fp.with_dampers(A, [((1, 1), None, 30.0), ((2, 1), (5, 1), 12.0)])
    one = fp.craig_bampton(model, [(1, 1), (N, 1)], n_modes=N - 2, structural_damping=DAMPED["a"])
    direct = direct_response(model, inputs=[(1, 1)], outputs=[(N, 1)], frequency_hz=HZ, structural_damping=DAMPED["a"])
    reduced = structural_frequency_response(fp.couple([one]), inputs=["a.1.1"], outputs=[f"a.{N}.1"], frequency_hz=HZ)
    np.testing.assert_allclose(reduced.values, direct.values, rtol=1e-8)


def test_without_structural_damping_it_is_the_viscous_plant():
    parts = [
        fp.with_modal_damping(fp.craig_bampton(m, e, n_modes=N - 2), 0.02) for m, e in ((A, [(1, 1), (N, 1)]), (B, [(N, 1)]))
    ]
    system = joined(parts)
    names = {"inputs": ["a.1.1"], "outputs": ["a.1.1", f"b.{N}.1:v"]}
    direct = structural_frequency_response(system, **names, frequency_hz=HZ)
    plant = fp.frequency_response(fp.modal_plant(system, **names), HZ)
    np.testing.assert_allclose(direct.values, plant.values, rtol=1e-7, atol=1e-9 * abs(plant.values).max())


def test_sparse_factors_agree_with_dense_ones(monkeypatch):
    system = joined(components())
    dense = structural_frequency_response(system, **NAMES, frequency_hz=HZ)
    monkeypatch.setattr(structural, "DENSE_LIMIT", 0)
    monkeypatch.setattr(structural, "DENSE_SHARE", 10.0)
    np.testing.assert_allclose(structural_frequency_response(system, **NAMES, frequency_hz=HZ).values, dense.values, rtol=1e-9)


def test_equivalent_viscous_damping_is_exact_at_its_frequency_only():
    hz = float(HZ[11])
    viscous = [fp.with_equivalent_viscous_damping(c, hz) for c in components()]
    assert all(c.structural_damping is None for c in viscous)
    plant = fp.modal_plant(joined(viscous), **NAMES)
    exact = structural_frequency_response(joined(components()), **NAMES, frequency_hz=HZ)
    error = abs(fp.frequency_response(plant, HZ).values - exact.values).max(axis=(0, 1)) / abs(exact.values).max(axis=(0, 1))
    assert error[11] < 1e-8
    assert error[3] > 1e-3
    plain = fp.craig_bampton(A, [(1, 1)], n_modes=2)
    assert fp.with_equivalent_viscous_damping(plain, 10.0) is plain
    with pytest.raises(ModelError, match="one positive frequency in Hz, got -1"):
        fp.with_equivalent_viscous_damping(plain, -1.0)


def test_nothing_is_dropped_silently_on_the_way_to_time():
    system = joined(components())
    names = {"inputs": ["a.1.1"], "outputs": ["a.1.1"]}
    for make in (fp.modal_plant, fp.descriptor):
        with pytest.raises(InputError, match="'a' has structural damping, which has no time-domain form") as caught:
            make(system, **names)
        assert "\n" not in str(caught.value)
    assert fp.modal_plant(system, **names, damping_ratio=0.01).n_modes == 2 * N - 1  # asked for in its place


def test_what_has_no_answer_is_refused():
    system = joined(components())
    with pytest.raises(InputError, match="coupled System, got ReducedComponent"):
        structural_frequency_response(components()[0], **NAMES, frequency_hz=HZ)
    with pytest.raises(InputError, match=r"Did you mean 'a\.1\.1'"):
        structural_frequency_response(system, inputs=["a.1.2"], outputs=["a.1.1"], frequency_hz=HZ)
    with pytest.raises(InputError, match="not negative"):
        structural_frequency_response(system, **NAMES, frequency_hz=[-1.0])
    with pytest.raises(SolverError, match="singular"):
        structural_frequency_response(system, inputs=["a.1.1"], outputs=["a.1.1"], frequency_hz=[0.0])
    with pytest.raises(ModelError, match="structural damping"):
        fp.craig_bampton(A, [(1, 1)], n_modes=2, structural_damping=np.eye(3))
    with pytest.raises(InputError, match="loss factor"):
        fp.craig_bampton(A, [(1, 1)], n_modes=2, structural_damping=-0.1)
    with pytest.raises(InputError, match="loss factor"):
        fp.craig_bampton(A, [(1, 1)], n_modes=2, structural_damping=True)


INSIDE = (4, 1)
OUT = f"a.{INSIDE[0]}.1"


def test_a_force_inside_a_component_and_the_motion_there():
    system = joined(components(loads=[INSIDE]))
    names = {"inputs": [OUT, "a.1.1"], "outputs": [OUT, OUT + ":a", f"b.{2 * N - 1}.1"]}
    response = structural_frequency_response(system, **names, frequency_hz=HZ).values
    full, omega = whole(), 2 * np.pi * HZ
    rows = np.stack([full[3], -(omega**2) * full[3], full[2 * N - 2]])[:, [3, 0]]
    np.testing.assert_allclose(response, rows, rtol=1e-8, atol=1e-10 * abs(rows).max())


@pytest.mark.parametrize("reduce", [fp.craig_bampton, fp.rubin])
def test_static_answers_to_interior_forces_are_exact_and_errors_have_an_order(reduce):
    """The force at a node of the interior, displacement there: statics exact; the error of a damped plant grows as w^4."""
    held = fp.FiniteElementModel(
        name="a", mass=A.mass, stiffness=A.stiffness + sp.diags_array([1e4] + [0.0] * (N - 1)), dofs=A.dofs
    )
    component = reduce(held, [(1, 1), (N, 1)], n_modes=1, loads=[INSIDE])
    plant = fp.modal_plant(fp.couple([component]), inputs=[OUT], outputs=[OUT])
    hz = np.array([0.4, 0.8, 1.6])
    full = direct_response(held, inputs=[INSIDE], outputs=[INSIDE], frequency_hz=np.r_[1e-6, hz])
    ours = fp.frequency_response(plant, np.r_[1e-6, hz]).values[0, 0]
    assert ours[0] == pytest.approx(full.values[0, 0, 0], rel=1e-9)
    error = abs(ours - full.values[0, 0])[1:]
    assert (np.log2(error[1:] / error[:-1]) > 3.8).all()


def test_names_inside_a_component():
    component = fp.craig_bampton(A, [(1, 1)], n_modes=3, loads=[INSIDE, (1, 1)])
    assert component.interior.pairs == [INSIDE]  # the other is on the boundary already
    system = fp.couple([component])
    assert fp.modal_plant(system, inputs=[OUT], outputs=[OUT]).inputs == (OUT,)
    with pytest.raises(InputError, match=r"a\.4\.1"):
        fp.modal_plant(system, inputs=["a.5.1"], outputs=[OUT])
    with pytest.raises(ModelError, match="interior rows"):
        fp.Component(name="x", mass=np.eye(2), stiffness=np.eye(2), boundary=[(1, 1)], interior=[(5, 1)])
    with pytest.raises(ModelError, match="1-1 are boundary or modal coordinates already"):
        fp.Component(
            name="x", mass=np.eye(2), stiffness=np.eye(2), boundary=[(1, 1)], interior=[(1, 1)], interior_rows=np.eye(1, 2)
        )


def test_units_carry_damping_and_interior_rows():
    """A component in mm-tonne-s, converted, responds as the one in SI."""
    scale = 1e-3
    old = fp.FiniteElementModel(name="a", mass=1e-3 * A.mass, stiffness=1e-3 * A.stiffness, dofs=A.dofs, units="mm-tonne-s")
    parts = [
        fp.component_to_si(fp.craig_bampton(old, [(1, 1)], n_modes=3, loads=[INSIDE], structural_damping=scale * DAMPED["a"]),
                           "mm-tonne-s"),
        fp.craig_bampton(A, [(1, 1)], n_modes=3, loads=[INSIDE], structural_damping=DAMPED["a"]),
    ]  # fmt: skip
    names = {"inputs": [OUT], "outputs": [OUT, "a.1.1"]}
    ours, si = (structural_frequency_response(fp.couple([c]), **names, frequency_hz=HZ).values for c in parts)
    np.testing.assert_allclose(ours, si, rtol=1e-9)
