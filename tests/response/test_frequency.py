"""Frequency responses: closed forms, agreement of all routes, exactness at the edges, bad frequencies."""

from __future__ import annotations

import control
import numpy as np
import pytest
import xarray as xr
from threadpoolctl import threadpool_limits

from flexplant.errors import InputError
from flexplant.plant.discretize import discretize
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace, state_space
from flexplant.response import coupled_modes
from flexplant.response.frequency import frequency_response, frequency_response_blocks


def modal(n=20, *, rigid=2, full=0.0, zeta=0.005, seed=0) -> ModalPlant:
    rng = np.random.default_rng(seed)
    omega = np.r_[np.zeros(rigid), np.sort(rng.uniform(5, 3000, n - rigid))]
    damping = None
    if full:
        X = rng.normal(size=(n, n)) / np.sqrt(n)
        size = np.sqrt(2 * zeta * omega)
        damping = np.outer(size, size) * (np.eye(n) + full * X @ X.T)
    return ModalPlant(
        omega=omega,
        zeta=zeta,
        damping=damping,
        shape_in=rng.normal(size=(n, 3)),
        shape_out=rng.normal(size=(4, n)) * np.array([1, 0, 0, 1])[:, None],
        shape_out_velocity=rng.normal(size=(4, n)) * np.array([0, 1, 0, 1])[:, None],
        shape_out_acceleration=rng.normal(size=(4, n)) * np.array([0, 0, 1, 1])[:, None],
        static_correction=rng.normal(size=(4, 3)) * 1e-6,
        inputs=list("abc"),
        outputs=["d", "v", "a", "all"],
        input_units=["N"] * 3,
        output_units=["m", "m/s", "m/s^2", ""],
    )


def second_order(plant: ModalPlant, hz) -> np.ndarray:
    """The defining equation, solved frequency by frequency."""
    out = np.empty((4, 3, len(hz)), dtype=complex)
    for k, w in enumerate(2 * np.pi * np.asarray(hz)):
        dynamic = np.diag(plant.omega**2 - w**2) + 1j * w * plant.damping_matrix
        eta = np.linalg.solve(dynamic, plant.shape_in)
        rows = plant.shape_out + 1j * w * plant.shape_out_velocity - w**2 * plant.shape_out_acceleration
        out[:, :, k] = rows @ eta + plant.direct
    return out


def error(a, b) -> float:
    return float((abs(np.asarray(a) - b).max(axis=(1, 2)) / abs(b).max(axis=(1, 2))).max())


def as_descriptor(s: StateSpace) -> Descriptor:
    rng = np.random.default_rng(8)
    T = rng.normal(size=s.A.shape) + 5 * np.eye(s.n_states)
    return Descriptor(T, T @ s.A, T @ s.B, s.C, s.D, s.inputs, s.outputs)


@pytest.mark.parametrize("rigid", [0, 2])
@pytest.mark.parametrize("full", [0.0, 0.7])
def test_modal_state_space_and_descriptor_agree_with_the_definition(rigid, full):
    plant = modal(rigid=rigid, full=full)
    hz = np.geomspace(0.5, 900, 1500)
    expected = second_order(plant, hz)
    assert error(frequency_response(plant, hz), expected) < 1e-11
    assert error(frequency_response(state_space(plant), hz), expected) < 1e-9
    some = hz[::100]
    assert error(frequency_response(as_descriptor(state_space(plant)), some), expected[:, :, ::100]) < 1e-9


def test_damped_rigid_mode_and_defective_damping_fall_back():
    plant = modal(4, rigid=1, full=0.5)
    damping = plant.damping + 3 * np.outer([1, 0.2, 0, 0], [1, 0.2, 0, 0])
    grounded = ModalPlant(
        omega=plant.omega,
        zeta=0.0,
        damping=damping,
        shape_in=plant.shape_in,
        shape_out=plant.shape_out,
        shape_out_velocity=plant.shape_out_velocity,
        shape_out_acceleration=plant.shape_out_acceleration,
        inputs=plant.inputs,
        outputs=plant.outputs,
    )
    hz = np.geomspace(0.1, 300.0, 30)
    assert error(frequency_response(grounded, hz), second_order(grounded, hz)) < 1e-12
    turned = np.array([[0.8, -0.6], [0.6, 0.8]])
    critical = ModalPlant(
        omega=[4.0, 4.0],
        zeta=1.0,
        damping=turned @ np.diag([8.0, 2.0]) @ turned.T,  # a double pole at -4 without two eigenvectors
        shape_in=np.ones((2, 3)),
        shape_out=np.ones((4, 2)),
        shape_out_velocity=np.ones((4, 2)),
        shape_out_acceleration=np.ones((4, 2)),
        inputs=plant.inputs,
        outputs=plant.outputs,
    )
    hz = np.geomspace(0.01, 10, 40)
    assert error(frequency_response(critical, hz), second_order(critical, hz)) < 1e-12


@pytest.mark.parametrize("slow", [0.0, 1e-5, 1e-3, 0.1, 3.0])
@pytest.mark.parametrize("loosely", [False, True])
def test_near_rigid_modes_that_damping_couples_keep_twelve_digits(slow, loosely, monkeypatch):
    """Against a solution a frequency; round-off of the fast modes, 1e-12 of them, is 1e-7 of poles at 1e-5 rad/s."""
    rng, n = np.random.default_rng(5), 24
    omega = np.r_[slow * (1 + 0.1 * np.arange(6)), 2 * np.pi * np.geomspace(1, 2000, n - 6)]
    X, size = rng.normal(size=(n, n)), np.sqrt(2 * 0.01 * np.maximum(omega, 1e-3 if loosely else 1.0))
    kinds = {f"shape_out{kind}": rng.normal(size=(2, n)) for kind in ("", "_velocity", "_acceleration")}
    damping = np.outer(size, size) * (X @ X.T) / n
    forces = rng.normal(size=(n, 2))
    plant = ModalPlant(omega=omega, zeta=0.0, damping=damping, shape_in=forces, inputs=["f", "g"], outputs=["x", "y"], **kinds)
    hz, solved, solution = np.geomspace(1e-3, 2e4, 200), [], coupled_modes._solved
    monkeypatch.setattr(coupled_modes, "_solved", lambda plant, w: (solved.append(w.size), solution(plant, w))[1])
    found = frequency_response(plant, hz).values
    assert max(solved) <= coupled_modes.FEW, "poles and residues do it, without a solution at every frequency"
    for k in range(0, hz.size, 7):
        w = 2 * np.pi * hz[k]
        eta = np.linalg.solve(np.diag((omega - w) * (omega + w)) + 1j * w * damping, forces)
        terms = [(1j * w) ** order * shapes for order, shapes in enumerate(kinds.values())]
        assert (abs(found[:, :, k] - sum(terms) @ eta) < 1e-12 * sum(abs(c) @ abs(eta) for c in terms)).all()


def test_any_number_of_threads_gives_the_same_bits():
    """Poles of coupled modes and of state spaces: LAPACK's eigenvalues differ in their last digits where BLAS splits its sums."""
    plant, hz = modal(70, rigid=0, full=0.7), np.geomspace(1, 500, 100)
    for form in (plant, state_space(plant)):
        found = []
        for threads in (1, 3):
            with threadpool_limits(threads):
                found.append(frequency_response(form, hz).values)
        assert np.array_equal(*found)


def test_python_control_agrees():
    s = state_space(modal(8))
    hz = np.geomspace(1, 400, 40)
    theirs = control.ss(s.A, s.B, s.C, s.D)(2j * np.pi * hz)
    assert error(frequency_response(s, hz), theirs) < 1e-9


def test_discrete_response_is_that_of_the_z_transform():
    d = discretize(modal(6), 1e-4)
    hz = np.array([3.0, 70.0, 800.0])
    theirs = control.ss(d.A, d.B, d.C, d.D, 1e-4)(np.exp(2j * np.pi * hz * 1e-4))
    assert error(frequency_response(d, hz), theirs) < 1e-9


def test_axes_names_and_units_travel():
    response = frequency_response(modal(), [1, 2, 3])
    assert response.dims == ("output", "input", "frequency")
    assert list(response["frequency"].values) == [1.0, 2.0, 3.0]
    assert response["frequency"].attrs["units"] == "Hz"
    assert response.sel(output="v")["output_units"] == "m/s"
    assert response.sel(input="b", output="a", frequency=2.0).dtype == complex


def test_static_response_with_rigid_body_modes():
    plant = modal(rigid=2)
    with pytest.raises(InputError, match=r"response of 'd' to 'a' is infinite at 0 Hz: rigid-body mode [01] "):
        frequency_response(plant, [0.0, 1.0])
    rows = plant.shape_out.copy()
    rows[:, :2] = 0.0  # a relative motion: rigid-body modes do not show
    seen = ModalPlant(
        omega=plant.omega, zeta=plant.zeta, shape_in=plant.shape_in, shape_out=rows, inputs=plant.inputs, outputs=plant.outputs
    )
    static = frequency_response(seen, [0.0]).values[:, :, 0]
    assert np.allclose(static, (rows[:, 2:] / plant.omega[2:] ** 2) @ plant.shape_in[2:], rtol=1e-13)
    accelerations = ModalPlant(
        omega=plant.omega,
        zeta=plant.zeta,
        shape_in=plant.shape_in,
        shape_out_acceleration=plant.shape_out_acceleration,
        inputs=plant.inputs,
        outputs=plant.outputs,
    )
    static = frequency_response(accelerations, [0.0]).values[:, :, 0]
    assert np.allclose(static, plant.shape_out_acceleration[:, :2] @ plant.shape_in[:2], rtol=1e-13)


def test_low_frequency_accelerations_keep_their_digits():
    """-w^2 eta, not (1 - ...) cancelled through the feedthrough: 1 mHz against a 1 kHz mode."""
    plant = ModalPlant(
        omega=[2e3 * np.pi], zeta=[0.01], shape_in=[[1.0]], shape_out_acceleration=[[1.0]], inputs=["f"], outputs=["a"]
    )
    response = frequency_response(plant, [1e-3]).values.item()
    ratio = 1e-6
    assert response.real == pytest.approx(-(ratio**2) * (1 + ratio**2), rel=1e-13)


def test_frequency_exactly_on_an_undamped_mode_names_it():
    plant = ModalPlant(
        omega=[5.0, 20 * np.pi],
        zeta=[0.01, 0.0],
        shape_in=np.ones((2, 1)),
        shape_out=np.ones((1, 2)),
        inputs=["f"],
        outputs=["x"],
    )
    with pytest.raises(InputError, match=r"10 Hz lies exactly on mode 1 "):
        frequency_response(plant, [1.0, 10.0])
    assert np.isfinite(frequency_response(plant, [10.0 + 1e-9])).all()
    with pytest.raises(InputError, match=r"undamped pole at (10|9.99999999|10.0000000)"):
        frequency_response(state_space(plant), [1.0, 10.0])
    integrator = StateSpace(np.zeros((1, 1)), np.eye(1), np.eye(1), np.zeros((1, 1)), ["u"], ["y"])
    with pytest.raises(InputError, match="undamped pole at 0 Hz"):
        frequency_response(integrator, [0.0])
    with pytest.raises(InputError, match="singular at 0 Hz"):
        frequency_response(Descriptor(np.eye(1), np.zeros((1, 1)), np.eye(1), np.eye(1), np.zeros((1, 1)), ["u"], ["y"]), [0.0])


@pytest.mark.parametrize(
    ("hz", "message"),
    [
        ([], "non-empty"),
        ([1.0, -2.0], "entry 1 is -2"),
        ([np.nan], "entry 0 is nan"),
        ([np.inf], "inf"),
        ([1.0, 2.0, 5.0, 4.0, 3.0], r"entry 3 is 4 after 5; frequencies must ascend: use np\.sort"),
        ([[1.0, 2.0]], r"shape \(1, 2\)"),
        (2j * np.pi * np.array([1.0, 2.0]), "frequency_hz: real numbers"),
        ("10", "frequency_hz: real numbers"),
        ({"from": 1.0}, "frequency_hz: real numbers"),
    ],
)
def test_bad_frequencies(hz, message):
    for plant in (modal(4), state_space(modal(4)), as_descriptor(state_space(modal(4)))):
        with pytest.raises(InputError, match=message):
            frequency_response(plant, hz)


def test_other_objects_and_static_gains():
    with pytest.raises(InputError, match="got str"):
        frequency_response("plant", [1.0])
    static = StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((2, 0)), [[1.0], [2.0]], ["u"], ["y", "z"])
    assert np.array_equal(frequency_response(static, [1.0, 5.0]).values[:, 0], [[1, 1], [2, 2]])


def test_repeated_frequencies_are_allowed():
    response = frequency_response(modal(), [1.0, 1.0, 2.0]).values
    assert np.array_equal(response[:, :, 0], response[:, :, 1])


@pytest.mark.parametrize("kind", ["modal", "full", "state space", "descriptor"])
def test_given_memory_and_blocks_hold_the_same_response(kind):
    plant = modal(full=0.5 if kind == "full" else 0.0)
    plant = {"state space": state_space, "descriptor": lambda p: as_descriptor(state_space(p))}.get(kind, lambda p: p)(plant)
    hz = np.geomspace(1.0, 400.0, 67)
    whole, memory = frequency_response(plant, hz), np.full((4, 3, 67), np.nan, dtype=complex)
    written = frequency_response(plant, hz, out=memory)
    assert np.shares_memory(written.values, memory)
    assert np.array_equal(memory, whole.values)
    for block in (None, 1, 30, 67, 500):
        parts = list(frequency_response_blocks(plant, hz, block=block))
        assert [part.sizes["frequency"] for part in parts[:-1]] == [block] * (len(parts) - 1)
        joined = xr.concat(parts, dim="frequency")
        assert np.array_equal(joined["frequency"], hz)
        assert error(joined.transpose(*whole.dims).values, whole.values) < 1e-13


@pytest.mark.parametrize(
    "memory",
    [
        np.empty((4, 3, 2), dtype=complex),
        np.empty((4, 3, 3)),
        np.empty((3, 3, 4), dtype=complex).T,
        np.broadcast_to(np.zeros(1, dtype=complex), (4, 3, 3)),
        [1.0],
    ],
)
def test_memory_that_cannot_hold_the_response(memory):
    with pytest.raises(InputError, match=r"must be a writable C-contiguous complex128 array \(4, 3, 3\)"):
        frequency_response(modal(), [1.0, 2.0, 3.0], out=memory)


@pytest.mark.parametrize("block", [0, -1, 2.5, True])
def test_bad_block_sizes(block):
    with pytest.raises(InputError, match="positive whole number"):
        frequency_response_blocks(modal(), [1.0, 2.0], block=block)


def test_frequencies_of_blocks_are_checked_at_once():
    with pytest.raises(InputError, match="ascend"):
        frequency_response_blocks(modal(), [2.0, 1.0])
