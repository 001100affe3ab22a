"""Diagrams cut or disturbed at named signals, for loop gains and sensitivities there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from flexplant.blocks.basic import static
from flexplant.errors import InputError, nearest
from flexplant.loop.diagram import Diagram
from flexplant.loop.ports import Block, find_port
from flexplant.loop.rates import digital_times
from flexplant.model.arrays import items_of
from flexplant.plant.modal import ModalPlant, select
from flexplant.plant.state_space import StateSpace

CUT = "cut "  # prefix of the names that are put in, so that they clash with none of the diagram's


def checked_signals(diagram: Diagram, at: str | Sequence[str]) -> list[str]:
    """The signals, output ports "block.port" that drive another block; InputError or DiagramError for what cannot be broken."""
    if not isinstance(diagram, Diagram):
        raise InputError(f"a loop is broken in a Diagram, got {type(diagram).__name__}; margins() takes the loop gain of a plant")
    digital_times(diagram)
    signals = [at] if isinstance(at, str) else items_of(at) or []
    if not signals or not all(isinstance(name, str) for name in signals) or len(set(signals)) != len(signals):
        raise InputError(f"at = {at!r:.60}; name one or several different signals 'block.port' to break the loop at")
    driving = {start for start, _ in diagram.connections}
    for name in signals:
        find_port(name, diagram.blocks, "outputs")
        if name not in driving:
            raise InputError(f"signal {name!r} drives no block, so no loop passes through it." + nearest(name, driving))
    return signals


def cut_open(diagram: Diagram, signals: Sequence[str]) -> Diagram:
    """Every wire from the signals is driven from outside instead: inputs "cut <signal>", outputs the signals that come back."""
    ends = {name: [end for start, end in diagram.connections if start == name] for name in signals}
    return alone(
        diagram,
        connections=[wire for wire in diagram.connections if wire[0] not in ends],
        inputs={CUT + name: ports for name, ports in ends.items()},
        outputs={CUT + name: name for name in signals},
    )


def disturbed(diagram: Diagram, signals: Sequence[str]) -> dict[str, Diagram]:
    """S, T and (S - T) / 2 as diagrams: a disturbance d added to every signal y, v = d + y goes on; S d = v, T d = -y.

    With the loop gain L = -(v -> y): v = (I + L)^-1 d.
    """
    names = [f"cut_{k}" for k in range(len(signals))]
    while set(names) & set(diagram.blocks):
        names = [name + "_" for name in names]
    junction = static([[1.0, 1.0], [0.0, -1.0], [0.5, 1.0]], inputs=["d", "y"], outputs=["S", "T", "half"])
    at = dict(zip(signals, names, strict=True))
    rewired = [(f"{at[start]}.S" if start in at else start, end) for start, end in diagram.connections]
    return {
        kind: alone(
            diagram,
            blocks={**diagram.blocks, **dict.fromkeys(names, junction)},
            connections=[*rewired, *((name, f"{j}.y") for name, j in at.items())],
            inputs={CUT + name: [f"{j}.d"] for name, j in at.items()},
            outputs={CUT + name: f"{j}.{kind}" for name, j in at.items()},
        )
        for kind in ("S", "T", "half")
    }


def alone(
    diagram: Diagram,
    *,
    blocks: Mapping[str, Block] | None = None,
    connections: Sequence[tuple[str, str]],
    inputs: Mapping[str, Sequence[str]],
    outputs: Mapping[str, str],
) -> Diagram:
    """A diagram with these wires only: ports that the outside used to drive get zero, unused channels of modal plants go.

    A modal plant that nothing drives any more becomes a source of zeros, so that its free modes play no part.
    """
    blocks = dict(diagram.blocks if blocks is None else blocks)
    driven = {end for _, end in connections} | {port for ports in inputs.values() for port in ports}
    used = {start for start, _ in connections} | set(outputs.values())
    for name, block in blocks.items():
        if isinstance(block, ModalPlant):
            blocks[name] = _needed(name, block, driven, used)
    left = [f"{name}.{port}" for name, block in blocks.items() for port in block.inputs if f"{name}.{port}" not in driven]
    if left:
        zero = "zero"
        while zero in blocks:
            zero += "_"
        blocks[zero] = _zeros(["y"])
        connections = [*connections, *((f"{zero}.y", end) for end in left)]
    return replace(diagram, blocks=blocks, connections=connections, inputs=dict(inputs), outputs=dict(outputs))


def _needed(name: str, plant: ModalPlant, driven: set[str], used: set[str]) -> Block:
    inputs = [port for port in plant.inputs if f"{name}.{port}" in driven]
    outputs = [port for port in plant.outputs if f"{name}.{port}" in used]
    return select(plant, inputs=inputs, outputs=outputs) if inputs else _zeros(outputs)


def _zeros(outputs: Sequence[str]) -> StateSpace:
    return static(np.zeros((len(outputs), 0)), inputs=[], outputs=outputs, name="zero")
