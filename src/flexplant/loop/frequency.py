"""Frequency response of plants, blocks and diagrams, continuous, discrete or sampled."""

from __future__ import annotations

from collections.abc import Iterator

import numpy.typing as npt
import xarray as xr

from flexplant.loop.baseband import SampledResponse
from flexplant.loop.diagram import Diagram
from flexplant.loop.diagram_response import ComplexArray, DiagramResponse
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace
from flexplant.response import frequency as plant_frequency

Linear = Diagram | StateSpace | ModalPlant | Descriptor


def frequency_response(system: Linear, frequency_hz: npt.ArrayLike, *, out: ComplexArray | None = None) -> xr.DataArray:
    """Complex response, dims (output, input, frequency), at ascending frequencies in Hz.

    Plants and blocks: G(s) = C (E s - A)^-1 B + D. A diagram: each block's own response, then stage by stage as signals flow;
    a feedback stage solves (I - S G) u = u_outside on the inputs it drives itself, a few channels for each frequency.
    A diagram of continuous blocks and digital ones of one or several sample times answers a tone with that tone and with others
    (aliases, which the holds send on): the response is the part of the outputs, in continuous time, at the frequency of the
    input (see `flexplant.loop.baseband`). Outputs at samples under held inputs: `frequency_response(discretize(diagram, dt))`.
    out: C-contiguous complex128 memory (ny, nu, nf) to write into. Raises InputError for frequencies that are negative, NaN,
    descending or none, or lie on an undamped pole, and for `out` of another shape; DiagramError for a nonlinear diagram.
    """
    if not isinstance(system, Diagram):
        return plant_frequency.frequency_response(system, frequency_hz, out=out)
    prepared, hz = prepared_response(system), plant_frequency.checked_frequencies(frequency_hz)
    memory = plant_frequency.checked_memory(out, (len(system.outputs), len(system.inputs), hz.size))
    labelled = plant_frequency.labelled(system, hz, plant_frequency.written(prepared(hz), memory))
    if system.is_sampled:
        labelled.attrs["sampling"] = f"the part of the outputs at the frequency of the input; samples: {system.rates}"
    return labelled


def frequency_response_blocks(system: Linear, frequency_hz: npt.ArrayLike, *, block: int | None = None) -> Iterator[xr.DataArray]:
    """`frequency_response` in blocks of ascending frequencies, for results larger than the memory.

    block: frequencies a block, by default as many as fill 16 MB. Raises InputError at once for bad frequencies and block
    sizes, and for a frequency on an undamped pole when its block is reached.
    """
    if not isinstance(system, Diagram):
        return plant_frequency.frequency_response_blocks(system, frequency_hz, block=block)
    prepared, hz = prepared_response(system), plant_frequency.checked_frequencies(frequency_hz)
    parts = plant_frequency.parts(hz, len(system.outputs) * len(system.inputs), block)
    return (plant_frequency.labelled(system, part, prepared(part)) for part in parts)


def prepared_response(diagram: Diagram) -> DiagramResponse | SampledResponse:
    """What gives the response of a diagram at many frequencies."""
    return SampledResponse(diagram) if diagram.is_sampled else DiagramResponse(diagram)
