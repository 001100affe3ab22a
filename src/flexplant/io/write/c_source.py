"""A plant as C99 source without any dependency: `<name>.c` and `<name>.h`, fixed size, no heap, single or double precision.

Modal plants run as one 2x2 recursion a mode, others as blocks of two states where they can be taken apart (`block_form`),
else as x[k+1] = A x[k] + B u[k]. Exact for inputs that are constant over a step (hold="zero": what a digital controller's
output does) or linear between samples (hold="first"). Any C99 compiler; -DNAME_REAL=float for single precision.
"""

from __future__ import annotations

from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from flexplant.errors import InputError, expect_choice
from flexplant.io.formats import Writer
from flexplant.io.parse.own_plant import Plant
from flexplant.io.write.atomic import replacing
from flexplant.io.write.block_form import BlockForm, DenseForm, described, export_form, sampled_blocks
from flexplant.io.write.c_templates import BLOCKS, DENSE, HEADER, MODAL, VELOCITY_TERMS
from flexplant.io.write.c_text import comment, constants, definition, identifier, string
from flexplant.model.arrays import FloatArray, is_number
from flexplant.plant.discretize import HOLDS, discretize, mode_steps
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, output_rows

MEANING = {"zero": "inputs held over a step", "first": "inputs linear between samples, from zero over the step before the first"}


def write_plant(
    plant: Plant, path: Path, *, target: Path, dt: float | None = None, hold: str = "zero", name: str | None = None
) -> None:
    """The source at `path`, the header beside `target` (where the source will be).

    dt: sample time, seconds; a discrete StateSpace has its own. hold: "zero" or "first", of a continuous plant's inputs.
    name: prefix of all C names, None for the file's stem.
    Raises InputError where dt is missing, for a plant without inputs or outputs, or a descriptor with a singular E.
    """
    header, source = c_files(plant, dt, identifier(name or target.stem), target.with_suffix(".h").name, hold)
    path.write_text(source, encoding="utf-8")
    with replacing(target.with_suffix(".h")) as work:
        work.write_text(header, encoding="utf-8")


def c_files(plant: Plant, dt: float | None, prefix: str, header_name: str, hold: str = "zero") -> tuple[str, str]:
    """Text of the header and of the source."""
    form = export_form(plant)
    step = _sample_time(plant, dt)
    expect_choice(hold, HOLDS, "hold")
    if form.dt is not None and hold != "zero":
        raise InputError(f"plant {plant.name!r} is discrete, so its inputs are held; leave out hold={hold!r}")
    if isinstance(plant, ModalPlant) and plant.damping is None:
        code, data = MODAL, _modal_data(plant, step, hold)
    elif isinstance(form, BlockForm):
        code, data = BLOCKS, _block_data(form if form.dt is not None else sampled_blocks(form, step, hold))
    else:
        code, data = DENSE, _dense_data(form, plant, step, hold)
    words = _words(plant, prefix, step, len(next(iter(data.values())))) | {
        "header_name": header_name,
        "hold": MEANING[hold],
        "how": described(form),
    }
    words["velocity_terms"] = Template(VELOCITY_TERMS).substitute(words) if "velocity_out" in data else ""
    tables = "".join(definition(f"{prefix}_real", f"{prefix}_{k}", v) for k, v in data.items())
    return Template(HEADER).substitute(words), Template(code).substitute(words | {"tables": tables})


def _sample_time(plant: Plant, dt: float | None) -> float:
    own = plant.dt if isinstance(plant, StateSpace) else None
    if own is not None and dt is not None and abs(own - dt) > 1e-12 * own:
        raise InputError(f"plant {plant.name!r} is discrete with dt = {own} s, so it cannot be written for dt = {dt!r:.60} s")
    chosen = own or dt
    if chosen is None:
        raise InputError("C source runs at a fixed step: give dt= (or --dt) in seconds, for example dt=1e-4")
    if not is_number(chosen) or not 0 < chosen < np.inf:
        raise InputError(f"dt = {dt!r}: the sample time must be a positive number of seconds")
    return float(chosen)


def _modal_data(plant: ModalPlant, dt: float, hold: str) -> dict[str, FloatArray]:
    """Tables of the modal recursion; a plant without modes gets one that never moves."""
    steps = mode_steps(plant.omega, plant.zeta, dt, hold)
    position, velocity, direct = output_rows(plant)
    f, h = steps.transition, steps.hold
    if steps.ramp is not None:  # the state is x - ramp u, as in `discretize`
        h = h + np.einsum("nij,nj->ni", f, steps.ramp) - steps.ramp
        direct = direct + (position * steps.ramp[:, 0] + velocity * steps.ramp[:, 1]) @ plant.shape_in
    drive = {"h0": h[:, 0], "h1": h[:, 1], "shape_in": plant.shape_in}
    return _recursion(f, drive, position.T, velocity.T) | {"direct": direct}


def _block_data(form: BlockForm) -> dict[str, FloatArray]:
    """Tables of blocks of two states."""
    drive = {"first_in": form.b[:, 0], "second_in": form.b[:, 1]}
    return _recursion(form.a, drive, form.c[:, 0], form.c[:, 1]) | {"direct": form.d}


def _recursion(f: FloatArray, drive: dict[str, FloatArray], position: FloatArray, velocity: FloatArray) -> dict[str, FloatArray]:
    transition = {f"f{i}{j}": f[:, i, j] for i in (0, 1) for j in (0, 1)}
    rows = {"position_out": position} | ({"velocity_out": velocity} if velocity.any() else {})
    tables = {k: v if len(v) else np.zeros((1, *v.shape[1:])) for k, v in (transition | drive | rows).items()}
    return tables | {k: tables[k].T for k in drive}


def _dense_data(form: DenseForm, plant: Plant, dt: float, hold: str) -> dict[str, FloatArray]:
    if form.dt is not None:
        return {"a": form.a, "b": form.b, "c": form.c, "direct": form.d}
    sampled = discretize(plant, dt, hold=hold)
    return {"a": sampled.A, "b": sampled.B, "c": sampled.C, "direct": sampled.D}


def _words(plant: Plant, prefix: str, dt: float, states: int) -> dict[str, Any]:
    """What the templates take."""
    upper = prefix.upper()
    words: dict[str, Any] = {"p": prefix, "P": upper, "dt": repr(dt), "n": states, "title": comment(plant.name)}
    for kind, names, units in (
        ("input", plant.inputs, plant.input_units),
        ("output", plant.outputs, plant.output_units),
    ):
        words[f"{kind}_count"] = len(names)
        listed = zip(constants(f"{upper}_{kind}", names), names, units, strict=True)
        words[f"{kind}_constants"] = ",\n".join(
            f"  {constant} = {i}{_remark(name, unit)}" for i, (constant, name, unit) in enumerate(listed)
        )
        words[f"{kind}_names"] = ",\n  ".join(string(name) for name in names)
    return words


def _remark(name: str, unit: str) -> str:
    return f" /* {comment(name)}{f' [{comment(unit)}]' if unit else ''} */"


WRITER = Writer(
    name="c_source",
    description="C99 source and header, no dependency",
    suffixes=(".c",),
    tested_against="gcc 12, clang 14: -std=c99 -Wall -Wextra -Wpedantic -Wconversion -Werror",
    beside=lambda target: (target.with_suffix(".h"),),
    writers={"write_plant": write_plant},
)
