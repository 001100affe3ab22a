"""Descriptor responses: the second-order form found behind a descriptor, both solution routes against dense LAPACK."""

import numpy as np
import pytest
import scipy.sparse as sp

from flexplant.errors import InputError, SolverError
from flexplant.numerics.factorization import rslab_backend
from flexplant.plant.state_space import Descriptor
from flexplant.response import descriptor as module
from flexplant.response.descriptor import DescriptorResponse, second_order
from flexplant.response.frequency import frequency_response, frequency_response_blocks

HZ = np.array([0.3, 1.1, 4.0, 9.5])


def chain(n: int, seed: int, *, stiff: float = 1e6):
    """Mass, damping and stiffness of a grounded chain of n masses with some longer springs."""
    rng = np.random.default_rng(seed)
    K = np.diag(np.r_[1.0, np.full(n - 1, 2.0)]) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[0, -1] = K[-1, 0] = -0.2
    K = stiff * (K + 0.5 * np.eye(n))
    M = np.diag(rng.uniform(500, 2000, n))
    return M, 1e-4 * K + 0.3 * M, K


def bordered(n: int = 30, constraints: int = 4, *, gyroscopic: float = 0.0) -> Descriptor:
    """Two chains joined by multipliers, an acceleration output with its algebraic state, displacement and velocity outputs."""
    (Ma, Za, Ka), (Mb, Zb, Kb) = chain(n, 1), chain(n, 2, stiff=3e4)
    size, m = 2 * n, constraints
    B = np.zeros((m, size))
    B[np.arange(m), n - 1 - np.arange(m)], B[np.arange(m), n + np.arange(m)] = 1.0, -1.0
    zero = np.zeros((m, m))

    def whole(a, b, border):
        inner = np.block([[a, np.zeros((n, n))], [np.zeros((n, n)), b]])
        return np.block([[inner, border.T], [border, zero]])

    M, Z, K = whole(Ma, Mb, 0 * B), whole(Za, Zb, 0 * B), whole(Ka, Kb, B)
    Z[0, 1], Z[1, 0] = Z[0, 1] + gyroscopic, Z[1, 0] - gyroscopic
    N = size + m
    force, accelerated = np.zeros((N, 2)), np.zeros((1, N))
    force[0, 0], force[size - 1, 1], accelerated[0, 5] = 1.0, 2.0, 1.0
    one, none = np.eye(N), np.zeros((N, N))
    E = np.block([[one, none, np.zeros((N, 1))], [none, M, np.zeros((N, 1))], [np.zeros((1, N)), accelerated, np.zeros((1, 1))]])
    A = np.block([[none, one, np.zeros((N, 1))], [-K, -Z, np.zeros((N, 1))], [np.zeros((1, 2 * N)), np.eye(1)]])
    C = np.zeros((4, 2 * N + 1))
    C[0, size - 1], C[1, N + 3], C[2, -1], C[3, size] = 1.0, 1.0, 1.0, 1.0  # displacement, velocity, acceleration, multiplier
    inputs = np.vstack([np.zeros((N, 2)), force, np.zeros((1, 2))])
    return Descriptor(sp.csr_array(E), sp.csr_array(A), inputs, C, np.full((4, 2), 1e-9), ["f", "g"], ["d", "v", "a", "lambda"])


def dense_answer(system: Descriptor, hz) -> np.ndarray:
    E, A, B, C = (np.asarray(m.toarray() if sp.issparse(m) else m) for m in (system.E, system.A, system.B, system.C))
    return np.stack([C @ np.linalg.solve(2j * np.pi * f * E - A, B) + system.D for f in hz], axis=2)


def error(found, expected) -> float:
    return float((abs(found - expected).max(axis=2) / abs(expected).max(axis=2)).max())


@pytest.mark.parametrize("backend", ["rslab", "superlu"])
@pytest.mark.parametrize("constraints", [0, 4])
def test_symmetric_route_equals_the_dense_solution(monkeypatch, backend, constraints):
    """Bordered by multipliers (dual) or not (primal); never through s E - A."""
    monkeypatch.setattr(rslab_backend, "available", lambda: backend == "rslab")
    monkeypatch.setattr(module._General, "solved", lambda *_: pytest.fail("the unsymmetric route was taken"))
    system = bordered(constraints=constraints)
    assert second_order(system) is not None
    assert error(frequency_response(system, HZ).values, dense_answer(system, HZ)) < 1e-10


@pytest.mark.parametrize("constraints", [0, 4])
def test_unsymmetric_route_equals_the_dense_solution(constraints):
    """Gyroscopic damping has no symmetric form; every frequency after the first uses the first one's column order."""
    system = bordered(constraints=constraints, gyroscopic=700.0)
    assert second_order(system) is None
    assert error(frequency_response(system, HZ).values, dense_answer(system, HZ)) < 1e-10


def test_second_order_form_is_that_which_the_descriptor_was_made_from():
    found = second_order(bordered(n=10, constraints=2))
    M, Z, K = chain(10, 1)
    assert found.mass.shape == (22, 22)
    assert np.array_equal(found.mass.toarray()[:10, :10], M)
    assert np.array_equal(found.damping.toarray()[:10, :10], Z)
    assert np.array_equal(found.stiffness.toarray()[:10, :10], K)
    assert found.outputs[2].toarray()[2, 5] == 1.0


@pytest.mark.parametrize(
    "change",
    [
        lambda E, A, B, n: A.__setitem__((0, n), 2.0),  # not the identity
        lambda E, A, B, n: E.__setitem__((0, n + 1), 0.1),
        lambda E, A, B, n: E.__setitem__((n, 0), 0.1),
        lambda E, A, B, n: A.__setitem__((n, 2 * n), 0.1),
        lambda E, A, B, n: A.__setitem__((2 * n, 0), 0.1),
        lambda E, A, B, n: A.__setitem__((2 * n, 2 * n), 3.0),
        lambda E, A, B, n: E.__setitem__((2 * n, 2 * n), 0.1),
        lambda E, A, B, n: E.__setitem__((n, n + 1), 40.0),  # a mass that is not symmetric
        lambda E, A, B, n: B.__setitem__((0, 0), 1.0),
        lambda E, A, B, n: B.__setitem__((2 * n, 0), 1.0),
    ],
)
def test_almost_second_order_systems_are_solved_as_they_are(change):
    system = bordered(n=8, constraints=0)
    E, A, B = system.E.toarray(), system.A.toarray(), np.array(system.B)
    change(E, A, B, 16)
    other = Descriptor(E, A, B, system.C, system.D, system.inputs, system.outputs)
    assert second_order(other) is None
    assert error(frequency_response(other, HZ).values, dense_answer(other, HZ)) < 1e-10


def test_a_symmetric_factor_that_fails_hands_over(monkeypatch):
    system = bordered()
    expected = frequency_response(system, HZ).values

    def refuse(*_):
        raise SolverError("singular")

    monkeypatch.setattr(module.PencilSweep, "factor", refuse)
    assert error(frequency_response(system, HZ).values, expected) < 1e-10


def test_a_symmetric_solution_that_is_inaccurate_hands_over(monkeypatch):
    """A factor of a wrong matrix: refinement cannot mend it, the backward error tells."""
    system = bordered()
    expected = frequency_response(system, HZ).values
    right = module.PencilSweep.factor
    monkeypatch.setattr(module.PencilSweep, "factor", lambda self, a, b, c, d: right(self, 5.0 * a, b, 0.2 * c, d))
    assert error(frequency_response(system, HZ).values, expected) < 1e-10


def test_one_analysis_serves_all_blocks(monkeypatch):
    made = []
    sweep = module.PencilSweep
    monkeypatch.setattr(module, "PencilSweep", lambda *parts: made.append(1) or sweep(*parts))
    assert len(list(frequency_response_blocks(bordered(), HZ, block=1))) == 4
    assert made == [1]


def test_free_structures_have_no_response_at_rest():
    """Two masses and a spring between them, at 0 Hz."""
    K = np.array([[1.0, -1.0], [-1.0, 1.0]])
    E, A = np.eye(4), np.block([[np.zeros((2, 2)), np.eye(2)], [-K, np.zeros((2, 2))]])
    free = Descriptor(E, A, np.eye(4)[:, 2:3], np.eye(4)[:1], np.zeros((1, 1)), ["f"], ["x"], name="free")
    with pytest.raises(InputError, match=r"descriptor 'free' is singular at 0 Hz"):
        frequency_response(free, [0.0, 1.0])
    s = 2j * np.pi
    assert frequency_response(free, [1.0]).values.item() == pytest.approx((1 + s**2) / (s**2 * (s**2 + 2)), rel=1e-12)


def test_a_descriptor_without_states_is_its_feedthrough():
    none = Descriptor(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[3.0]], ["u"], ["y"])
    assert DescriptorResponse(none)(HZ).ravel().tolist() == [3.0] * 4
