"""Block diagrams: named plants and blocks, wired by named ports, checked before anything runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from flexplant.blocks.sampled import SampledBlock
from flexplant.errors import DiagramError
from flexplant.loop.graph import algebraic_loops, block_stages
from flexplant.loop.ports import Block
from flexplant.loop.wiring import Wiring, wire
from flexplant.model.arrays import FloatArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, output_rows


@dataclass(frozen=True, eq=False, kw_only=True)
class Diagram:
    """Blocks and the wires between them; every check runs here, so a `Diagram` that exists can run.

    blocks: name -> StateSpace, ModalPlant or SampledBlock (nonlinear). Discrete blocks beside continuous ones, or of different
    sample times, make a sampled diagram (`is_sampled`): it can be simulated, but has no single state space.
    connections: ("block.output", "block.input") pairs.
    inputs: external name -> the port, or ports, it drives. outputs: external name -> the port it reads.
    allow_algebraic_loops: closed paths of direct feedthrough are an error unless True; they are then solved for, and must be
    well posed (I - S D regular).

    Raises DiagramError in one line that names the ports: an unknown name (with the nearest), an input driven twice or not
    at all, units that clash (ports without a unit fit any), an algebraic loop.
    """

    blocks: Mapping[str, Block]
    connections: Sequence[tuple[str, str]] = ()
    inputs: Mapping[str, str | Sequence[str]] = field(default_factory=dict)
    outputs: Mapping[str, str] = field(default_factory=dict)
    allow_algebraic_loops: bool = False
    name: str = "diagram"
    wiring: Wiring = field(init=False)

    def __post_init__(self) -> None:
        blocks = dict(self.blocks)
        _check_blocks(blocks)
        inputs = {name: (ports,) if isinstance(ports, str) else tuple(ports) for name, ports in self.inputs.items()}
        object.__setattr__(self, "blocks", blocks)
        object.__setattr__(self, "inputs", inputs)
        object.__setattr__(self, "outputs", dict(self.outputs))
        object.__setattr__(self, "connections", tuple((str(a), str(b)) for a, b in self.connections))
        object.__setattr__(self, "wiring", wire(blocks, self.connections, inputs, self.outputs))
        if not self.allow_algebraic_loops:
            self._check_algebraic_loops()

    def _check_algebraic_loops(self) -> None:
        loops = algebraic_loops(self.wiring, self.feedthrough)
        if loops:
            paths = "; ".join(" -> ".join([*loop, loop[0]]) for loop in loops)
            raise DiagramError(
                f"algebraic loop: {paths}; add a state (a lag, a delay) in it, or set allow_algebraic_loops=True to solve it"
            )

    @property
    def dt(self) -> float | None:
        """The one sample time of its blocks in seconds, or None in continuous time, without states, or for several times."""
        times = set(_sample_times(self.blocks).values())
        return times.pop() if len(times) == 1 and not self.is_sampled else None

    @property
    def is_sampled(self) -> bool:
        """True where blocks are nonlinear or of different sample times, continuous ones included."""
        nonlinear = any(isinstance(block, SampledBlock) for block in self.blocks.values())
        return nonlinear or len(set(_sample_times(self.blocks).values())) > 1

    @property
    def rates(self) -> str:
        """Each block's sample time in words, for messages."""
        times = _sample_times(self.blocks)
        return ", ".join(f"{name}: {'continuous' if dt is None else f'{dt} s'}" for name, dt in times.items())

    @cached_property
    def feedthrough(self) -> FloatArray:
        """(ny, nu) block-diagonal direct feedthrough of all blocks."""
        return block_diagonal([_feedthrough(b) for b in self.blocks.values()])

    @cached_property
    def stages(self) -> list[list[str]]:
        """Block names in the order signals flow; blocks in one feedback loop share a stage."""
        names = list(self.blocks)
        return [[names[k] for k in stage] for stage in block_stages(self.wiring, len(names))]

    @cached_property
    def derived(self) -> dict[str, Any]:
        """What analyses made of this diagram, by their names: it never changes, so they need not make it again."""
        return {}


def _sample_times(blocks: Mapping[str, Block]) -> dict[str, float | None]:
    """Seconds, or None for continuous time, of each block that has a time of its own: a static gain fits any."""
    times = {name: b.dt if isinstance(b, StateSpace) else None for name, b in blocks.items() if not isinstance(b, SampledBlock)}
    return {k: dt for k, dt in times.items() if dt is not None or isinstance(b := blocks[k], ModalPlant) or b.n_states}


def block_diagonal(matrices: Sequence[FloatArray]) -> FloatArray:
    """Block-diagonal matrix that keeps the rows and columns of empty blocks; (0, 0) of no blocks."""
    corners = np.cumsum([(0, 0), *(matrix.shape for matrix in matrices)], axis=0)
    out = np.zeros(corners[-1])
    for matrix, (row, column) in zip(matrices, corners, strict=False):
        out[row : row + matrix.shape[0], column : column + matrix.shape[1]] = matrix
    return out


def _feedthrough(block: Block) -> FloatArray:
    if isinstance(block, SampledBlock):
        return np.ones((len(block.outputs), len(block.inputs)))
    return output_rows(block)[2] if isinstance(block, ModalPlant) else block.D


def _check_blocks(blocks: Mapping[str, Block]) -> None:
    if not blocks:
        raise DiagramError("a diagram needs at least one block; give blocks={'name': block}")
    for name, block in blocks.items():
        if not name or "." in name:
            raise DiagramError(f"block name {name!r}: use a non-empty text without dots, ports are written 'block.port'")
        if not isinstance(block, StateSpace | ModalPlant | SampledBlock):
            raise DiagramError(f"block {name!r} is a {type(block).__name__}; use a StateSpace or a ModalPlant (see state_space)")
