"""Closing a diagram: all blocks and wires as one state space."""

from __future__ import annotations

import numpy as np

from flexplant.blocks.sampled import SampledBlock
from flexplant.errors import DiagramError, expect
from flexplant.loop.diagram import Diagram, block_diagonal
from flexplant.model.arrays import FloatArray
from flexplant.plant.state_space import StateSpace, state_space


def close(diagram: Diagram) -> StateSpace:
    """The diagram as one state space from its external inputs w to its external outputs z.

    Blocks stacked: x' = A x + B u, y = C x + D u, wires u = S y + E w, z = R y. With M = (I - S D)^-1:
        x' = (A + B M S C) x + B M E w,   z = R (C + D M S C) x + R D M E w.
    States are those of the blocks (as `state_space` gives them) in the order of `diagram.blocks`.
    Raises DiagramError if an allowed algebraic loop is not well posed (I - S D singular), and for a sampled diagram.
    """
    expect(diagram, Diagram, "close", "plants and blocks are closed as they are: state_space(plant)")
    linear_only(diagram)
    systems = [state_space(block) for block in diagram.blocks.values() if not isinstance(block, SampledBlock)]
    A, B, C, D = (block_diagonal([getattr(s, letter) for s in systems]) for letter in "ABCD")
    wiring = diagram.wiring
    S, E = wiring.internal, wiring.entry
    u_of_x, u_of_w = np.hsplit(solved_wires(diagram, S @ D, np.hstack([S @ C, E])), [C.shape[1]])
    read = wiring.readout
    return StateSpace(
        A + B @ u_of_x,
        B @ u_of_w,
        C[read] + D[read] @ u_of_x,
        D[read] @ u_of_w,
        list(diagram.inputs),
        list(diagram.outputs),
        dt=diagram.dt,
        name=diagram.name,
        input_units=wiring.external_units,
        output_units=[wiring.output_units[k] for k in read],
    )


def linear_only(diagram: Diagram) -> None:
    """DiagramError for a diagram with nonlinear blocks or several sample times, which has no transfer function of its own."""
    nonlinear = [name for name, block in diagram.blocks.items() if isinstance(block, SampledBlock)]
    if nonlinear:
        raise DiagramError(
            f"diagram {diagram.name!r} has nonlinear blocks ({', '.join(nonlinear)}); simulate it, or leave them out"
        )
    if diagram.is_sampled:
        raise DiagramError(
            f"mixed sample times ({diagram.rates}): such a diagram varies in time; discretize(diagram, dt) makes one discrete"
            " system of it, loop_response, frequency_response and simulate take it as it is"
        )


def solved_wires(diagram: Diagram, through: FloatArray, right: FloatArray) -> FloatArray:
    """(I - through)^-1 right, through = S D; DiagramError where an allowed algebraic loop is not well posed."""
    if diagram.allow_algebraic_loops:
        return np.asarray(np.linalg.solve(_well_posed(np.eye(through.shape[0]) - through, diagram), right))
    # without algebraic loops S D is nilpotent, and the finite sum I + S D + (S D)^2 + ... is exact
    return _nilpotent_solve(through, right)


def _nilpotent_solve(N: FloatArray, right: FloatArray) -> FloatArray:
    total, term = right, N @ right
    while term.any():
        total, term = total + term, N @ term
    return total


def _well_posed(matrix: FloatArray, diagram: Diagram) -> FloatArray:
    singular = np.linalg.svd(matrix, compute_uv=False)
    if singular.size and singular[-1] <= singular[0] * matrix.shape[0] * np.finfo(float).eps:
        raise DiagramError(
            f"diagram {diagram.name!r}: its algebraic loop is not well posed (I - S D is singular: a loop gain of exactly one); "
            "change a gain in it or add a state"
        )
    return matrix
