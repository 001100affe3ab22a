"""Frequency response of plants, blocks and diagrams; a diagram is solved on its loops' own channels."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt
import xarray as xr

from flexplant.loop.close import linear_only
from flexplant.loop.diagram import Diagram
from flexplant.loop.wiring import NONE
from flexplant.model.arrays import FloatArray, IntArray
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
    prepared, hz = DiagramResponse(system), plant_frequency.checked_frequencies(frequency_hz)
    memory = plant_frequency.checked_memory(out, (len(system.outputs), len(system.inputs), hz.size))
    return _labelled(system, hz, plant_frequency.written(prepared(hz), memory))


def frequency_response_blocks(system: Linear, frequency_hz: npt.ArrayLike, *, block: int | None = None) -> Iterator[xr.DataArray]:
    """`frequency_response` in blocks of ascending frequencies, for results larger than the memory.

    block: frequencies a block, by default as many as fill 16 MB. Raises InputError at once for bad frequencies and block
    sizes, and for a frequency on an undamped pole when its block is reached.
    """
    if not isinstance(system, Diagram):
        return plant_frequency.frequency_response_blocks(system, frequency_hz, block=block)
    prepared, hz = DiagramResponse(system), plant_frequency.checked_frequencies(frequency_hz)
    parts = plant_frequency.parts(hz, len(system.outputs) * len(system.inputs), block)
    return (_labelled(system, part, prepared(part)) for part in parts)


def _labelled(system: Diagram, hz: FloatArray, values: ComplexArray) -> xr.DataArray:
    return xr.DataArray(
        values,
        dims=("output", "input", "frequency"),
        coords={"output": list(system.outputs), "input": list(system.inputs), "frequency": hz},
        name="frequency_response",
    )


class _Stage(NamedTuple):
    """The blocks of a stage: its output and input ports, and each block's response and places among them."""

    outputs: IntArray
    inputs: IntArray
    blocks: list[tuple[Callable[[FloatArray, None], ComplexArray], Any]]


class DiagramResponse:
    """hz (nf,) ascending -> (nz, nw, nf) response of a diagram; what does not depend on the frequency is made once."""

    def __init__(self, diagram: Diagram) -> None:
        linear_only(diagram)
        self.diagram, names = diagram, list(diagram.blocks)
        prepared = {k: plant_frequency.evaluator(cast(Any, block)) for k, block in enumerate(diagram.blocks.values())}
        wiring, self._stages = diagram.wiring, list[_Stage]()
        for stage in diagram.stages:
            members = [names.index(name) for name in stage]
            outputs, inputs = (np.flatnonzero(np.isin(b, members)) for b in (wiring.output_block, wiring.input_block))
            inside = [np.ix_(wiring.output_block[outputs] == k, wiring.input_block[inputs] == k) for k in members]
            self._stages.append(_Stage(outputs, inputs, [(prepared[k], at) for k, at in zip(members, inside, strict=True)]))

    def __call__(self, hz: FloatArray) -> ComplexArray:
        """(nz, nw, nf); InputError on an undamped pole."""
        y = np.zeros((hz.size, len(self.diagram.wiring.output_ports), self.diagram.wiring.n_external), dtype=complex)
        for stage in self._stages:
            G = np.zeros((hz.size, stage.outputs.size, stage.inputs.size), dtype=complex)
            for evaluate, inside in stage.blocks:
                G[:, inside[0], inside[1]] = np.moveaxis(evaluate(hz, None), -1, 0)
            y[:, stage.outputs] = G @ _stage_inputs(self.diagram, y, G, stage.outputs, stage.inputs)
        return np.moveaxis(y[:, self.diagram.wiring.readout], 0, -1)

    def at(self, hz: FloatArray) -> ComplexArray:
        """The response at frequencies in any order."""
        if (hz[1:] >= hz[:-1]).all():
            return self(hz)
        ascending, index = np.unique(hz, return_inverse=True)
        return self(ascending)[:, :, index]


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
