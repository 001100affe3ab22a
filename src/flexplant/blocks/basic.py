"""Static blocks (gain, summing junction) and the renaming of a state space that is to serve as a block."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from flexplant.errors import InputError, expect
from flexplant.model.arrays import is_finite, real_values
from flexplant.plant.fields import checked_names
from flexplant.plant.state_space import StateSpace


def static(
    D: npt.ArrayLike,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    name: str = "gain",
    input_units: Sequence[str] = (),
    output_units: Sequence[str] = (),
) -> StateSpace:
    """y = D u without states; D: (ny, nu) in the order of `outputs` and `inputs`. ModelError for shapes that disagree."""
    matrix = real_values(D, f"{name!r:.60}: gains")
    none = np.zeros((0, 0))
    return StateSpace(
        none,
        np.zeros((0, len(inputs))),
        np.zeros((len(outputs), 0)),
        matrix,
        inputs,
        outputs,
        name=name,
        input_units=input_units,
        output_units=output_units,
    )


def gain(
    factor: npt.ArrayLike,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    name: str = "gain",
    input_units: Sequence[str] = (),
    output_units: Sequence[str] = (),
) -> StateSpace:
    """y = K u: a number (ports "u", "y"), a vector (one factor a channel, diagonal K) or a (ny, nu) matrix.

    Ports default to "u", "y", or "u1", "u2", ... and "y1", "y2", ... InputError for more than two dimensions.
    """
    given = real_values(factor, f"gain {name!r:.60}")
    if given.ndim > 2:
        raise InputError(f"gain {name!r:.60}: factor has shape {given.shape}; use a number, a vector or a (ny, nu) matrix")
    matrix = given if given.ndim == 2 else np.diag(np.atleast_1d(given))
    ny, nu = matrix.shape
    return static(
        matrix,
        inputs=_numbered("u", nu) if inputs is None else checked_names(inputs, "inputs", f"gain {name!r:.60}"),
        outputs=_numbered("y", ny) if outputs is None else checked_names(outputs, "outputs", f"gain {name!r:.60}"),
        name=name,
        input_units=input_units,
        output_units=output_units,
    )


def _numbered(stem: str, count: int) -> list[str]:
    return [stem] if count == 1 else [f"{stem}{k}" for k in range(1, count + 1)]


def summing_junction(
    signs: str | Mapping[str, float], *, output_name: str = "sum", unit: str = "", name: str = "sum"
) -> StateSpace:
    """y = sum of signed inputs, all of one unit.

    signs: "+-" (ports "in1", "in2"), or a mapping such as {"reference": 1, "measured": -1} whose keys name the ports.
    Raises InputError for a sign other than + and -, and for no input at all.
    """
    if isinstance(signs, str):
        if not signs or set(signs) - set("+-"):
            raise InputError(f"summing junction {name!r:.60}: signs {signs!r:.60}; use a text of + and -, such as '+-'")
        signs = {f"in{k}": 1.0 if sign == "+" else -1.0 for k, sign in enumerate(signs, 1)}
    if not isinstance(signs, Mapping) or not signs:
        raise InputError(f"summing junction {name!r} has no inputs; give signs such as {{'reference': 1, 'measured': -1}}")
    for port, sign in signs.items():
        if not is_finite(sign):
            raise InputError(f"summing junction {name!r:.60}: sign {sign!r:.60} of {port!r:.60}; give a number such as 1 or -1")
    return static(
        [list(signs.values())],
        inputs=list(signs),
        outputs=[output_name],
        name=name,
        input_units=[unit] * len(signs),
        output_units=[unit],
    )


def renamed(
    system: StateSpace,
    *,
    name: str | None = None,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    input_units: Sequence[str] | None = None,
    output_units: Sequence[str] | None = None,
) -> StateSpace:
    """The same state space under other port names or units: the way an outside model becomes a block."""
    expect(system, StateSpace, "renamed", "state_space(plant) makes one")
    return replace(
        system,
        name=system.name if name is None else name,
        inputs=system.inputs if inputs is None else inputs,
        outputs=system.outputs if outputs is None else outputs,
        input_units=system.input_units if input_units is None else input_units,
        output_units=system.output_units if output_units is None else output_units,
    )
