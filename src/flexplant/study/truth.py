"""Figure 4: the reduced plant over the explicit solution of the unreduced model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import xarray as xr

from flexplant.errors import InputError
from flexplant.io import read_model
from flexplant.model.arrays import FloatArray
from flexplant.plant.modal import ModalPlant, select
from flexplant.plant.subset import with_modes
from flexplant.response.frequency import frequency_response
from flexplant.response.structural import direct_response, structural_response
from flexplant.study.assemble import assemble, file_options, read_components
from flexplant.study.grid import frequency_grid
from flexplant.study.plant import build_plant
from flexplant.study.result import TruthResult
from flexplant.study.schema import StudySpec, TruthSpec
from flexplant.verification import Table

STRONGEST = 40  # resonances at which the unreduced model is solved too
BANDS = (0.25, 0.5, 0.75, 1.0)  # parts of the plant's range over which differences are stated


def compare_with_truth(
    study: StudySpec, folder: Path, plant: ModalPlant, limit_hz: float, tell: Callable[[float], None]
) -> TruthResult:
    """Both responses at the same frequencies with the same structural damping; `tell` hears the done share."""
    spec = study.truth
    assert spec is not None
    one = select(plant, inputs=[spec.input], outputs=[spec.output])
    model = read_model(folder / spec.file, format=spec.format, **file_options(spec, folder))
    hz = frequency_grid(spec.frequency, one, strongest=STRONGEST)
    direct = direct_response(
        model,
        inputs=[_dof(spec.input)],
        outputs=[_dof(spec.output)],
        frequency_hz=hz,
        structural_damping=spec.structural_damping,
        each=lambda done: tell(done / hz.size),
    ).assign_coords(output=[spec.output], input=[spec.input])
    ours = structural_response(one, hz, spec.structural_damping)
    bare = structural_response(_uncorrected(one), hz, spec.structural_damping)
    viscous = frequency_response(one, hz)
    other = structural_response(_second_plant(study, spec, folder), hz, spec.structural_damping) if spec.components else None
    return TruthResult(
        direct=direct,
        plant=ours,
        uncorrected=bare,
        viscous=viscous,
        second=other,
        table=_table(direct, ours, bare, viscous, other, hz, limit_hz),
        below_limit=_below_limit(direct, ours, hz, limit_hz),
        second_below_limit=None if other is None else _below_limit(direct, other, hz, limit_hz),
    )


def _uncorrected(plant: ModalPlant) -> ModalPlant:
    """The plant with its kept modes alone, neither a static term nor residual modes."""
    kept = plant.frequency_hz <= plant.report.get("highest_frequency_hz", np.inf)
    return replace(with_modes(plant, kept), static_correction=None)


def _second_plant(study: StudySpec, spec: TruthSpec, folder: Path) -> ModalPlant:
    """The same plant from other components, for the compared input and output."""
    instead = study.model_copy(update={"components": {**study.components, **spec.components}})
    plant = build_plant(instead, assemble(instead, read_components(instead, folder)))
    return select(plant, inputs=[spec.input], outputs=[spec.output])


def _below_limit(direct: xr.DataArray, ours: xr.DataArray, hz: FloatArray, limit_hz: float) -> tuple[float, float, float, float]:
    """Lowest and highest Hz of the plant's range; median of |G - G_direct| / |G_direct| and largest of it over the peak, %."""
    at = hz <= limit_hz
    truth, error = abs(direct.values[0, 0, at]), abs((ours - direct).values[0, 0, at])
    return float(hz[at][0]), float(hz[at][-1]), 100 * float(np.median(error / truth)), 100 * float(error.max() / truth.max())


def _dof(channel: str) -> tuple[int, int]:
    """(node, direction) of "component.node.direction"."""
    try:
        _, node, direction = channel.split(".")
        return int(node), int(direction)
    except ValueError:
        raise InputError(f"truth: {channel!r} is not a displacement or force at a node, component.node.direction") from None


def _table(
    direct: xr.DataArray,
    ours: xr.DataArray,
    bare: xr.DataArray,
    viscous: xr.DataArray,
    second: xr.DataArray | None,
    hz: FloatArray,
    limit_hz: float,
) -> Table:
    """Differences by band: median of |G - G_direct| over the local |G_direct|, then of each plant the largest over the peak."""
    edges = [float(hz[0]), *(limit_hz * b for b in BANDS), float(hz[-1])]
    others = [ours, bare, viscous] + ([] if second is None else [second])
    rows = []
    for low, high in pairwise(edges):
        at = (hz >= low) & (hz <= high)
        if not at.any() or high <= low:
            continue
        truth = direct.values[0, 0, at]
        error = [abs(other.values[0, 0, at] - truth) for other in others]
        percent = [100 * float(e.max() / abs(truth).max()) for e in error]
        local = 100 * float(np.median(error[0] / abs(truth)))
        rows.append((f"{low:.4g} - {high:.4g}", int(at.sum()), local, *percent))
    columns = (
        "band [Hz]",
        "points",
        "local median [%]",
        "of band's peak [%]",
        "uncorrected [%]",
        "viscous [%]",
        *(() if second is None else ("other components [%]",)),
    )
    return Table("Plant against the unreduced model", columns, tuple(rows))
