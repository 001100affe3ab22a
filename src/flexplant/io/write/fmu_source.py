"""The C source of an FMU: numbers of the plant, then the C of `fmu_c`, in one file that any C99 compiler takes."""

from __future__ import annotations

from importlib.resources import files

import numpy as np

from flexplant.io.parse.own_plant import Plant
from flexplant.io.write.block_form import BlockForm, DenseForm, described
from flexplant.io.write.c_text import comment, definition, string
from flexplant.model.arrays import FloatArray

HEAD = """\
/* {title}. FMI {version}.0 co-simulation of a plant, written by flexplant. Needs a C99 compiler and nothing else.
   {how} */
#define TOKEN "@token@"
#define SAMPLED {sampled}
#define SAMPLE_TIME {dt}
#define SAMPLE_TIME_TEXT "{dt}"
#define FIRST_ROWS_DRIVEN {first}
#define ARRAYS {arrays}
enum {{ BLOCKS = {blocks}, STATES = {states}, INPUTS = {nu}, OUTPUTS = {ny} }};

"""


def fmu_source(plant: Plant, form: BlockForm | DenseForm, version: int, arrays: bool) -> str:
    """The C file, with @token@ still to be filled in."""
    blocks = isinstance(form, BlockForm)
    size = max(len(form.a), 1)
    parts = ["state.c", "blocks.c" if blocks else "dense.c", "steps.c", f"fmi{version}.c"]
    when = "exact for inputs that are held or linear over a step" if form.dt is None else f"sampled every {form.dt!r} s"
    head = HEAD.format(
        title=comment(plant.name),
        version=version,
        how=f"{described(form)}; {when}.",
        sampled=int(form.dt is not None),
        dt=repr(form.dt or 1.0),
        first=int(blocks and bool(form.b[:, 0].any())),
        arrays=int(arrays),
        blocks=size if blocks else 0,
        states=2 * size if blocks else size,
        nu=len(plant.inputs),
        ny=len(plant.outputs),
    )
    tables = "".join(definition("double", name, values) for name, values in _tables(form).items())
    texts = _texts(plant) if version == 3 else ""
    folder = files(__package__) / "fmu_c"
    return head + tables + texts + "".join((folder / part).read_text(encoding="utf-8") for part in parts)


def _tables(form: BlockForm | DenseForm) -> dict[str, FloatArray]:
    """Constant arrays; a plant without states gets states that never move."""
    if isinstance(form, DenseForm):
        return {"dense_a": form.a, "dense_b": form.b, "dense_c": form.c, "direct": form.d}
    a, b, c = (v if len(v) else np.zeros((1, *v.shape[1:])) for v in (form.a, form.b, form.c))
    tables = {"block_a": a.transpose(1, 2, 0), "block_b1": b[:, 1].T, "block_c0": c[:, 0].T, "block_c1": c[:, 1].T}
    return tables | ({"block_b0": b[:, 0].T} if b[:, 0].any() else {}) | {"direct": form.d}


def _texts(plant: Plant) -> str:
    listed = {
        "input_names": plant.inputs, "input_units": plant.input_units,
        "output_names": plant.outputs, "output_units": plant.output_units,
    }  # fmt: skip
    lines = [f"static const char *const {k}[] = {{{', '.join(string(t) for t in texts)}}};\n" for k, texts in listed.items()]
    return "".join(lines) + "\n"
