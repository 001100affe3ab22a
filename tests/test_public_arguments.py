"""Every argument of every public name refuses what is wrong for it, in one line of our own and never with a bare traceback.

Each argument is given each of the values of `WRONG` in turn, the others being right. Most are wrong for it; `TAKEN` lists those
that are right (a port may be called "nosuch", a gain may be -1), and that nothing else is taken, silently, is what is tested.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from public_calls import Call, all_calls

import flexplant as fp
from flexplant.errors import LONGEST

WRONG: dict[str, Any] = {
    "none": None,
    "true": True,
    "text": "nosuch",
    "blank": "",
    "lines": "a\nb",
    "long": "x" * 2_000,
    "-1": -1,
    "0": 0,
    "1.5": 1.5,
    "1e30": 10**30,
    "1e400": 10**400,
    "inf": np.inf,
    "nan": np.nan,
    "1j": 1j,
    "empty": [],
    "of none": [None],
    "ragged": ["a", ["b"]],
    "set": {1},
    "dict": {"a": 1},
    "object": object(),
    "cube": np.ones((2, 5, 3)),
    "0-d": np.array("x"),
}

# labels of values, and the calls with their arguments that take just these
TAKEN = """
[none]
Component: damping nodes structural_damping modal_ids; FiniteElementModel: damping nodes; Nodes: frames;
rigid_body_vectors: placement; Recovery: displacement velocity acceleration; craig_bampton: progress backend;
craig_bampton by accuracy: accuracy; rubin: progress backend; with_dampers of one: b;
with_interface_node averaged: weights; Connection: nodes; couple: placements; normal_modes: n_modes; Reference: shapes;
strain_energy: placement; verify: reference modes; estimate_error: modes n_modes;
ModalPlant: shape_out shape_out_velocity shape_out_acceleration damping static_correction feedthrough;
modal_plant: n_modes; modal_plant of modes: modes; from_control: inputs outputs; from_scipy: inputs outputs;
GainSweep at: out; white_noise_rms: intensity; frequency_response: out; line_of_sight_diagram: plant;
simulate: inputs progress initial; simulate tones: inputs progress initial; simulate_stream: inputs progress initial;
gain: inputs outputs; renamed: inputs outputs; convert: format units read_options; inspect: format units;
mode_view: numbers; plausibility: found; read_component: format units; read_display_mesh: format units;
read_geometry: format units; read_reference: units; read_response_functions: units; read_model: format units;
run_study: progress; plot: output input
[text, long]
Component: name units; FiniteElementModel: name units; Recovery: name; UnitSystem: name; Reference: source;
ModalPlant: name; modal_plant: name; descriptor: name; Descriptor: name; StateSpace: name; from_scipy: name; Diagram: name;
gain: name; summing_junction: output_name name; proportional: name; pade_delay: input_name output_name name;
sample_delay: input_name output_name name; steering_mirror: name; angle_sensor: name; line_of_sight_geometry: name;
thin_lens: name; flat_mirror: name; pid: input_name output_name name; dead_zone: name; saturation: name; quantiser: name;
rate_limiter: name; user_block: name; transfer_function: input_name output_name name; expansion: recovery;
mode_view: recovery
[empty]
Component: recovery; characteristic_constraint_modes: keep; craig_bampton: recover loads; guyan: recover;
rubin: recover loads; with_dampers: dampers; couple: connections; Modes: labels; CheckReport: checks tables notes;
Reference: names; ModalPlant: input_units output_units; modal_plant: inputs outputs; modal_plant of modes: inputs outputs;
descriptor: inputs outputs; Descriptor: input_units output_units; StateSpace: input_units output_units;
structural_frequency_response: inputs outputs; line_of_sight_diagram: signals; gain: input_units output_units;
user_block: input_units output_units; convert: drop; write_plant: sources; mode_view: labels
[true]
write_results of pieces: append; Check: passed;
craig_bampton: keep_basis error_estimate; guyan: keep_basis; rubin: keep_basis error_estimate;
modal_plant: static_correction; reduce_modes: static_correction; random_response: cross; Diagram: allow_algebraic_loops;
line_of_sight_diagram: closed commands; convert: overwrite; write_component: basis overwrite; write_model: overwrite;
write_plant: overwrite; write_plant as FMU: arrays; write_results: overwrite; run_study: allow_outside
[1.5, 1e30]
with_equivalent_viscous_damping: frequency_hz; UnitSystem: length mass mass_factor;
craig_bampton by size: max_frequency_hz; discretize: dt; adaptive_grid: high_hz; wheel_speed_sweep: omega_hz;
wheel_speed_sweep of cases: omega_hz; LineOfSight: mirror_omega; simulate_stream: dt; sample_delay: dt;
steering_mirror: omega; pid: filter_time; quantiser: step; Wheel: harmonics; wheel_disturbance: omega_hz;
wheel_tones: omega_hz; write_plant as C: dt
[0, 1.5, 1e30]
with_modal_damping: ratio; with_dampers of one: c; with_proportional_damping: mass_factor stiffness_factor;
Reference: rigid_below_hz; verify: frequency_tolerance mac_minimum reduction_error; ModalPlant: zeta; reduce_modes to: tolerance;
balanced_truncation to: tolerance; singular_values: frequency_hz; structural_frequency_response: frequency_hz;
frequency_response: frequency_hz; frequency_response_blocks: frequency_hz; LineOfSight: mirror_zeta; pade_delay: seconds;
steering_mirror: zeta
[text, blank, long]
Recovery: units; summing_junction: unit; pade_delay: unit; sample_delay: unit; pid: input_unit output_unit;
dead_zone: unit; saturation: unit; quantiser: unit; rate_limiter: unit; transfer_function: input_unit output_unit
[-1, 0, 1.5, 1e30]
GainSweep at: gain; LineOfSight: gain; simulate_stream: start; gain: factor; summing_junction of one: sign;
proportional: gains; pid: kp ki kd; transfer_function: numerator; Wheel: amplitude phase_rad
[none, 1.5, 1e30]
verify: max_frequency_hz;
characteristic_constraint_modes: max_frequency_hz; craig_bampton: max_frequency_hz; rubin: max_frequency_hz;
StateSpace: dt; quantiser: dt; user_block: dt; transfer_function: dt; write_plant as FMU: dt
[none, 0, 1.5, 1e30]
craig_bampton: damping_ratio structural_damping; rubin: damping_ratio; Connection: tolerance; modal_plant: damping_ratio;
loop_response: frequency_hz; read_component: damping
[0]
with_interface_node: node; with_interface_node averaged: node; Modes: n_rigid; verify: rigid_body_modes;
reduce_modes: keep; balanced_truncation: order; sample_delay: samples
[none, text, long]
Connection: name; from_control: name; renamed: name; convert: name; read_component: name; read_model: name;
read_reference: component; plot: title
[none, empty]
select: inputs outputs; simulate: outputs; simulate tones: outputs; renamed: input_units output_units
[none, 0]
characteristic_constraint_modes: n_modes; craig_bampton: threads n_modes; rubin: threads n_modes
[-1, 1.5, 1e30]
LineOfSight: focal_length; angle_sensor: focal_length; line_of_sight_geometry: focal_length; thin_lens: focal_length;
transfer_function: denominator
[dict]
Component: source; FiniteElementModel: source; ModalPlant: report source; StateSpace: source;
Descriptor: source; Reference: provenance; summing_junction: signs
[1.5]
craig_bampton by accuracy: max_frequency_hz; adaptive_grid: low_hz per_decade
[none, 1.5, 1e30, inf]
normal_modes: max_frequency_hz; estimate_error: max_frequency_hz; modal_plant: max_frequency_hz
[text, blank, lines, long]
Check: name unit explanation
[none, text, blank, lines, long]
write_plant as C: name; write_plant as FMU: name; run_study: output
[none, 1e30, inf]
craig_bampton: memory_limit; rubin: memory_limit
[none, 1e30, 1e400]
craig_bampton by size: size; frequency_response_blocks: block
[text, lines, long]
Connection: a b
[none, -1, 0, 1.5, 1e30]
Connection: stiffness damping
[-1, 0, 1.5, 1e30, inf, nan]
Check: value limit
[-1]
bandwidth_hz: level_db; rate_limiter: fall
[-1, 0]
dead_zone: low; saturation: low
[-1, 0, 1.5, 1e30, inf]
dead_zone: high; saturation: high
[-1, 0, 1.5, 1e30, empty]
tone_signal: time; wheel_disturbance: time
[0, 1e30, 1e400]
craig_bampton: residual_vectors
[none, true]
craig_bampton: verify_count
[1e30, inf]
characteristic_interface to: max_frequency_hz
[-1, 0, 1.5]
crossing_hz: level_db
[1.5, 1e30, inf]
rate_limiter: rise
[none, -1, 0, 1.5, 1e30, empty]
user_block: initial
[0, 1.5]
Tones: frequency_hz
[1e30]
read_component option: max_bytes
"""

NO_CALLS = {"UNIT_SYSTEMS", "System"}  # a table; what `couple` makes
NOT_TRIED = {"write_options", "options"}  # the options of formats, which are tried by their own names
PUBLIC = sorted(name for name, home in fp._WHERE.items() if home != "errors" and name not in NO_CALLS)


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Call]]:
    """Every call, in a folder where "nosuch" is no file."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("calls"))
        yield all_calls(Path.cwd())


@cache
def taken() -> dict[str, set[str]]:
    """ "call: argument" -> labels of the values that it takes."""
    found: dict[str, set[str]] = {}
    for line in TAKEN.strip().splitlines():
        if line.startswith("["):
            labels = set(line[1:-1].split(", "))
            continue
        for name, _, arguments in (part.strip().partition(": ") for part in line.split(";") if part.strip()):
            for argument in arguments.split():
                assert f"{name}: {argument}" not in found, "listed twice"
                found[f"{name}: {argument}"] = labels
    return found


def refusal(function: Callable[..., object], arguments: dict[str, Any]) -> str | None:
    """The text of our own error, None where the arguments are taken; any other exception fails the test."""
    try:
        function(**arguments)
    except fp.FlexplantError as error:
        text = str(error)
        assert text, "an error without a word"
        assert "\n" not in text
        assert len(text) <= LONGEST
        return text
    return None


@pytest.mark.parametrize("name", PUBLIC)
def test_every_argument_refuses_what_is_wrong_for_it(name: str, calls: dict[str, Call]) -> None:
    mine = {call: parts for call, parts in calls.items() if call.split()[0] == name}
    for call, (function, right) in mine.items():
        without = refusal(function, right)  # None, but for files that are not there
        assert without is None or "no such file" in without.lower()
        for argument in right:
            found = {label for label, value in WRONG.items() if refusal(function, {**right, argument: value}) == without}
            assert found == taken().get(f"{call}: {argument}", set()), f"{call}: {argument}"


@pytest.mark.parametrize("name", PUBLIC)
def test_every_argument_is_tried(name: str, calls: dict[str, Call]) -> None:
    tried = {argument for call, (_, right) in calls.items() if call.split()[0] == name for argument in right}
    new = set(inspect.signature(getattr(fp, name)).parameters) - tried - NOT_TRIED
    assert not new, "give it a right value in public_calls.py, and what it takes of the wrong ones above"


def test_the_table_names_calls_that_are_there(calls: dict[str, Call]) -> None:
    assert set(taken()) <= {f"{call}: {argument}" for call, (_, right) in calls.items() for argument in right}
    assert {call.split()[0] for call in calls} == set(PUBLIC)


@pytest.mark.parametrize("port", ["", "a\nb"])
def test_each_port_of_a_list_has_a_name_in_one_line(port: str) -> None:
    with pytest.raises(fp.InputError, match="inputs must be names"):
        fp.gain(1.0, inputs=[port])
