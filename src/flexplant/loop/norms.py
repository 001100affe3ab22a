"""The H-infinity norm of plants, blocks and whole diagrams; large loops are certified on their few channels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flexplant.blocks.sampled import SampledBlock
from flexplant.errors import InputError
from flexplant.loop.bordered import Bordered, bordered
from flexplant.loop.close import close, linear_only
from flexplant.loop.diagram import Diagram
from flexplant.loop.frequency import Linear
from flexplant.loop.loop_bound import LoopAxis
from flexplant.loop.stability import stability
from flexplant.plant.modal import ModalPlant
from flexplant.response import norms
from flexplant.response.interval_bound import Bracket, bracket, polished
from flexplant.response.norms import HinfNorm

SMALL = 120  # states up to which a closed state space and its Hamiltonian are quicker
UNKNOWNS = 80  # of the bordered form, up to which it is worth while


def hinf_norm(system: Linear, *, tolerance: float = 1e-7, unbounded: str = "infinite") -> HinfNorm:
    """The largest singular value over all frequencies of a plant, block or diagram, bracketed to `tolerance` (relative).

    Plants and blocks: see `flexplant.response.norms.hinf_norm`. Diagrams of up to 120 states are closed and go the same way.
    Larger continuous ones keep their plants modal: a matrix over the loop's channels, block states and undamped modes replaces
    the closed state space, its stability is settled by a winding number and its norm by interval bounds (see `loop_bound`), both
    to the round-off of the evaluation. Where this form does not exist (fully damped plants, discrete blocks, more than 80
    unknowns) the diagram is closed.
    unbounded: "infinite" returns inf with an explanation (unstable, on the axis) that names a pole; "error" raises InputError.
    """
    if not isinstance(system, Diagram) or not has_bordered_form(system):
        return norms.hinf_norm(close(system) if isinstance(system, Diagram) else system, tolerance=tolerance, unbounded=unbounded)
    norms.check_request(tolerance, unbounded)
    found = certified(loop_axes(bordered(system)), tolerance)[0]
    if unbounded == "error" and not np.isfinite(found.value):
        raise InputError(f"the norm of {system.name!r} is infinite: {found.explanation}")
    return found


def has_bordered_form(diagram: Diagram) -> bool:
    """False where the diagram is small, or has no bordered form."""
    linear_only(diagram)
    blocks = [block for block in diagram.blocks.values() if not isinstance(block, SampledBlock)]
    plants = [block for block in blocks if isinstance(block, ModalPlant)]
    states = sum(2 * b.n_modes if isinstance(b, ModalPlant) else b.n_states for b in blocks)
    undamped = sum(int(np.count_nonzero(plant.zeta * plant.omega == 0)) for plant in plants)
    unknowns = len(diagram.wiring.input_ports) + states - 2 * sum(plant.n_modes for plant in plants) + undamped
    modal = all(plant.damping is None for plant in plants)
    return states > SMALL and modal and diagram.dt is None and unknowns <= UNKNOWNS


def loop_axes(loop: Bordered, kind: Callable[..., LoopAxis] = LoopAxis) -> tuple[LoopAxis, LoopAxis]:
    """The frequencies up to twice the fastest pole of any block by itself, and those above."""
    poles = np.linalg.eigvals(loop.A) if loop.A.size else np.zeros(0)
    every = np.concatenate([[0.0], abs(poles), loop.omega, *(plant.omega for plant in loop.plants)])
    edge = 2 * float(every.max()) or 1.0
    return kind(loop, edge, high=False), kind(loop, edge, high=True)


def certified(axes: tuple[LoopAxis, LoopAxis], tolerance: float) -> list[HinfNorm]:
    """The norm of each gain of the axes: its stability once, then the peaks of all at once."""
    known, loop = stability(axes), axes[0].loop
    if not known.stable:
        where = 0.0 if known.pole is None else abs(known.pole.imag) / (2 * np.pi)
        return [HinfNorm(np.inf, where, np.inf, np.inf, known.explanation)] * axes[0].n_gains
    return [_norm_of(found, loop.size) for found in polished(axes, bracket(axes, tolerance))]


def _norm_of(found: Bracket, unknowns: int) -> HinfNorm:
    omega = found.t if found.axis == 0 else 1 / found.t if found.t else np.inf
    certificate = f"interval bounds on {unknowns} unknowns ({found.intervals} intervals), stable by winding number"
    return HinfNorm(found.lower, omega / (2 * np.pi), found.lower, found.upper, certificate=certificate)
