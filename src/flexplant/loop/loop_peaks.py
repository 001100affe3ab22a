"""Peaks of the sensitivities of a loop broken at several signals: S, T and (S - T) / 2 from one search, for they bend alike.

S = I - T and (S - T) / 2 = S - I / 2 differ by constants, so that one bound of the second derivative, one division of the axis
into intervals and one count of unstable poles serve all three.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from flexplant.loop.bordered import bordered
from flexplant.loop.diagram import Diagram
from flexplant.loop.loop_bound import LoopAxis
from flexplant.loop.norms import certified, has_bordered_form, hinf_norm, loop_axes
from flexplant.model.arrays import FloatArray
from flexplant.response.norms import HinfNorm
from flexplant.response.singular import largest_singular_values

KINDS = ("S", "T", "half")
TOLERANCE = 1e-7


@dataclass(frozen=True, eq=False)
class SensitivityAxis(LoopAxis):
    """The axis of a loop from disturbances d of its broken signals y to S d = d + y; T d = -y.

    seeds: rad/s where the peaks were seen already, and the search begins.
    """

    seeds: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def points(self) -> FloatArray:
        """Those of `LoopAxis`, and the seeds."""
        with np.errstate(divide="ignore"):
            seeds = 1 / self.seeds if self.high else self.seeds
        ends = super().points
        return np.unique(np.r_[ends, seeds[(seeds > 0) & (seeds < ends[-1])]])

    @property
    def n_gains(self) -> int:
        """S, T and (S - T) / 2."""
        return len(KINDS)

    def gains(self, t: FloatArray) -> FloatArray:
        """(3, nt) largest singular values."""
        through, direct = self.through(t), self.loop.F[:, :, None]
        S, T = through + direct, -through - (direct - np.eye(direct.shape[0])[:, :, None])
        return np.stack([largest_singular_values(np.asarray(G, dtype=complex)) for G in (S, T, 0.5 * (S - T))])


def sensitivity_peaks(system: Callable[[str], Diagram], seen_hz: FloatArray) -> dict[str, HinfNorm]:
    """The norms of S, T and half = (S - T) / 2 of broken loops, infinite with an explanation if unstable.

    system: gives the diagram of each of the three (see `disturbed`). seen_hz: where the curves on a grid are highest. Small
    diagrams, and those without the form of `bordered`, go through `hinf_norm` one by one.
    """
    if not has_bordered_form(system("S")):
        return {kind: hinf_norm(system(kind), tolerance=TOLERANCE) for kind in KINDS}
    axis = partial(SensitivityAxis, seeds=2 * np.pi * seen_hz)
    found = certified(loop_axes(bordered(system("S")), axis), TOLERANCE)
    return dict(zip(KINDS, found, strict=True))
