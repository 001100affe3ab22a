"""A plant as a Julia file for ControlSystems.jl: `include("plant.jl")` gives `plant_system()` and the channels' names.

Numbers are the shortest text that gives the same double. Modal plants are stored by modes and expanded in Julia.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexplant.io.formats import Writer
from flexplant.io.parse.own_plant import Plant
from flexplant.io.write.c_text import comment, identifier
from flexplant.io.write.ownership import mark
from flexplant.model.arrays import dense
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, output_rows

NAME = "julia"
HEAD = """\
# {title}. {mark}.
#   using ControlSystemsBase; include("{file}"); sys = {name}_system(); bodeplot(sys)
#   {name}_inputs, {name}_outputs: names of the channels, in the order of the columns and rows.
"""


def write_plant(plant: Plant, path: Path, *, target: Path) -> None:
    """The file: arrays, names, and a function that builds `ss` (or `dss` of DescriptorSystems.jl)."""
    name = identifier(target.stem)
    lines = [HEAD.format(mark=mark(NAME), title=comment(plant.name), file=target.name, name=name)]
    lines += [f"const {name}_{kind} = [{', '.join(map(_string, getattr(plant, kind)))}]" for kind in ("inputs", "outputs")]
    arrays, body = _modal(plant) if isinstance(plant, ModalPlant) else _first_order(plant)
    lines += [f"const {name}_{key} = {_matrix(value)}" for key, value in arrays.items()]
    lines += [f"function {name}_system()", *(f"    {line}".replace("@", f"{name}_") for line in body), "end", ""]
    path.write_text("\n".join(lines), encoding="utf-8")


def _modal(plant: ModalPlant) -> tuple[dict[str, Any], list[str]]:
    position, velocity, direct = output_rows(plant)
    arrays = {"omega": plant.omega[:, None], "damping": plant.damping_matrix, "shape_in": plant.shape_in}
    arrays |= {"position_out": position, "velocity_out": velocity, "direct": direct}
    n = plant.n_modes
    body = [
        f"I = [i == j ? 1.0 : 0.0 for i in 1:{n}, j in 1:{n}]",
        f"A = [zeros({n}, {n}) I; -(I .* @omega .^ 2) -@damping]",
        "B = [zero(@shape_in); @shape_in]",
        "return ss(A, B, [@position_out @velocity_out], @direct)",
    ]
    return arrays, body


def _first_order(plant: Any) -> tuple[dict[str, Any], list[str]]:
    names = "ABCDE" if isinstance(plant, Descriptor) else "ABCD"
    arrays = {key: dense(getattr(plant, key)) for key in names}
    if isinstance(plant, Descriptor):
        return arrays, ["return dss(@A, @E, @B, @C, @D)"]
    return arrays, ["return ss(@A, @B, @C, @D)" if plant.dt is None else f"return ss(@A, @B, @C, @D, {plant.dt!r})"]


def _string(text: str) -> str:
    return '"' + "".join(f"\\{c}" if c in '"\\$' else c for c in text if c.isprintable()) + '"'


def _matrix(values: Any) -> str:
    given = np.atleast_2d(np.asarray(values, dtype=float))
    if not given.size:
        return f"zeros({given.shape[0]}, {given.shape[1]})"
    rows = ";\n ".join(" ".join(repr(float(v)) for v in row) for row in given)
    return f"reshape([{rows}], {given.shape[0]}, {given.shape[1]})"


WRITER = Writer(
    name=NAME,
    description="Julia file for ControlSystems.jl",
    suffixes=(".jl",),
    tested_against="the parser of Julia 1.13, the Julia grammar of tree-sitter; Octave for its arithmetic",
    writers={"write_plant": write_plant},
)
