"""Up to which frequency components can be trusted: what their reductions proved, or what their coordinates suggest."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from flexplant.model.component import Component
from flexplant.reduction.reduced import ReducedComponent

MARGIN = 1.5  # a basis of modes up to here times f serves frequencies up to f, by custom; twice is the careful choice


@dataclass(frozen=True)
class Coverage:
    """One component's range. complete_below_hz: below it no mode of the held (Rubin: free) component is missing, as its reduction
    says; None where nobody says so. highest_hz: of the modal coordinates, 0 where there are none."""

    component: str
    complete_below_hz: float | None
    highest_hz: float

    def ends_below(self, frequency_hz: float) -> bool:
        """Whether modes are known to be missing below the frequency."""
        return self.complete_below_hz is not None and self.complete_below_hz < frequency_hz * (1 - 1e-9)

    def note(self, frequency_hz: float) -> str | None:
        """What a user of a component of unknown reduction must know who asks for so much, or None."""
        if self.complete_below_hz is not None or self.highest_hz >= 2 * frequency_hz:
            return None
        if not self.highest_hz:
            return (
                f"component {self.component!r} has no modal coordinates, so nothing vouches for its dynamics up to "
                f"{frequency_hz:.4g} Hz"
            )
        low, high = self.highest_hz / 2, self.highest_hz / MARGIN
        return (
            f"component {self.component!r} was not reduced here: its modal coordinates end at {self.highest_hz:.4g} Hz, so modes "
            f"of the system above {low:.4g} to {high:.4g} Hz are not vouched for (asked: {frequency_hz:.4g} Hz)"
        )


def coverage(component: Component) -> Coverage:
    """The range of one component; a static condensation, which has no modes, counts as unknown."""
    hz = component.fixed_interface_hz
    highest = float(hz[np.isfinite(hz)].max(initial=0.0))
    known = component.report.complete_below_hz if isinstance(component, ReducedComponent) else 0.0
    return Coverage(component.name, known or None, highest)


def shortfall(covered: Iterable[Coverage], frequency_hz: float) -> str | None:
    """ "asked up to 500 Hz, but component 'bus' is complete only below 150 Hz" (and others), or None."""
    short = [c for c in covered if c.ends_below(frequency_hz)]
    if not short:
        return None
    each = " and ".join(f"component {c.component!r} is complete only below {c.complete_below_hz:.4g} Hz" for c in short)
    return f"asked up to {frequency_hz:.4g} Hz, but {each}"
