"""MATLAB's second-order names M, C, K, B, F, G, D: as a plant, and as a model with a sidecar."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from flexplant.errors import ReadError
from flexplant.io import read_component, read_plant, write_plant
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, state_space
from flexplant.response.frequency import frequency_response

RNG = np.random.default_rng(8)
PLANT = ModalPlant(
    omega=[0.0, 2.0, 5.0], zeta=[0.0, 0.1, 0.02], shape_in=RNG.standard_normal((3, 2)), shape_out=RNG.standard_normal((1, 3)),
    shape_out_velocity=RNG.standard_normal((1, 3)), feedthrough=RNG.standard_normal((1, 2)), inputs=["a", "b"], outputs=["y"],
)  # fmt: skip
HZ = [0.1, 0.4, 3.0]


def test_second_order_and_first_order_matrices_are_the_same_plant(tmp_path: Path) -> None:
    second = {"M": np.eye(3), "C": PLANT.damping_matrix, "K": sp.csc_matrix(np.diag(PLANT.omega**2)), "B": PLANT.shape_in}
    second |= {"F": PLANT.shape_out, "G": PLANT.shape_out_velocity, "D": PLANT.direct}
    scipy.io.savemat(tmp_path / "mech.mat", second)
    expected = frequency_response(PLANT, HZ).values
    unnamed, named = read_plant(tmp_path / "mech.mat"), read_plant(write_plant(PLANT, tmp_path / "first.mat"))
    assert (tuple(unnamed.inputs), tuple(named.inputs)) == (("u1", "u2"), ("a", "b"))
    for plant in (unnamed, named):
        np.testing.assert_allclose(frequency_response(plant, HZ).values, expected, rtol=1e-10)


@pytest.mark.parametrize("order", ["C", "F"])
def test_modal_plants_come_back_as_such_whatever_the_order_of_their_arrays(tmp_path: Path, order: str) -> None:
    """D of acceleration outputs is a product, whose last digit depends on the order; the modes come back bit by bit."""
    rng = np.random.default_rng(5)
    for seed in range(20):
        shapes = {
            "shape_in": rng.standard_normal((12, 1)),
            "shape_out": rng.standard_normal((2, 12)),
            "shape_out_acceleration": rng.standard_normal((2, 12)),
            "damping": np.diag(rng.random(12)) + 0.01,
        }
        given = ModalPlant(
            omega=np.r_[0.0, np.sort(rng.uniform(1, 900, 11))],
            zeta=0.01,
            **{k: np.array(v, order=order) for k, v in shapes.items()},
            inputs=["f"],
            outputs=["y", "z"],
        )
        back = read_plant(write_plant(given, tmp_path / f"p{seed}.mat"))
        assert isinstance(back, ModalPlant)
        for name in ("omega", "zeta", *shapes):
            np.testing.assert_array_equal(getattr(back, name), getattr(given, name))


def test_matrices_that_were_changed_are_no_modes_any_more(tmp_path: Path) -> None:
    path = write_plant(PLANT, tmp_path / "p.mat")
    stored = {k: v for k, v in scipy.io.loadmat(path).items() if not k.startswith("__")}
    stored["D"] = stored["D"] * (1 + 1e-9)
    scipy.io.savemat(path, stored)
    back = read_plant(path)
    assert isinstance(back, StateSpace)
    np.testing.assert_array_equal(back.D, stored["D"])


def test_discrete_plants_keep_their_step_and_bits(tmp_path: Path) -> None:
    given = StateSpace(*(getattr(state_space(PLANT), k) for k in "ABCD"), inputs=["a", "b"], outputs=["y"], dt=0.25)
    back = read_plant(write_plant(given, tmp_path / "z.mat"))
    assert isinstance(back, StateSpace)
    assert back.dt == 0.25
    np.testing.assert_array_equal(back.A, given.A)


def test_names_and_units_of_channels_come_back(tmp_path: Path) -> None:
    """From cells of either shape and from char arrays, compressed or not; channels without a name get one."""
    names = ["bus.101.1", "rad.\u00e4.x"]
    given = ModalPlant(
        omega=[3.0], zeta=0.01, shape_in=np.ones((1, 2)), shape_out=np.ones((1, 1)), inputs=names, outputs=["optic.9.2:v"],
        input_units=["N", "N"], output_units=["m/s"], name="jitter",
    )  # fmt: skip
    back = read_plant(write_plant(given, tmp_path / "p.mat"))
    assert (tuple(back.inputs), tuple(back.outputs), back.name) == (tuple(names), ("optic.9.2:v",), "jitter")
    assert (tuple(back.input_units), tuple(back.output_units)) == (("N", "N"), ("m/s",))
    matrices = {"A": -np.eye(1), "B": np.ones((1, 2)), "C": np.ones((2, 1)), "D": np.zeros((2, 2))}
    rows = np.empty((1, 2), dtype=object)
    rows[0, :] = ["left", ""]
    for compress in (False, True):
        texts = {"InputName": rows, "OutputName": np.array(["dish  ", "mirror"])}
        scipy.io.savemat(tmp_path / "q.mat", matrices | texts, do_compression=compress)
        plant = read_plant(tmp_path / "q.mat")
        assert (tuple(plant.inputs), tuple(plant.outputs)) == (("left", "u2"), ("dish", "mirror"))


@pytest.mark.parametrize(("names", "message"), [(["a", "b", "c"], "3 names for 2 inputs"), (["a", "a"], "listed twice: a")])
def test_names_that_do_not_fit_are_an_error(tmp_path: Path, names: list[str], message: str) -> None:
    cells = np.empty((len(names), 1), dtype=object)
    cells[:, 0] = names
    matrices = {"A": -np.eye(1), "B": np.ones((1, 2)), "C": np.ones((1, 1)), "D": np.zeros((1, 2)), "InputName": cells}
    scipy.io.savemat(tmp_path / "q.mat", matrices)
    with pytest.raises(ReadError, match=message):
        read_plant(tmp_path / "q.mat")


def test_a_sidecar_needs_no_names_for_m_c_k(tmp_path: Path) -> None:
    half = RNG.standard_normal((8, 8))
    scipy.io.savemat(tmp_path / "part.mat", {"M": np.eye(8), "K": half + half.T, "C": np.eye(8) * 0.1})
    (tmp_path / "part.yaml").write_text('boundary: [[1, "123456"]]\n')
    component = read_component(tmp_path / "part.mat")
    assert (component.n_modal, component.damping[0, 0]) == (2, 0.1)
    np.testing.assert_array_equal(component.stiffness, half + half.T)


def test_what_is_no_plant_says_what_it_has(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "x.mat", {"Q": np.eye(2)})
    with pytest.raises(ReadError, match=r"needs A, B, C, D or M, C, K, B, F, G, D; it has Q"):
        read_plant(tmp_path / "x.mat")
    scipy.io.savemat(tmp_path / "x.mat", {"M": np.eye(2), "K": np.eye(3), "B": np.ones((2, 1))})
    with pytest.raises(ReadError):
        read_plant(tmp_path / "x.mat")
