"""A loop of continuous plants and digital blocks of one sample time, as a continuous diagram over the warped frequency w.

    z = (1 + w T / 2) / (1 - w T / 2),   w = i (2 / T) tan(omega T / 2) on the unit circle

The plants are first sampled, exactly, under held inputs. A sampled mode, of second order in z, is then again a mode in w, with a
frequency, a damping and rows of displacements and velocities of its own, so that every analysis of continuous loops serves
digital ones: the unit circle is the imaginary axis, its inside the left half plane, the Nyquist frequency infinity.
Source: Franklin, Powell and Workman, Digital Control of Dynamic Systems, section 7.3 (the w-transform).
"""

from __future__ import annotations

import numpy as np

from flexplant.blocks.basic import static
from flexplant.loop.chain import chain_of
from flexplant.loop.chain_step import chain_step
from flexplant.loop.diagram import Diagram
from flexplant.loop.hybrid import Split, is_sampled, split
from flexplant.loop.modal_split import with_modes_apart
from flexplant.loop.ports import Block
from flexplant.loop.warped_chain import Pieces, free_name, warped_chain
from flexplant.loop.warped_modes import warped_space
from flexplant.loop.wiring import NONE
from flexplant.model.arrays import FloatArray
from flexplant.plant.state_space import StateSpace


def warped_hz(hz: FloatArray, dt: float) -> FloatArray:
    """The warped frequency of a true one up to the Nyquist frequency, both in Hz."""
    return np.asarray(np.tan(np.pi * hz * dt) / (np.pi * dt))


def true_hz(hz: FloatArray, dt: float) -> FloatArray:
    """The inverse of `warped_hz`; infinity is the Nyquist frequency."""
    return np.asarray(np.arctan(np.pi * hz * dt) / (np.pi * dt))


def warped(diagram: Diagram, dt: float, *, minimal: bool = True) -> Diagram:
    """The diagram over w; its inputs are held over a sample, its outputs are read at samples.

    Digital blocks keep their names and ports. minimal: no more poles than the loop has; False where only its response matters,
    which then comes nearer to poles without damping. InputError where a block or a mode has a pole at z = -1.
    """
    parts = split(diagram)
    blocks: dict[str, Block] = {
        name: warped_space(block, dt)
        for name, block in diagram.blocks.items()
        if isinstance(block, StateSpace) and is_sampled(block)
    }
    chain = chain_of(parts.inner)
    pieces = warped_chain(chain, chain_step(chain, dt), dt, blocks, minimal=minimal)
    blocks |= pieces.blocks
    wires, inputs, outputs = _wires(diagram, parts, pieces)
    unused = [name for name, ports in inputs.items() if not ports]
    if unused:
        nowhere = free_name("unused", blocks)
        blocks[nowhere] = static(np.zeros((0, len(unused))), inputs=unused, outputs=[])
        inputs |= {name: [f"{nowhere}.{name}"] for name in unused}
    whole = Diagram(
        blocks=blocks, connections=wires, inputs=inputs, outputs=outputs, allow_algebraic_loops=True, name=diagram.name
    )
    return with_modes_apart(whole)


def _wires(diagram: Diagram, parts: Split, pieces: Pieces) -> tuple[list[tuple[str, str]], dict[str, list[str]], dict[str, str]]:
    """Connections, inputs and outputs; what goes from one digital block to another goes straight there."""
    wiring, names, nw, nz = diagram.wiring, list(diagram.inputs), len(diagram.inputs), len(diagram.outputs)
    wires, inputs = list(pieces.wires), {name: list[str]() for name in names}
    for place, ports in zip(parts.columns, pieces.entries, strict=True):
        if place < nw:
            inputs[names[place]] += ports
        else:
            wires += [(wiring.output_ports[parts.p_ports[place - nw]], port) for port in ports]
    seen = dict(zip(parts.rows, pieces.exits, strict=True))
    for k, u in enumerate(parts.q_ports):
        if wiring.external[u] != NONE:
            inputs[names[wiring.external[u]]].append(wiring.input_ports[u])
        else:
            wires.append((seen.get(nz + k, wiring.output_ports[wiring.source[u]]), wiring.input_ports[u]))
    read = zip(diagram.outputs, wiring.readout, strict=True)
    return wires, inputs, {name: seen.get(k, wiring.output_ports[port]) for k, (name, port) in enumerate(read)}
