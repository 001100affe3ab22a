"""Frequencies of a study: a logarithmic range, refined where modes resonate."""

from __future__ import annotations

import numpy as np

from flexplant.model.arrays import FloatArray
from flexplant.plant.modal import ModalPlant
from flexplant.study.schema_outputs import ResponseSpec

OFFSETS = np.array([-8.0, -4, -2, -1, -0.5, 0, 0.5, 1, 2, 4, 8])  # half bandwidths from a resonance: its peak within 1 %
UNDAMPED = 1e-4


def frequency_grid(
    spec: ResponseSpec, plant: ModalPlant, *, strongest: int | None = None, also: tuple[tuple[float, float], ...] = ()
) -> FloatArray:
    """Ascending frequencies in Hz: the list as given, or the range and points across every resonance in it.

    also: further resonances, (Hz, damping ratio), such as the loop's own.
    strongest: only the peaks of that many modes are added, those with the largest response of the first output to the first
    input.
    """
    if spec.frequency_hz is not None:
        return np.array(sorted(set(spec.frequency_hz)))
    spaced = np.geomspace if spec.spacing == "log" else np.linspace
    grid = spaced(spec.from_hz, spec.to_hz, spec.points)
    hz = np.array([*plant.frequency_hz, *(f for f, _ in also)])
    zeta = np.array([*plant.zeta, *(ratio for _, ratio in also)])
    hz = np.where(zeta > 0, hz, hz * (1 + UNDAMPED))  # an undamped mode has no response at its own frequency
    zeta = np.maximum(zeta, UNDAMPED)
    inside = np.flatnonzero((hz > spec.from_hz) & (hz < spec.to_hz))
    if strongest is None:
        added = (hz[inside, None] * (1 + zeta[inside, None] * OFFSETS)).ravel()
    else:
        assert plant.shape_out is not None
        inside = inside[inside < plant.n_modes]
        peak = abs(plant.shape_out[0] * plant.shape_in[:, 0])[inside] / zeta[inside] / hz[inside] ** 2
        added = hz[inside[np.argsort(peak)[::-1][:strongest]]]
    added = added[(added > spec.from_hz) & (added < spec.to_hz)]
    return np.unique(np.concatenate([grid, added]))
