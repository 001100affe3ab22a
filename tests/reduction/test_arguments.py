"""What is no model, no number and no choice ends in one line that names the remedy, and never in a result."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from structures import chain

import flexplant as fp

ENDS = [(1, "123456"), (6, "123456")]
RATIO = {"damping_ratio": 0.01, "inputs": ["whole.1.1"], "outputs": ["whole.6.1"]}


def component() -> fp.Component:
    return fp.craig_bampton(chain(), ENDS, n_modes=6)


def plant() -> fp.ModalPlant:
    return fp.modal_plant(fp.couple([component()]), **RATIO)


def grounded() -> fp.ModalPlant:
    return fp.modal_plant(fp.couple([component()], [fp.Connection("whole", "ground", pairs=[1])]), **RATIO)


@pytest.mark.parametrize(
    ("call", "remedy"),
    [
        (lambda x: fp.guyan(x, ENDS), "read_model"),
        (lambda x: fp.rubin(x, ENDS, n_modes=2), "read_model"),
        (lambda x: fp.model_to_si(x, "mm-tonne-s"), "read_model"),
        (lambda x: fp.component_to_si(x, "mm-tonne-s"), "craig_bampton"),
        (lambda x: fp.characteristic_constraint_modes(x, ENDS[:1], n_modes=1), "craig_bampton"),
        (fp.check_component, "craig_bampton"),
        (fp.strain_energy, "craig_bampton"),
        (lambda x: fp.expand(x, np.ones(3)), "keep_basis"),
        (lambda x: fp.effective_mass(x, component(), np.ones((18, 1))), "normal_modes"),
        (fp.peak_gains, "modal_plant"),
        (fp.hankel_singular_values, "modal_plant"),
        (lambda x: fp.reduce_modes(x, keep=1), "modal_plant"),
        (lambda x: fp.select(x, inputs=[]), "modal_plant"),
        (lambda x: fp.balanced_truncation(x, order=2), "state_space"),
        (lambda x: fp.renamed(x, name="a"), "state_space"),
        (lambda x: fp.harmonic_response(grounded(), x), "wheel_tones"),
        (fp.loop_gain, "LineOfSight"),
        (fp.closed_loop_transfer, "LineOfSight"),
        (fp.output_sensitivity, "LineOfSight"),
        (fp.line_of_sight_diagram, "LineOfSight"),
        (fp.without_rigid_body, "modal_plant"),
        (lambda x: fp.with_proportional_damping(x, mass_factor=0.1), "read_model"),
        (lambda x: fp.with_dampers(x, []), "read_model"),
        (lambda x: fp.with_interface_node(x, 9, np.zeros(3), [1, 2]), "read_model"),
        (lambda x: fp.with_modal_damping(x, 0.01), "craig_bampton"),
        (lambda x: fp.with_equivalent_viscous_damping(x, 10.0), "craig_bampton"),
        (lambda x: fp.wheel_tones(x, 10.0), "Wheel"),
        (lambda x: fp.rigid_body_vectors(x, chain().dofs), "Nodes"),
    ],
)
def test_another_type_is_named_with_what_makes_the_right_one(call: Callable[[Any], Any], remedy: str) -> None:
    for wrong in (None, "bus.op4", 3.0, [1, 2], np.zeros((2, 2))):
        with pytest.raises(fp.InputError, match=f"got {type(wrong).__name__}.*{remedy}"):
            call(wrong)


BAD_NUMBERS = [-1, -1.5, float("nan"), "300", [300.0], np.ones(2)]


@pytest.mark.parametrize("bad", BAD_NUMBERS, ids=repr)
def test_limits_and_counts_of_reductions_are_numbers(bad: Any) -> None:
    for call in (
        lambda **k: fp.rubin(chain(), ENDS, **k),
        lambda **k: fp.characteristic_constraint_modes(component(), ENDS[:1], **k),
    ):
        for argument in ("max_frequency_hz", "n_modes"):
            with pytest.raises(fp.InputError, match=argument):
                call(**{argument: bad})


@pytest.mark.parametrize("bad", BAD_NUMBERS, ids=repr)
def test_orders_and_numbers_of_modes_are_whole(bad: Any) -> None:
    with pytest.raises(fp.InputError, match="order"):
        fp.balanced_truncation(fp.state_space(grounded()), order=bad)
    with pytest.raises(fp.InputError, match="keep"):
        fp.reduce_modes(plant(), keep=bad)


@pytest.mark.parametrize("bad", [None, 1.0, [1.0, 2.0], [0.0, 0.0, float("nan")], "origin", np.zeros((2, 3))], ids=repr)
def test_points_have_three_finite_coordinates(bad: Any) -> None:
    model = chain()
    with pytest.raises(fp.InputError, match="about"):
        fp.rigid_body_vectors(model.nodes, model.dofs, about=bad)
    with pytest.raises(fp.InputError, match="position"):
        fp.cylindrical_frame(bad, [0.0, 0.0, 0.0], np.eye(3))
    with pytest.raises(fp.InputError, match="origin"):
        fp.cylindrical_frame([1.0, 0.0, 0.0], bad, np.eye(3))


@pytest.mark.parametrize("argument", ["verify_count", "progress", "keep_basis", "recover"])
def test_switches_of_reductions_are_checked(argument: str) -> None:
    with pytest.raises(fp.InputError):
        fp.craig_bampton(chain(), ENDS, n_modes=2, **{argument: "always"})  # type: ignore[arg-type]


def test_a_misspelt_choice_is_refused_also_where_ratios_take_its_place() -> None:
    with pytest.raises(fp.InputError, match="keep"):
        fp.modal_plant(fp.couple([component()]), off_diagonal_damping="kepe", **RATIO)


def test_one_name_is_no_list_of_names() -> None:
    for wrong in ("whole.1.1", 3, [None]):
        with pytest.raises(fp.InputError, match="list of names"):
            fp.select(plant(), inputs=wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("argument", ["threads", "memory_limit", "backend"])
def test_resources_of_the_factorisation_are_checked(argument: str) -> None:
    for bad in (-1, [1], np.ones(2), "many"):
        with pytest.raises(fp.InputError, match=argument):
            fp.craig_bampton(chain(), ENDS, n_modes=2, **{argument: bad})  # type: ignore[arg-type]


def test_ports_of_blocks_are_named() -> None:
    for axes in (None, 3, 1.5):
        for block in (lambda **k: fp.thin_lens(1.5, **k), fp.flat_mirror, lambda **k: fp.angle_sensor(1.5, **k)):
            with pytest.raises(fp.InputError, match="axes"):
                block(axes=axes)
    for signs in (3, ["+", "-"], None):
        with pytest.raises(fp.InputError, match="signs"):
            fp.summing_junction(signs)  # type: ignore[arg-type]


def test_a_step_of_exported_source_is_a_number(tmp_path: Path) -> None:
    with pytest.raises(fp.InputError, match="dt must be a finite number"):
        fp.write_plant(grounded(), tmp_path / "p.c", dt="1ms")


def test_residual_vectors_end_where_the_basis_is_complete():
    model = chain()
    boundary = [(1, "123456")]
    component = fp.craig_bampton(model, boundary, n_modes=2, residual_vectors=10**12)
    assert component.n_boundary + component.n_modal == len(model.dofs)
    with pytest.raises(fp.InputError, match="progress must be a function"):
        fp.rubin(model, boundary, n_modes=2, progress=5)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: fp.wheel_speed_sweep(None, fp.Wheel(amplitude=1.0, harmonics=[1.0]), [1.0]), "cannot simulate a NoneType"),
        (lambda: fp.wheel_speed_sweep(None, "wheel", [1.0]), "wheel_speed_sweep takes a Wheel, got str"),
        (lambda: fp.tone_signal(3, [0.0, 1.0]), "tone_signal takes a Tones, got int"),
        (
            lambda: fp.harmonic_response("plant", fp.Tones(frequency_hz=[1.0], amplitude=[[1.0]], inputs=["u"])),
            "cannot simulate a str",
        ),
    ],
)
def test_sweeps_and_tones_say_what_they_take(call, says):
    with pytest.raises(fp.InputError, match=says):
        call()
