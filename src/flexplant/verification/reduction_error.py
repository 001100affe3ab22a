"""A-posteriori error of a coupled system's modes, from the residuals of its components' reduction bases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexplant.assembly import System
from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, frozen
from flexplant.modes import Modes, normal_modes
from flexplant.reduction.reduced import ReducedComponent, residual_energy


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """Estimated relative frequency errors: mode k of `frequency_hz` (k,) is high by `by_component` (k, n_components) in all.

    total: (k,) their sum. skipped: components that were not reduced here, so that nothing is known of them.
    """

    frequency_hz: FloatArray
    components: tuple[str, ...]
    by_component: FloatArray
    skipped: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequency_hz", frozen(self.frequency_hz))
        object.__setattr__(self, "by_component", frozen(self.by_component))

    @property
    def total(self) -> FloatArray:
        """(k,) relative frequency error of each mode."""
        return np.asarray(self.by_component.sum(axis=1))

    def __str__(self) -> str:
        lines = ["   Hz         error    " + "".join(f"{name:>12}" for name in self.components)]
        for hz, total, row in zip(self.frequency_hz, self.total, self.by_component, strict=True):
            lines.append(f"{hz:12.5g}  {total:9.1e}" + "".join(f"{value:12.1e}" for value in row))
        if self.skipped:
            lines.append(f"not reduced here, error unknown: {', '.join(self.skipped)}")
        return "\n".join(lines)


def estimate_error(
    system: System, *, modes: Modes | None = None, max_frequency_hz: float | None = None, n_modes: int | None = None
) -> ErrorEstimate:
    """Relative frequency error of a system's modes caused by each component's truncated basis; no full model is needed.

        df / f = sum over components of |w^2 L p|^2 / (2 w^2 (1 - w^2 / w_c^2)),   mass-normalised modes p

    with the error rows L of `craig_bampton`: the residual of the unreduced interior, weighted with its static flexibility.
    First order, and from above as long as w is well below w_c, up to which the component's modes are complete; infinite
    beyond. Rigid-body modes are exact and left out. Raises InputError where no component has error rows.
    """
    modes = modes or normal_modes(system, max_frequency_hz=max_frequency_hz, n_modes=n_modes)
    elastic = slice(modes.n_rigid, None)
    reduced = [c for c in system.components if isinstance(c, ReducedComponent)]
    if not reduced:
        raise InputError("estimate_error: no component of the system was reduced in this session; reduce with craig_bampton")
    omega2 = modes.omega[elastic] ** 2
    shapes = modes.shapes[:, elastic]
    columns = [residual_energy(c, shapes[system.offsets[c.name]], omega2) / (2 * omega2) for c in reduced]
    names = tuple(c.name for c in reduced)
    skipped = tuple(c.name for c in system.components if c.name not in names)
    return ErrorEstimate(modes.frequency_hz[elastic], names, np.array(columns).T, skipped)
