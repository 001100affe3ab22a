"""Frequency grids of plants, blocks and diagrams that miss no resonance peak."""

from __future__ import annotations

import numpy as np

from flexplant.blocks.sampled import SampledBlock
from flexplant.errors import InputError
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.diagram_response import ComplexArray
from flexplant.loop.frequency import prepared_response
from flexplant.loop.rates import digital_times
from flexplant.model.arrays import FloatArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace
from flexplant.response import grids
from flexplant.response.crossings import refined_grid
from flexplant.response.grids import FrequencyGrid, explained_grid

SMALL = 300  # states of a diagram up to which its closed poles are found


def adaptive_grid(
    system: ModalPlant | StateSpace | Diagram, low_hz: float, high_hz: float, *, per_mode: int = 13, per_decade: int = 60
) -> FrequencyGrid:
    """(nf,) ascending frequencies in Hz from low_hz to high_hz, with points about every resonance.

    Plants, blocks and diagrams of up to 300 states: about the poles (the closed ones), see `flexplant.response.grids`; a peak is
    met within about 1 - cos(pi / (2 per_mode + 2)) of its height, 0.6 % at the default 13. Larger diagrams, and those of several
    sample times, whose closed poles are not computed: about the poles of every block by itself, then divided until no entry of
    the response bends by more than 5 % of its value within an interval. The grid says where its points stand (`FrequencyGrid`).
    Raises InputError for bounds that are not 0 < low < high, or fewer than 3 points a mode.
    """
    if not isinstance(system, Diagram):
        if not isinstance(system, ModalPlant | StateSpace):
            raise InputError(f"adaptive_grid needs a ModalPlant, a StateSpace or a Diagram, got {type(system).__name__}")
        return grids.adaptive_grid(system, low_hz, high_hz, per_mode=per_mode, per_decade=per_decade)
    digital_times(system)
    blocks = [b for b in system.blocks.values() if not isinstance(b, SampledBlock)]
    if not system.is_sampled and sum(2 * b.n_modes if isinstance(b, ModalPlant) else b.n_states for b in blocks) <= SMALL:
        return grids.adaptive_grid(close(system), low_hz, high_hz, per_mode=per_mode, per_decade=per_decade)
    parts = [grids.adaptive_grid(b, low_hz, high_hz, per_mode=per_mode, per_decade=per_decade) for b in blocks]

    prepared = prepared_response(system)

    def entries(hz: FloatArray) -> ComplexArray:
        return prepared.at(hz).reshape(-1, hz.size)

    points = np.unique(np.concatenate(parts))
    resonances, lasting = (np.concatenate([getattr(part, name) for part in parts]) for name in ("resonance_hz", "undamped_hz"))
    how = f"{points.size} about the poles of every block by itself, and more until the response bends little between them"
    return explained_grid(refined_grid(entries, points)[0], resonances, lasting, how)
