"""A plant as C99 source without any dependency: `<name>.c` and `<name>.h`, fixed size, no heap, single or double precision.

Modal plants run as one 2x2 recursion a mode, exact for inputs that are constant over a step (zero-order hold); others as
x[k+1] = A x[k] + B u[k] of `discretize`. Compile with any C99 compiler; -DNAME_REAL=float for single precision.
"""

from __future__ import annotations

from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from flexplant.errors import InputError
from flexplant.io.formats import Writer
from flexplant.io.parse.own_plant import Plant
from flexplant.io.write.atomic import replacing
from flexplant.io.write.c_templates import DENSE, HEADER, MODAL, VELOCITY_TERMS
from flexplant.io.write.c_text import comment, constants, definition, identifier, string
from flexplant.model.arrays import FloatArray
from flexplant.plant.discretize import discretize, mode_steps
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace, output_rows


def write_plant(plant: Plant, path: Path, *, target: Path, dt: float | None = None, name: str | None = None) -> None:
    """The source at `path`, the header beside `target` (where the source will be).

    dt: sample time, seconds; a discrete StateSpace has its own. name: prefix of all C names, None for the file's stem.
    Raises InputError where dt is missing, or for a plant without inputs or outputs.
    """
    header, source = c_files(plant, dt, identifier(name or target.stem), target.with_suffix(".h").name)
    path.write_text(source, encoding="utf-8")
    with replacing(target.with_suffix(".h")) as work:
        work.write_text(header, encoding="utf-8")


def c_files(plant: Plant, dt: float | None, prefix: str, header_name: str) -> tuple[str, str]:
    """Text of the header and of the source."""
    if not isinstance(plant, ModalPlant | StateSpace | Descriptor):
        raise InputError(f"a ModalPlant, StateSpace or Descriptor can be written as C source, not {type(plant).__name__}")
    if not plant.inputs or not plant.outputs:
        raise InputError(f"plant {plant.name!r}: C source needs at least one input and one output")
    step = _sample_time(plant, dt)
    modal = isinstance(plant, ModalPlant) and plant.damping is None
    data, states = _modal_data(plant, step) if isinstance(plant, ModalPlant) and modal else _dense_data(plant, step)
    words = _words(plant, prefix, step, states) | {"header_name": header_name}
    code = Template(MODAL if modal else DENSE)
    words["velocity_terms"] = Template(VELOCITY_TERMS).substitute(words) if "velocity_out" in data else ""
    tables = "".join(definition(f"{prefix}_real", f"{prefix}_{k}", v) for k, v in data.items())
    return Template(HEADER).substitute(words), code.substitute(words | {"tables": tables})


def _sample_time(plant: Plant, dt: float | None) -> float:
    own = plant.dt if isinstance(plant, StateSpace) else None
    if own is not None and dt is not None and abs(own - dt) > 1e-12 * own:
        raise InputError(f"plant {plant.name!r} is discrete with dt = {own} s, so it cannot be written for dt = {dt} s")
    chosen = own or dt
    if chosen is None:
        raise InputError("C source runs at a fixed step: pass dt= in seconds, for example write_plant(plant, 'plant.c', dt=1e-4)")
    if not 0 < float(chosen) < np.inf:
        raise InputError(f"dt = {dt!r}: the sample time must be a positive number of seconds")
    return float(chosen)


def _modal_data(plant: ModalPlant, dt: float) -> tuple[dict[str, FloatArray], int]:
    """Tables of the modal recursion; a plant without modes gets one that never moves."""
    steps = mode_steps(plant.omega, plant.zeta, dt, "zero")
    position, velocity, direct = output_rows(plant)
    n = max(plant.n_modes, 1)
    flat = {
        **{f"f{i}{j}": steps.transition[:, i, j] for i in (0, 1) for j in (0, 1)},
        "h0": steps.hold[:, 0],
        "h1": steps.hold[:, 1],
    }
    rows = {"position_out": position.T} | ({"velocity_out": velocity.T} if velocity.any() else {})
    tables = {k: _padded(v, n) for k, v in (flat | rows).items()}
    return tables | {"shape_in": _padded(plant.shape_in, n).T, "direct": direct}, n


def _padded(values: FloatArray, n: int) -> FloatArray:
    return values if len(values) == n else np.zeros((n, *values.shape[1:]))


def _dense_data(plant: Plant, dt: float) -> tuple[dict[str, FloatArray], int]:
    discrete = plant if isinstance(plant, StateSpace) and plant.dt is not None else discretize(plant, dt)
    n = max(discrete.n_states, 1)
    if discrete.n_states == 0:
        A, B, C = np.zeros((1, 1)), np.zeros((1, len(plant.inputs))), np.zeros((len(plant.outputs), 1))
    else:
        A, B, C = discrete.A, discrete.B, discrete.C
    return {"a": A, "b": B, "c": C, "d": discrete.D}, n


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
    tested_against="gcc 12 -O3 -std=c99 -Wall -Werror",
    writers={"write_plant": write_plant},
)
