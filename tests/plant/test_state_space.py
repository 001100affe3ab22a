"""The plant types: their checks, and the ways between modal, descriptor and state-space forms and other packages."""

from __future__ import annotations

import control
import numpy as np
import pytest
import scipy.signal

from flexplant.errors import InputError, ModelError
from flexplant.plant.conversion import from_control, from_scipy, to_control, to_scipy
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace, state_space
from flexplant.response.frequency import frequency_response

HZ = np.array([0.4, 3.0, 17.0])


def plant(**changes) -> ModalPlant:
    rng = np.random.default_rng(1)
    given = {
        "omega": [0.0, 20.0, 21.0, 90.0],
        "zeta": 0.01,
        "shape_in": rng.normal(size=(4, 2)),
        "shape_out": rng.normal(size=(3, 4)),
        "shape_out_velocity": rng.normal(size=(3, 4)),
        "shape_out_acceleration": rng.normal(size=(3, 4)),
        "feedthrough": rng.normal(size=(3, 2)),
        "static_correction": rng.normal(size=(3, 2)),
        "inputs": ["f.1", "f.2"],
        "outputs": ["x", "y", "z"],
    }
    return ModalPlant(**(given | changes))


def test_single_degree_of_freedom_in_state_space_is_the_textbook_form():
    w, zeta, m = 3.0, 0.2, 2.0
    sdof = ModalPlant(
        omega=[w],
        zeta=[zeta],
        shape_in=[[1 / np.sqrt(m)]],
        shape_out_acceleration=[[1 / np.sqrt(m)]],
        inputs=["f"],
        outputs=["a"],
    )
    s = state_space(sdof)
    assert np.allclose(s.A, [[0, 1], [-(w**2), -2 * zeta * w]])
    assert np.allclose(s.C, np.array([[-(w**2), -2 * zeta * w]]) / np.sqrt(m))
    assert np.allclose(s.D, 1 / m)
    response = frequency_response(sdof, HZ).values[0, 0]
    iw = 2j * np.pi * HZ
    assert np.allclose(response, iw**2 / m / (iw**2 + 2 * zeta * w * iw + w**2), rtol=1e-13)


@pytest.mark.parametrize("full", [False, True])
def test_modal_and_state_space_responses_agree(full):
    damping = np.diag([0.0, 0.4, 0.5, 2.0]) + 0.1 * (np.ones((4, 4)) - np.eye(4)) * np.outer([0, 1, 1, 1], [0, 1, 1, 1])
    modal = plant(damping=damping if full else None)
    a, b = frequency_response(modal, HZ).values, frequency_response(state_space(modal), HZ).values
    assert abs(a - b).max() < 1e-11 * abs(a).max()


def test_descriptor_of_regular_e_becomes_state_space():
    rng = np.random.default_rng(2)
    E, A = rng.normal(size=(5, 5)) + 4 * np.eye(5), rng.normal(size=(5, 5)) - 4 * np.eye(5)
    d = Descriptor(E, A, rng.normal(size=(5, 1)), rng.normal(size=(2, 5)), np.ones((2, 1)), ["u"], ["y", "z"])
    a, b = frequency_response(d, HZ).values, frequency_response(state_space(d), HZ).values
    assert abs(a - b).max() < 1e-12 * abs(a).max()


def test_singular_e_is_refused_with_the_way_out():
    d = Descriptor(np.diag([1.0, 0.0]), -np.eye(2), np.ones((2, 1)), np.ones((1, 2)), np.zeros((1, 1)), ["u"], ["y"])
    with pytest.raises(InputError, match=r"E is singular.*modal_plant"):
        state_space(d)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"shape_in": np.ones((3, 2))}, r"4 modes, 2 inputs, 3 outputs\): shape_in has shape \(3, 2\), but \(4, 2\)"),
        ({"shape_out": np.full((3, 4), np.nan)}, r"shape_out has an entry that is not finite"),
        ({"omega": [0.0, 1.0, -2.0, 3.0]}, r"omega: entry 2 .* is -2"),
        ({"zeta": [0.1, 0.1]}, r"zeta has shape \(2,\), but \(4,\)"),
        ({"zeta": -0.1}, r"zeta: entry 0"),
        ({"zeta": "light"}, r"zeta: real numbers"),
        ({"shape_in": None}, r"shape_in has shape \(\)"),
        ({"inputs": None}, r"inputs must be a list of names, got NoneType"),
        ({"output_units": "mmm"}, r"output_units must be a list of texts.*got 'mmm'"),
        ({"damping": np.triu(np.ones((4, 4)))}, r"damping matrix is not symmetric"),
        ({"outputs": ["x", "x", "z"]}, r"outputs listed twice: x"),
        ({"inputs": "fg"}, r"inputs must be a list"),
        ({"output_units": ["m"]}, r"1 output_units for 3 channels"),
    ],
)
def test_modal_plant_says_what_does_not_fit(changes, message):
    with pytest.raises(ModelError, match=message):
        plant(**changes)


def test_state_space_says_what_does_not_fit():
    eye, one = np.eye(2), np.ones((2, 1))
    with pytest.raises(ModelError, match=r"2 states, 1 inputs, 1 outputs\): C has shape \(2, 1\), but \(1, 2\)"):
        StateSpace(eye, one, one, np.zeros((1, 1)), ["u"], ["y"])
    with pytest.raises(ModelError, match=r"dt = -1"):
        StateSpace(eye, one, one.T, np.zeros((1, 1)), ["u"], ["y"], dt=-1.0)
    with pytest.raises(ModelError, match=r"dt = 'fast'"):
        StateSpace(eye, one, one.T, np.zeros((1, 1)), ["u"], ["y"], dt="fast")
    with pytest.raises(ModelError, match=r"descriptor 'plant': A has shape \(\)"):
        Descriptor(1.0, 2.0, 3.0, 4.0, 5.0, ["u"], ["y"])
    with pytest.raises(ModelError, match=r"A has shape"):
        StateSpace(np.ones((2, 3)), one, one.T, np.zeros((1, 1)), ["u"], ["y"])
    with pytest.raises(InputError, match="got int"):
        state_space(3)


def test_plants_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        plant().shape_in[0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        state_space(plant()).A[0, 0] = 1.0


def test_python_control_computes_the_same_response_and_comes_back():
    s = state_space(plant())
    converted = to_control(s)
    assert converted.input_labels == ["f_1", "f_2"]
    theirs = converted(2j * np.pi * HZ)
    ours = frequency_response(s, HZ).values
    assert abs(theirs - ours).max() < 1e-10 * abs(ours).max()
    back = from_control(converted, inputs=s.inputs, outputs=s.outputs)
    assert back.inputs == s.inputs
    assert all(np.array_equal(getattr(back, k), getattr(s, k)) for k in "ABCD")


def test_conversions_keep_the_sample_time():
    discrete = StateSpace(0.5 * np.eye(1), np.eye(1), np.eye(1), np.eye(1), ["u"], ["y"], dt=0.25)
    assert from_control(to_control(discrete)).dt == 0.25
    assert from_scipy(to_scipy(discrete)).dt == 0.25
    with pytest.raises(InputError, match="unspecified sample time"):
        from_control(control.ss(0.5, 1, 1, 0, True))


def test_scipy_systems_of_any_form():
    s = from_scipy(scipy.signal.TransferFunction([1.0], [1.0, 0.4, 9.0]))
    _, theirs = scipy.signal.freqresp(scipy.signal.TransferFunction([1.0], [1.0, 0.4, 9.0]), 2 * np.pi * HZ)
    assert np.allclose(frequency_response(s, HZ).values[0, 0], theirs, rtol=1e-12)
    assert (s.inputs, s.outputs) == (("u1",), ("y1",))


def test_conversions_refuse_other_things():
    with pytest.raises(InputError, match="'plant' has no inputs"):
        to_control(StateSpace(-np.eye(1), np.zeros((1, 0)), [[1.0]], np.zeros((1, 0)), [], ["y"]))
    with pytest.raises(InputError, match="more zeros than poles"):
        from_control(control.tf([1, 0, 0], [1, 1]))
    with pytest.raises(InputError, match="from_control needs"):
        from_control(3.0)
    with pytest.raises(InputError, match="from_scipy needs"):
        from_scipy(3.0)
    clash = plant(inputs=["f.1", "f_1"])
    with pytest.raises(InputError, match="two inputs become 'f_1'"):
        to_control(clash)
