"""Structural damping: the unreduced solution against the full modal sum, and against a closed form."""

import numpy as np
import pytest
import scipy.sparse as sp

from flexplant.errors import InputError, ModelError
from flexplant.model.component import FiniteElementModel
from flexplant.plant.modal import ModalPlant
from flexplant.response.structural import direct_response, structural_response

N = 12


def chain() -> FiniteElementModel:
    """Free chain of unequal masses and springs."""
    k = 1e4 * (1 + np.arange(N - 1) / 7)
    difference = np.diff(np.eye(N), axis=0)
    stiffness = difference.T @ (k[:, None] * difference)
    mass = np.diag(1 + np.arange(N) / 5)
    dofs = [(i + 1, 1) for i in range(N)]
    return FiniteElementModel(name="chain", mass=sp.csr_array(mass), stiffness=sp.csr_array(stiffness), dofs=dofs)


def modal_sum(keep: int) -> ModalPlant:
    """The chain's first modes, the rest as static correction."""
    model = chain()
    root = 1 / np.sqrt(model.mass.diagonal())
    omega2, vectors = np.linalg.eigh(root[:, None] * model.stiffness.toarray() * root)
    shapes, omega = root[:, None] * vectors, np.sqrt(np.maximum(omega2, 0))
    omega[0] = 0.0
    rest = shapes[:, keep:] / omega[keep:] ** 2
    return ModalPlant(
        omega=omega[:keep], zeta=0.0, shape_in=shapes[[0], :keep].T, shape_out=shapes[[0, N - 1], :keep],
        static_correction=rest[[0, N - 1]] @ shapes[[0], keep:].T, inputs=["force"], outputs=["near", "far"],
    )  # fmt: skip


def test_unreduced_solution_equals_the_sum_over_all_modes():
    hz = np.linspace(0.5, 40, 25)
    done: list[int] = []
    direct = direct_response(
        chain(), inputs=[(1, 1)], outputs=[(1, 1), (N, 1)], frequency_hz=hz, structural_damping=0.02, each=done.append
    )
    modal = structural_response(modal_sum(N), hz, 0.02)
    np.testing.assert_allclose(direct.values, modal.values, rtol=1e-9, atol=1e-12 * abs(modal.values).max())
    assert done == list(range(1, 26))


def test_static_correction_leaves_an_error_of_second_order_in_frequency():
    exact, cut = modal_sum(N), modal_sum(6)
    low = np.array([0.1, 0.2, 0.4])
    error = abs(structural_response(exact, low, 0.01).values - structural_response(cut, low, 0.01).values)[1, 0]
    np.testing.assert_allclose(np.log2(error[1:] / error[:-1]), 2.0, atol=0.01)


def test_one_degree_of_freedom_at_resonance():
    plant = ModalPlant(omega=[10.0], zeta=0.0, shape_in=[[1.0]], shape_out=[[1.0]], inputs=["u"], outputs=["y"])
    peak = structural_response(plant, 10 / (2 * np.pi), 0.01).values[0, 0, 0]
    assert peak == pytest.approx(1 / (1j * 0.01 * 100), rel=1e-12)


def test_what_has_no_answer_is_refused():
    with pytest.raises(InputError, match="0 Hz"):
        structural_response(modal_sum(N), [0.0, 1.0], 0.01)
    with pytest.raises(ModelError, match="no DOF 1-2"):
        direct_response(chain(), inputs=[(1, 2)], outputs=[(1, 1)], frequency_hz=[1.0])
