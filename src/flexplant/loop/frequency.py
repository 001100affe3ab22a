"""Frequency response of plants, blocks and diagrams; a diagram is solved on its loops' own channels."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import xarray as xr

from flexplant.blocks.sampled import SampledBlock
from flexplant.loop.close import linear_only
from flexplant.loop.diagram import Diagram
from flexplant.loop.wiring import NONE
from flexplant.model.arrays import IntArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace
from flexplant.response import frequency as plant_frequency

Linear = Diagram | StateSpace | ModalPlant | Descriptor
ComplexArray = npt.NDArray[np.complex128]


def frequency_response(system: Linear, frequency_hz: npt.ArrayLike, *, out: ComplexArray | None = None) -> xr.DataArray:
    """Complex response, dims (output, input, frequency), at ascending frequencies in Hz.

    Plants and blocks: G(s) = C (E s - A)^-1 B + D. A diagram: each block's own response, then stage by stage as signals flow;
    a feedback stage solves (I - S G) u = u_outside on the inputs it drives itself, a few channels for each frequency.
    out: C-contiguous complex128 memory (ny, nu, nf) to write into. Raises InputError for frequencies that are negative, NaN,
    descending or none, or lie on an undamped pole, and for `out` of another shape; DiagramError for a diagram that is not linear.
    """
    if not isinstance(system, Diagram):
        return plant_frequency.frequency_response(system, frequency_hz, out=out)
    linear_only(system)
    hz = plant_frequency.checked_frequencies(frequency_hz)
    memory = plant_frequency.checked_memory(out, (len(system.outputs), len(system.inputs), hz.size))
    y = np.moveaxis(_port_responses(system, hz)[:, system.wiring.readout], 0, -1)
    return xr.DataArray(
        plant_frequency.written(y, memory),
        dims=("output", "input", "frequency"),
        coords={"output": list(system.outputs), "input": list(system.inputs), "frequency": hz},
        name="frequency_response",
    )


def frequency_response_blocks(system: Linear, frequency_hz: npt.ArrayLike, *, block: int | None = None) -> Iterator[xr.DataArray]:
    """`frequency_response` in blocks of ascending frequencies, for results larger than the memory.

    block: frequencies a block, by default as many as fill 16 MB. Raises InputError at once for bad frequencies and block
    sizes, and for a frequency on an undamped pole when its block is reached.
    """
    if not isinstance(system, Diagram):
        return plant_frequency.frequency_response_blocks(system, frequency_hz, block=block)
    linear_only(system)
    hz = plant_frequency.checked_frequencies(frequency_hz)
    parts = plant_frequency.parts(hz, len(system.outputs) * len(system.inputs), block)
    return (frequency_response(system, part) for part in parts)


def _port_responses(diagram: Diagram, hz: npt.NDArray[np.float64]) -> ComplexArray:
    """(nf, ny, nw) response of every output port to the external inputs."""
    wiring, names = diagram.wiring, list(diagram.blocks)
    y = np.zeros((hz.size, len(wiring.output_ports), wiring.n_external), dtype=complex)
    for stage in diagram.stages:
        members = [names.index(name) for name in stage]
        rows, columns = np.isin(wiring.output_block, members), np.isin(wiring.input_block, members)
        G = np.zeros((hz.size, int(rows.sum()), int(columns.sum())), dtype=complex)
        for name, k in zip(stage, members, strict=True):
            inside = np.ix_(wiring.output_block[rows] == k, wiring.input_block[columns] == k)
            block = diagram.blocks[name]
            assert not isinstance(block, SampledBlock)
            values = plant_frequency.frequency_response(block, hz).values
            G[:, inside[0], inside[1]] = np.moveaxis(values, -1, 0)
        y[:, rows] = G @ _stage_inputs(diagram, y, G, np.flatnonzero(rows), np.flatnonzero(columns))
    return y


def _stage_inputs(diagram: Diagram, y: ComplexArray, G: ComplexArray, outputs: IntArray, inputs: IntArray) -> ComplexArray:
    """(nf, nu of the stage, nw): what comes from outside and earlier stages, then the stage's own feedback solved."""
    source = diagram.wiring.source[inputs]
    u = np.where((source != NONE)[:, None], y[:, source], diagram.wiring.entry[inputs])
    fed_back = np.flatnonzero(np.isin(source, outputs))
    if fed_back.size:
        behind = np.searchsorted(outputs, source[fed_back])
        through = G[:, behind]
        loop = np.eye(fed_back.size) - through[:, :, fed_back]
        # y of this stage is still zero, so u holds only what comes from outside it
        u[:, fed_back] = np.linalg.solve(loop, through @ u)
    return u
