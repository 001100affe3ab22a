"""The dual and the primal form are the same physics: modes, responses, multipliers, recovery."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from structures import bordered_hz, chain, chain_halves, random_rotation

from flexplant.assembly import Connection, couple
from flexplant.errors import CouplingError, InputError
from flexplant.model.damping import with_modal_damping
from flexplant.model.geometry import Placement
from flexplant.model.recovery import Recovery
from flexplant.modes import normal_modes
from flexplant.reduction import craig_bampton

JOINT = Connection("left", "right", [(4, 4)], directions="12346")


def pair(**options):
    frames = {"left": {4: random_rotation(1)}, "right": {4: random_rotation(2), 6: random_rotation(3)}}
    parts = chain_halves(frames=frames)
    parts = [_damped(p, i) for i, p in enumerate(parts)]
    return couple(parts, [JOINT], method="dual", **options), couple(parts, [JOINT], method="primal", **options)


def _damped(part, seed):
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(part.n, part.n))
    recovery = {
        "strain": Recovery(
            "strain", ["s.1", "s.2"], displacement=rng.normal(size=(2, part.n)), acceleration=rng.normal(size=(2, part.n))
        )
    }
    fields = {k: getattr(part, k) for k in ("name", "mass", "stiffness", "boundary", "nodes")}
    return type(part)(**fields, damping=3.0 * factor @ factor.T, recovery=recovery)


def response(system, force, s):
    """(n, k) uncoupled coordinates under a force on p, solved directly in the coupled form."""
    matrix = s**2 * system.mass.toarray() + s * system.damping.toarray() + system.stiffness.toarray()
    load = system.to_coupled(sp.csr_array(force.T)).toarray().T
    z = np.linalg.solve(matrix, load.astype(complex))
    return system.expand(z), z


def test_bordered_pencil_has_the_modes_of_the_eliminated_one():
    dual, primal = pair()
    modes = normal_modes(dual)
    np.testing.assert_allclose(normal_modes(primal).frequency_hz, modes.frequency_hz, rtol=1e-12)
    hz = bordered_hz(dual)
    assert hz.size == len(modes) == dual.n - dual.n_constraints
    np.testing.assert_allclose(hz[modes.n_rigid :], modes.frequency_hz[modes.n_rigid :], rtol=1e-9)
    assert hz[modes.n_rigid - 1] < 1e-3 * hz[modes.n_rigid]


@pytest.mark.parametrize("omega", [3.0, 160.0, 2500.0])
def test_responses_of_both_forms_agree(omega):
    dual, primal = pair()
    force = np.random.default_rng(4).normal(size=(dual.n, 3))
    ours, _ = response(dual, force, 1j * omega)
    theirs, _ = response(primal, force, 1j * omega)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 * abs(theirs).max())
    assert abs(dual.constraints @ ours).max() < 1e-12 * abs(ours).max()


def test_multiplier_is_the_force_that_a_exerts_on_b():
    """Free body of each side: side b feels +B^T lambda, side a the reaction."""
    dual, _ = pair()
    s = 1j * 90.0
    force = np.zeros((dual.n, 1))
    force[dual.row("left", 1, 1)] = 1.0
    p, z = response(dual, force, s)
    multiplier = z[dual.n :]
    for name, sign in (("right", +1.0), ("left", -1.0)):
        c, at = dual.component(name), dual.offsets[name]
        inertial = (s**2 * c.mass + s * c.damping + c.stiffness) @ p[at] - force[at]
        own = [i for i, (n, _) in enumerate(c.dofs.pairs) if n == 4]
        others = np.setdiff1d(np.arange(c.n), own)
        assert abs(inertial[others]).max() < 1e-9 * abs(inertial).max()
        relative = c.nodes.frame(4) @ dual.component("left").nodes.frame(4).T  # connection axes are left's
        turned = np.zeros((6, 1), complex)
        directions = [int(d) - 1 for d in JOINT.directions]
        turned[directions] = sign * multiplier
        expected = np.kron(np.eye(2), relative) @ turned
        np.testing.assert_allclose(inertial[own], expected, atol=1e-9 * abs(expected).max())


def test_static_pull_has_the_documented_sign():
    """Two springs in series, a left of b; b is pulled by +1 N and a is clamped: a exerts -1 N on b."""
    k = np.array([[7.0, -7.0], [-7.0, 7.0]])
    spring = {"mass": np.eye(2), "stiffness": k, "boundary": [(1, 1), (2, 1)]}
    from flexplant.model.component import Component

    parts = [Component(name="a", **spring), Component(name="b", **spring)]
    system = couple(parts, [Connection("a", "b", [(2, 1)], "1"), Connection("a", "ground", [1], "1")], method="dual")
    load = np.zeros(system.n_coupled)
    load[system.row("b", 2, 1)] = 1.0
    z = np.linalg.solve(system.stiffness.toarray(), load)
    assert system.constraint_labels == ("a-b.2.1", "a-ground.1.1")
    np.testing.assert_allclose(z, [0, 1 / 7, 1 / 7, 2 / 7, -1.0, 1.0], atol=1e-14)


def test_the_dual_form_is_equations_5_to_11():
    dual, _ = pair()
    n, m = dual.n, dual.n_constraints
    k = dual.stiffness.toarray()
    np.testing.assert_array_equal(k[:n, n:], dual.constraints.toarray().T)
    np.testing.assert_array_equal(k[n:, n:], np.zeros((m, m)))
    for name in ("mass", "damping"):
        coupled = getattr(dual, name).toarray()
        assert coupled.shape == (n + m, n + m)
        assert not coupled[n:].any()
        for c in dual.components:
            np.testing.assert_array_equal(coupled[dual.offsets[c.name], dual.offsets[c.name]], getattr(c, name))


def test_recovery_gives_the_same_quantity_in_both_forms():
    dual, primal = pair()
    force = np.random.default_rng(5).normal(size=(dual.n, 1))
    for name in ("left.strain", "right.strain"):
        values = []
        for system in (dual, primal):
            _, z = response(system, force, 40j)
            r = system.recovery[name]
            assert r.labels == ("s.1", "s.2")
            values.append(r.displacement @ z - 1600 * (r.acceleration @ z))
        np.testing.assert_allclose(values[0], values[1], rtol=1e-9)


def test_hcb_parts_share_their_modes_in_both_forms_and_reach_the_whole():
    from flexplant.model.component import FiniteElementModel

    parts = []
    for half in chain_halves():
        model = FiniteElementModel(name=half.name, mass=half.mass, stiffness=half.stiffness, dofs=half.boundary, nodes=half.nodes)
        reduced = craig_bampton(model, [(4, "123456")], n_modes=10)
        parts.append(with_modal_damping(reduced, 0.005))
    joint = [Connection("left", "right", [(4, 4)])]
    dual, primal = couple(parts, joint, method="dual"), couple(parts, joint, method="primal")
    hz = normal_modes(dual).frequency_hz
    np.testing.assert_allclose(bordered_hz(dual)[6:], hz[6:], rtol=1e-9)
    np.testing.assert_allclose(normal_modes(primal).frequency_hz, hz, rtol=1e-12)
    whole = normal_modes(chain()).frequency_hz
    assert (hz[6:12] >= whole[6:12] * (1 - 1e-9)).all(), "Rayleigh-Ritz frequencies lie above the exact ones"
    np.testing.assert_allclose(hz[6:10], whole[6:10], rtol=1e-2)


def test_expand_and_names_refuse_what_they_do_not_know():
    dual, primal = pair(placements={"left": Placement()})
    with pytest.raises(InputError, match=str(dual.n_coupled)):
        dual.expand(np.zeros(3))
    assert primal.expand(np.zeros((primal.n_coupled, 2))).shape == (dual.n, 2)
    with pytest.raises(InputError, match=r"no component 'lefft'.*'left'"):
        dual.component("lefft")
    with pytest.raises(InputError, match=r"left.*4-0|node 4 has directions"):
        dual.row("left", 4, 0)
    with pytest.raises(CouplingError, match="'dual' or 'primal'"):
        couple(dual.components, [JOINT], method="triple")
    assert dual.labels[0] == "left.1.1"
    assert len(dual.labels) == dual.n
