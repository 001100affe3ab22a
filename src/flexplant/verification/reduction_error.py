"""A-posteriori error of a coupled system's modes, from the residuals of its components' reduction bases."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy.linalg as la

from flexplant.assembly import System
from flexplant.errors import InputError, expect
from flexplant.model.arrays import FloatArray, frozen
from flexplant.modes import Modes, expect_modes_of, normal_modes
from flexplant.reduction.reduced import ReducedComponent, amplification, can_estimate, residual_products

ALIKE = 1.05  # neighbouring modes whose weights w^4 / (1 - w^2 / w_c^2) differ less are solved together, with the largest
MIXING = 0.05  # of the own error: more from other modes, by second order, and they are solved together


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """Estimated relative frequency errors: mode k of `frequency_hz` (k,) is high by `by_component` (k, n_components) in all.

    total: (k,) their sum. mixed: (k,) True where the error mixes the mode with close ones or carries one of them past it: the
    value is then that of the k-th of the cluster, and the shape is uncertain. skipped: components that were not reduced here
    (or kept no error rows), so that nothing is known of them.
    """

    frequency_hz: FloatArray
    components: tuple[str, ...]
    by_component: FloatArray
    mixed: npt.NDArray[np.bool_]
    skipped: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequency_hz", frozen(self.frequency_hz))
        object.__setattr__(self, "by_component", frozen(self.by_component))

    @property
    def total(self) -> FloatArray:
        """(k,) relative frequency error of each mode."""
        return np.asarray(self.by_component.sum(axis=1))

    def below(self, frequency_hz: float) -> ErrorEstimate:
        """The estimate of the modes up to a frequency."""
        keep = self.frequency_hz <= frequency_hz
        return replace(self, frequency_hz=self.frequency_hz[keep], by_component=self.by_component[keep], mixed=self.mixed[keep])

    def __str__(self) -> str:
        lines = ["   Hz         error    " + "".join(f"{name:>12}" for name in self.components)]
        for hz, total, row, mixed in zip(self.frequency_hz, self.total, self.by_component, self.mixed, strict=True):
            lines.append(f"{hz:12.5g}  {total:9.1e}" + "".join(f"{value:12.1e}" for value in row) + "  mixed" * bool(mixed))
        if self.skipped:
            lines.append(f"not reduced here, error unknown: {', '.join(self.skipped)}")
        return "\n".join(lines)


def estimate_error(
    system: System, *, modes: Modes | None = None, max_frequency_hz: float | None = None, n_modes: int | None = None
) -> ErrorEstimate:
    """Relative frequency error of a system's modes caused by each component's truncated basis; no full model is needed.

        w_true^2 >= mu_k,   mu_k the k-th eigenvalue of  diag(w^2) - E,   E = sum of w_k^4 P^T P / (1 - w_k^2 / w_c^2)

    over the components, with P = L p for the mass-normalised modes p (rigid-body modes too) and the error rows L of the
    reduction: the residual of the unreduced interior, weighted with its static flexibility. w_c: up to it the component's
    modes are complete; from there on the error is infinite. df / f = w_k / sqrt(mu_k) - 1, from above. Where E does not mix
    modes, mu_k = w_k^2 - E_kk; close modes are solved together and flagged. Only mixing among the modes given is seen: give
    those up to well above the frequency of interest. Rigid-body modes are exact and left out. Raises InputError where no
    component has error rows.
    Source: dynamic condensation of what a basis lacks (Leung 1978), and the monotonicity of eigenvalues.
    """
    expect(system, System, "estimate_error", "couple([component]) makes one")
    if modes is None:
        modes = normal_modes(system, max_frequency_hz=max_frequency_hz, n_modes=n_modes)
    expect_modes_of(modes, system, "estimate_error")
    made = [c for c in system.components if isinstance(c, ReducedComponent)]
    if not made:
        raise InputError("estimate_error: no component of the system was made by a reduction; reduce with craig_bampton or rubin")
    reduced = [c for c in made if can_estimate(c)] or made
    products = [residual_products(c, modes.shapes[system.offsets[c.name]]) for c in reduced]
    complete = [(2 * np.pi * c.report.complete_below_hz) ** 2 for c in reduced]
    w2 = modes.omega**2
    # (n_components, k) factors of G at each mode's own frequency
    factors = np.array([w2**2 * amplification(w2, limit) for limit in complete])
    elastic = range(modes.n_rigid, len(modes))
    together = _Together(w2, products, factors)
    rows = [_mode_error(k, w2, products, factors[:, k], together) for k in elastic]
    names = tuple(c.name for c in reduced)
    shares = np.array([share for share, _ in rows]).reshape(len(rows), len(names))
    skipped = tuple(c.name for c in system.components if c.name not in names)
    return ErrorEstimate(modes.frequency_hz[modes.n_rigid :], names, shares, np.array([m for _, m in rows], dtype=bool), skipped)


class _Together:
    """Eigenvalues of diag(w^2) - E for a mode k, E with the weights of the highest mode whose weights are like those of k.

    Weights grow with frequency, so that E is too large rather than too small; one solution serves all modes up to that one.
    """

    def __init__(self, w2: FloatArray, products: list[FloatArray], factors: FloatArray) -> None:
        self._w2, self._products, self._factors = w2, products, factors
        self._last, self._values = -1, w2

    def __call__(self, k: int) -> FloatArray:
        if k > self._last:
            alike = (self._factors[:, k:] <= ALIKE * self._factors[:, [k]]).all(axis=0)
            self._last = k + (alike.size if alike.all() else int(np.argmin(alike))) - 1
            pairs = zip(self._factors[:, self._last], self._products, strict=True)
            self._values = la.eigvalsh(np.diag(self._w2) - sum(f * g for f, g in pairs))
        return self._values


def _mode_error(
    k: int, w2: FloatArray, products: list[FloatArray], factors: FloatArray, together: _Together
) -> tuple[FloatArray, bool]:
    """(n_components,) shares of one mode's relative frequency error, and whether close modes had to be solved with it."""
    if not np.isfinite(factors).all():
        return np.where(np.isfinite(factors), 0.0, np.inf), False
    own = np.array([f * g[k, k] for f, g in zip(factors, products, strict=True)])
    energy = sum(f * g for f, g in zip(factors, products, strict=True))
    drop, above = float(own.sum()), np.arange(w2.size) > k
    gap = np.maximum(abs(w2 - w2[k]), np.finfo(float).eps * w2[-1])
    pushed = np.where(above, energy[:, k] ** 2 / gap, 0.0).sum()  # by the modes above, to second order
    crossed = (w2 - np.diagonal(energy))[above] < w2[k] - drop
    mixed = bool(pushed > MIXING * drop > 0 or crossed.any())
    if mixed:
        drop = max(drop, float(w2[k] - together(k)[k]))
    else:
        drop += float(pushed)
    error = np.inf if drop >= w2[k] else drop / w2[k] / (1 - drop / w2[k] + np.sqrt(1 - drop / w2[k]))
    return own * (error / own.sum() if own.sum() > 0 else 0.0), mixed
