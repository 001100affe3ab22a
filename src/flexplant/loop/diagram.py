"""Block diagrams: named plants and blocks, wired by named ports, checked before anything runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from flexplant.blocks.sampled import SampledBlock
from flexplant.errors import DiagramError, expect_text
from flexplant.loop.graph import algebraic_loops, block_stages
from flexplant.loop.ports import Block
from flexplant.loop.wiring import Wiring, wire
from flexplant.model.arrays import FloatArray, checked_switch, items_of
from flexplant.model.describe import count, listed, paragraph
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, output_rows


@dataclass(frozen=True, eq=False, kw_only=True)
class Diagram:
    """Blocks and the wires between them; every check runs here, so a `Diagram` that exists can run.

    blocks: name -> StateSpace, ModalPlant or SampledBlock (nonlinear). Discrete blocks beside continuous ones, or of different
    sample times, make a sampled diagram (`is_sampled`): it has margins, a response and a discrete form, but varies in time.
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
        expect_text(self.name, "diagram: name")
        checked_switch(self.allow_algebraic_loops, "diagram: allow_algebraic_loops")
        blocks, inputs, outputs = (_named(getattr(self, kind), kind) for kind in ("blocks", "inputs", "outputs"))
        _check_blocks(blocks)
        inputs = {name: _ports(ports, name) for name, ports in inputs.items()}
        for name, port in outputs.items():
            _expect_port(port, f"output {name!r}")
        object.__setattr__(self, "blocks", blocks)
        object.__setattr__(self, "inputs", inputs)
        object.__setattr__(self, "outputs", outputs)
        object.__setattr__(self, "connections", _wires(self.connections))
        object.__setattr__(self, "wiring", wire(blocks, self.connections, inputs, outputs))
        if not self.allow_algebraic_loops:
            self._check_algebraic_loops()

    def __repr__(self) -> str:
        head = f"Diagram {self.name!r}: {count(len(self.blocks), 'block')}, {count(len(self.connections), 'wire')}"
        rows = {
            "blocks": listed(f"{name} ({type(b).__name__})" for name, b in self.blocks.items()),
            "wires": listed(f"{source} -> {target}" for source, target in self.connections),
            "inputs": listed(self.inputs),
            "outputs": listed(self.outputs),
            "clocks": self.rates if self.is_sampled else "",
        }
        return paragraph(head, rows)

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
    def input_units(self) -> tuple[str, ...]:
        """Unit text of each external input, as far as the ports that it drives have one."""
        return tuple(self.wiring.external_units)

    @property
    def output_units(self) -> tuple[str, ...]:
        """Unit text of each external output."""
        return tuple(self.wiring.output_units[k] for k in self.wiring.readout)

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


def _named(given: object, kind: str) -> dict[str, Any]:
    if not isinstance(given, Mapping) or not all(isinstance(name, str) and name for name in given):
        raise DiagramError(f"{kind} must be a mapping by name, such as {{'name': ...}}, got {given!r:.60}")
    return dict(given)


def _expect_port(port: object, what: str) -> None:
    if not isinstance(port, str):
        raise DiagramError(f"{what}: a port is a text 'block.port', got {port!r:.60}")


def _ports(given: object, name: str) -> tuple[str, ...]:
    ports = [given] if isinstance(given, str) else items_of(given)
    if not ports:
        raise DiagramError(f"input {name!r}: name the port it drives, or a list of ports, got {given!r:.60}")
    for port in ports:
        _expect_port(port, f"input {name!r}")
    return tuple(ports)


def _wires(given: object) -> tuple[tuple[str, str], ...]:
    wires = items_of(given)
    if wires is None or not all(isinstance(wire, (tuple, list)) and len(wire) == 2 for wire in wires):
        raise DiagramError(f"connections must be a list of pairs ('block.output', 'block.input'), got {given!r:.60}")
    for start, end in wires:
        _expect_port(start, "connections")
        _expect_port(end, "connections")
    return tuple((start, end) for start, end in wires)


def _check_blocks(blocks: Mapping[str, Block]) -> None:
    if not blocks:
        raise DiagramError("a diagram needs at least one block; give blocks={'name': block}")
    for name, block in blocks.items():
        if "." in name:
            raise DiagramError(f"block name {name!r}: use a non-empty text without dots, ports are written 'block.port'")
        if not isinstance(block, StateSpace | ModalPlant | SampledBlock):
            raise DiagramError(f"block {name!r} is a {type(block).__name__}; use a StateSpace or a ModalPlant (see state_space)")
