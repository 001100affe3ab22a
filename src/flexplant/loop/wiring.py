"""The wiring of a diagram as index tables, checked port by port."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexplant.errors import DiagramError
from flexplant.loop.ports import Block, find_port, kind
from flexplant.model.arrays import FloatArray, IntArray

NONE = -1


@dataclass(frozen=True, eq=False)
class Wiring:
    """All input ports u and output ports y of the blocks, stacked in block order, and what drives each input.

    input_ports, output_ports: names "block.port". input_units, output_units: their unit texts.
    source: (nu,) output that drives each input, or -1. external: (nu,) external input that drives it, or -1.
    readout: (nz,) output port behind each external output.
    """

    input_ports: tuple[str, ...]
    output_ports: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    input_block: IntArray
    output_block: IntArray
    source: IntArray
    external: IntArray
    readout: IntArray
    n_external: int

    @cached_property
    def internal(self) -> FloatArray:
        """S (nu, ny) with u = S y + E w: one 1 in each row driven by a block."""
        return _selection(self.source, len(self.output_ports))

    @cached_property
    def entry(self) -> FloatArray:
        """E (nu, nw) with u = S y + E w: one 1 in each row driven from outside."""
        return _selection(self.external, self.n_external)

    @property
    def external_units(self) -> list[str]:
        """Unit text of each external input: that of the first port with one among those it drives."""
        driven = [
            [u for u, e in zip(self.input_units, self.external, strict=True) if e == k and u] for k in range(self.n_external)
        ]
        return [units[0] if units else "" for units in driven]


def _selection(index: IntArray, columns: int) -> FloatArray:
    out = np.zeros((index.size, columns))
    rows = np.flatnonzero(index != NONE)
    out[rows, index[rows]] = 1.0
    return out


def wire(
    blocks: Mapping[str, Block],
    connections: Sequence[tuple[str, str]],
    inputs: Mapping[str, Sequence[str]],
    outputs: Mapping[str, str],
) -> Wiring:
    """The index tables of a diagram; DiagramError names the ports that are unknown, driven twice, unconnected or of two units."""
    first_in, first_out = _offsets(blocks, "inputs"), _offsets(blocks, "outputs")

    def input_index(port: str) -> int:
        block, k = find_port(port, blocks, "inputs")
        return first_in[block] + k

    def output_index(port: str) -> int:
        block, k = find_port(port, blocks, "outputs")
        return first_out[block] + k

    names_in, names_out = _port_names(blocks, "inputs"), _port_names(blocks, "outputs")
    units_in, units_out = _port_units(blocks, "input_units"), _port_units(blocks, "output_units")
    drivers: dict[int, list[str]] = {}
    source, external = np.full(len(names_in), NONE), np.full(len(names_in), NONE)
    for start, end in connections:
        y, u = output_index(start), input_index(end)
        drivers.setdefault(u, []).append(start)
        source[u] = y
        _check_units(start, units_out[y], end, units_in[u])
    for w, (name, ports) in enumerate(inputs.items()):
        for port in ports:
            u = input_index(port)
            drivers.setdefault(u, []).append(f"input {name!r}")
            external[u] = w
    _check_drivers(names_in, drivers)
    return Wiring(
        input_ports=names_in,
        output_ports=names_out,
        input_units=units_in,
        output_units=units_out,
        input_block=_owners(blocks, "inputs"),
        output_block=_owners(blocks, "outputs"),
        source=source,
        external=external,
        readout=np.array([output_index(port) for port in outputs.values()], dtype=np.int64),
        n_external=len(inputs),
    )


def _offsets(blocks: Mapping[str, Block], side: str) -> dict[str, int]:
    sizes = [len(getattr(b, side)) for b in blocks.values()]
    return dict(zip(blocks, np.cumsum([0, *sizes[:-1]]).tolist(), strict=True))


def _port_names(blocks: Mapping[str, Block], side: str) -> tuple[str, ...]:
    return tuple(f"{name}.{port}" for name, b in blocks.items() for port in getattr(b, side))


def _port_units(blocks: Mapping[str, Block], side: str) -> tuple[str, ...]:
    return tuple(unit for b in blocks.values() for unit in getattr(b, side))


def _owners(blocks: Mapping[str, Block], side: str) -> IntArray:
    return np.repeat(np.arange(len(blocks)), [len(getattr(b, side)) for b in blocks.values()])


def _check_units(start: str, unit_out: str, end: str, unit_in: str) -> None:
    a, b = kind(unit_out), kind(unit_in)
    if a and b and a != b:
        raise DiagramError(f"connection {start} -> {end}: {a} drives {b}; put a gain with these units between them")


def _check_drivers(names: Sequence[str], drivers: Mapping[int, Sequence[str]]) -> None:
    twice = [f"{names[u]} by {' and '.join(by)}" for u, by in drivers.items() if len(by) > 1]
    if twice:
        raise DiagramError(f"input driven twice: {'; '.join(twice)}; add the signals in a summing_junction first")
    free = [name for u, name in enumerate(names) if u not in drivers]
    if free:
        raise DiagramError(f"input not connected: {', '.join(free)}; connect it, or name it in inputs={{...}}")
