"""Margins of a loop gain: by eigenvalue pencils where it is small, by refined evaluation of its modal sums where it is large."""

from __future__ import annotations

from dataclasses import replace

from flexplant.blocks.basic import gain
from flexplant.errors import InputError
from flexplant.loop.diagram import Diagram
from flexplant.loop.loop_response import loop_margins
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace
from flexplant.response import margins as dense
from flexplant.response.margins import Margins

LARGE = 200  # states above which the pencils, four times that size, take minutes


def margins(loop_gain: StateSpace | ModalPlant) -> Margins:
    """Margins of the loop gain L under negative feedback u = r - L u, as many inputs as outputs, paired in order.

    Up to 200 states crossings come from eigenvalues and none is missed (`flexplant.response.margins.margins`). Above, the loop is
    closed as a diagram and goes the way of `loop_margins`: crossings from a refined grid, then exact to round-off.
    Raises InputError for a loop gain that is not square, or for which I + L is singular at infinite frequency.
    """
    if isinstance(loop_gain, Diagram):
        raise InputError("margins takes a loop gain; loop_margins(diagram, at=[signals]) breaks a diagram's loop")
    states = 2 * loop_gain.n_modes if isinstance(loop_gain, ModalPlant) else getattr(loop_gain, "n_states", 0)
    if states <= LARGE or len(loop_gain.inputs) != len(loop_gain.outputs):
        return dense.margins(loop_gain)
    pairs = list(zip(loop_gain.outputs, loop_gain.inputs, strict=True))
    minus = gain(
        [-1.0] * len(pairs), inputs=[f"in{k}" for k in range(len(pairs))], outputs=[f"out{k}" for k in range(len(pairs))]
    )
    wires = [(f"L.{y}", f"minus.in{k}") for k, (y, _) in enumerate(pairs)]
    wires += [(f"minus.out{k}", f"L.{u}") for k, (_, u) in enumerate(pairs)]
    blocks = {"L": loop_gain, "minus": minus}
    diagram = Diagram(blocks=blocks, connections=wires, allow_algebraic_loops=True, name=loop_gain.name)
    found = loop_margins(diagram, [f"L.{y}" for y, _ in pairs])
    return replace(found, loops=tuple(replace(loop, channel=y) for loop, (y, _) in zip(found.loops, pairs, strict=True)))
