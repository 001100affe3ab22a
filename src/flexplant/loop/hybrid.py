"""A diagram with sampled blocks (nonlinear, or digital) split into one linear system and the blocks evaluated at its samples."""

from __future__ import annotations

from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter
from typing import NamedTuple

import numpy as np

from flexplant.blocks.basic import static
from flexplant.blocks.sampled import SampledBlock
from flexplant.errors import DiagramError, InputError
from flexplant.loop.cascade import Cascade, cascade_of
from flexplant.loop.diagram import Diagram
from flexplant.loop.ports import Block
from flexplant.loop.wiring import NONE
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace


@dataclass(frozen=True, eq=False, kw_only=True)
class Element:
    """A sampled block: reads q[inputs], writes p[outputs]; feedthrough: its output needs its input of the same sample."""

    name: str
    block: SampledBlock | StateSpace
    inputs: slice
    outputs: slice
    states: slice
    feedthrough: bool

    def period(self, dt: float) -> int:
        """Steps of dt between evaluations; InputError unless they are a whole number."""
        own = self.block.dt
        steps = 1 if own is None else round(own / dt)
        if own is not None and (steps < 1 or abs(steps * dt - own) > 1e-6 * dt):
            raise InputError(f"block {self.name!r} has dt = {own} s, which is not a whole multiple of the time step {dt:.9g} s")
        return steps


@dataclass(frozen=True, eq=False, kw_only=True)
class Hybrid:
    """linear: a Cascade from [w, p] to [z, q]; elements: in an order that respects their feedthrough. nw, nz: of w and z."""

    linear: Cascade
    elements: tuple[Element, ...]
    nw: int
    nz: int

    @property
    def initial(self) -> FloatArray:
        """States of the sampled blocks at rest."""
        states = [e.block.initial if isinstance(e.block, SampledBlock) else np.zeros(e.block.n_states) for e in self.elements]
        ends = [e.states.stop for e in self.elements]
        out = np.zeros(max(ends, default=0))
        for element, state in zip(self.elements, states, strict=True):
            out[element.states] = state
        return out


def is_sampled(block: Block) -> bool:
    """True for a block that is evaluated at samples: nonlinear, or digital."""
    return isinstance(block, SampledBlock) or (isinstance(block, StateSpace) and block.dt is not None)


def hybrid_of(diagram: Diagram) -> Hybrid:
    """The split; exact, only wires are sorted. DiagramError where sampled blocks form a loop without a delay."""
    wiring, names, parts = diagram.wiring, list(diagram.blocks), split(diagram)
    inner, columns, rows, q_ports, p_ports = parts
    writes = np.isin(np.arange(wiring.output_block.size), p_ports)
    nw, nz = wiring.n_external, wiring.readout.size
    linear = _widened(cascade_of(inner), columns, rows, nw + p_ports.size, nz + q_ports.size)
    D = linear.D.copy()
    D.setflags(write=True)
    for row, port in [*enumerate(wiring.readout), *((nz + k, wiring.source[u]) for k, u in enumerate(q_ports))]:
        if port != NONE and writes[port]:
            D[row, nw + np.searchsorted(p_ports, port)] = 1.0
    for k, u in enumerate(q_ports):
        if wiring.external[u] != NONE:
            D[nz + k, wiring.external[u]] = 1.0
    elements = _elements(diagram, [name for name in names if is_sampled(diagram.blocks[name])])
    return Hybrid(linear=replace(linear, D=D), elements=_ordered(elements, D[nz:, nw:]), nw=nw, nz=nz)


class Split(NamedTuple):
    """The blocks that are not sampled alone, and the places of its inputs in [w, p] and of its outputs in [z, q].

    q_ports, p_ports: the input and output ports of the sampled blocks.
    """

    inner: Diagram
    columns: list[int]
    rows: list[int]
    q_ports: IntArray
    p_ports: IntArray


def split(diagram: Diagram) -> Split:
    """A diagram taken apart into its sampled blocks and the rest."""
    wiring = diagram.wiring
    sampled = np.array([is_sampled(block) for block in diagram.blocks.values()])
    reads, writes = sampled[wiring.input_block], sampled[wiring.output_block]
    q_ports, p_ports = np.flatnonzero(reads), np.flatnonzero(writes)
    nw, nz = wiring.n_external, wiring.readout.size
    linear: dict[str, Block] = {name: block for name, block in diagram.blocks.items() if not is_sampled(block)}
    wires: list[tuple[str, str]] = []
    drives: dict[int, list[str]] = {}
    for u in np.flatnonzero(~reads):
        port, source = wiring.input_ports[u], wiring.source[u]
        if source != NONE and not writes[source]:
            wires.append((wiring.output_ports[source], port))
        else:
            column = int(wiring.external[u]) if source == NONE else nw + int(np.searchsorted(p_ports, source))
            drives.setdefault(column, []).append(port)
    seen = {k: port for k, port in enumerate(wiring.readout) if not writes[port]}
    seen |= {nz + k: wiring.source[u] for k, u in enumerate(q_ports) if wiring.source[u] != NONE and not writes[wiring.source[u]]}
    inner = Diagram(
        blocks=linear or {"nothing": static(np.zeros((0, 0)), inputs=[], outputs=[])},
        connections=wires,
        inputs={str(column): ports for column, ports in drives.items()},
        outputs={str(row): wiring.output_ports[port] for row, port in seen.items()},
        allow_algebraic_loops=diagram.allow_algebraic_loops,
        name=diagram.name,
    )
    return Split(inner, list(drives), list(seen), q_ports, p_ports)


def _widened(cascade: Cascade, columns: list[int], rows: list[int], width: int, height: int) -> Cascade:
    """The cascade with zero columns and rows for the channels that it does not have."""

    def spread(matrix: FloatArray, axis: int) -> FloatArray:
        places, size = (columns, width) if axis else (rows, height)
        out = np.zeros((matrix.shape[0], size) if axis else (size, matrix.shape[1]))
        out[(slice(None), places) if axis else places] = matrix
        return out

    return replace(
        cascade,
        shape_in=spread(cascade.shape_in, 1),
        B=spread(cascade.B, 1),
        C_modes=spread(cascade.C_modes, 0),
        C=spread(cascade.C, 0),
        D=spread(spread(cascade.D, 1), 0),
    )


def _elements(diagram: Diagram, names: list[str]) -> list[Element]:
    out, q, p, s = [], 0, 0, 0
    for name in names:
        block = diagram.blocks[name]
        assert not isinstance(block, ModalPlant)
        nq, np_, ns = len(block.inputs), len(block.outputs), block.n_states
        through = isinstance(block, SampledBlock) or bool(block.D.any())
        out.append(
            Element(
                name=name,
                block=block,
                inputs=slice(q, q + nq),
                outputs=slice(p, p + np_),
                states=slice(s, s + ns),
                feedthrough=through,
            )
        )
        q, p, s = q + nq, p + np_, s + ns
    return out


def _ordered(elements: list[Element], direct: FloatArray) -> tuple[Element, ...]:
    """Elements so that each comes after those whose outputs it needs at the same sample; direct: q from p (nq, np)."""
    before: dict[int, set[int]] = {}
    for i, element in enumerate(elements):
        needed = {j for j, other in enumerate(elements) if element.feedthrough and direct[element.inputs, other.outputs].any()}
        before[i] = needed
    try:
        return tuple(elements[i] for i in TopologicalSorter(before).static_order())
    except CycleError as error:
        path = " -> ".join(elements[i].name for i in error.args[1])
        raise DiagramError(f"sampled blocks in a loop without a delay: {path}; add a sample_delay or a state in it") from None
