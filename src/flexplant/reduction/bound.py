"""How far a basis can be off, whatever it is coupled to: a bound from small matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from flexplant.model.arrays import FloatArray
from flexplant.reduction.interior import Interior, coupling
from flexplant.reduction.reduced import amplification

RESONANCE = 1e-6  # of w^2: nearer than this the motion is the mode itself, which the basis has exactly
MASSLESS = 1e-12  # of a boundary motion's mass, below which it cannot store kinetic energy that counts


@dataclass(frozen=True, eq=False)
class Basis:
    """What the bound needs to know of a basis Q: condensed boundary mass and stiffness (n_b, n_b), Mqb (n_q, n_b), w^2 of q
    (n_q,), error rows L (k, n_b + n_q), and w_c^2 below which no fixed-interface mode is missing."""

    mbb: FloatArray
    kbb: FloatArray
    mqb: FloatArray
    diagonal: FloatArray
    rows: FloatArray
    complete: float

    @classmethod
    def of(cls, interior: Interior) -> Basis:
        """That of interior vectors, in the order of their frequencies."""
        mbb, kbb = (interior.part.condensed(kind) for kind in ("mass", "stiffness"))
        return cls(mbb, kbb, coupling(interior), interior.diagonal, interior.error_rows, interior.complete)

    def motions(self, hz: float) -> FloatArray:
        """(n_b + n_q, m) motions p that the boundary drives, q = w^2 Mqb b / (w_q^2 - w^2), orthonormal in (M + K / w^2) / 2."""
        w2 = (2 * np.pi * hz) ** 2
        gap = self.diagonal - w2
        gap[abs(gap) < RESONANCE * w2] = RESONANCE * w2
        q = w2 * self.mqb / gap[:, None]
        mass = self.mbb + q.T @ self.mqb + self.mqb.T @ q + q.T @ q
        strain = self.kbb + q.T @ (self.diagonal[:, None] * q)
        boundary = _orthonormal(0.5 * (mass + strain / w2))
        return np.vstack([boundary, q @ boundary])

    def errors(self, hz: float) -> tuple[FloatArray, FloatArray]:
        """Ascending bounds (m,) of relative frequency errors at a frequency, and the motions (n_b + n_q, m) that suffer them."""
        motion = self.motions(hz)
        w2 = (2 * np.pi * hz) ** 2
        ratio, turn = la.eigh((lost := self.rows @ motion).T @ lost)
        return 0.5 * w2 * float(amplification(np.array([w2]), self.complete)[0]) * np.maximum(ratio, 0.0), motion @ turn

    def worst(self, max_frequency_hz: float, samples: int) -> float:
        """Bound of the relative error of any frequency up to max_frequency_hz of any system that contains the component.

        A mode of w^2 with boundary motion b has q = w^2 Mqb b / (w_q^2 - w^2), and the basis costs it at most

            dw / w <= w^2 |L p|^2 / (1 - w^2 / w_c^2) / (p^T M p + p^T K p / w^2),     p = [b; q].

        The rest of the system adds kinetic and strain energy only, and w^2 times the one is the other, so a mass-normalised
        mode of the whole has p^T M p and p^T K p / w^2 of at most 1. The bound is the largest value over all b and `samples`
        equally spaced frequencies. Source: Rayleigh-Ritz with the residual's static answer; compare Elssel and Voss 2006.
        """
        if not self.rows.size:
            return 0.0
        grid = np.linspace(max_frequency_hz / samples, max_frequency_hz, samples)
        return float(max(self.errors(hz)[0].max(initial=0.0) for hz in grid))


def round_off(interior: Interior, max_frequency_hz: float, samples: int) -> float:
    """Relative frequency error that rounding the condensed stiffness to double precision can cause, whatever the basis.

    Its entries are off by some 2 eps times the terms that cancelled in them: a mode of boundary motion b by eps b^T E b / w^2
    beside the energies that `worst` compares with. No bound below this says anything.
    """
    basis, cancelling = Basis.of(interior), interior.part.cancelling
    found = 0.0
    for hz in np.linspace(max_frequency_hz / samples, max_frequency_hz, samples):
        b = basis.motions(hz)[: cancelling.size]
        strain = la.eigvalsh(b.T @ (cancelling[:, None] * b))[-1] if b.size else 0.0
        found = max(found, float(np.finfo(float).eps) * float(strain) / (2 * np.pi * hz) ** 2)
    return found


def _orthonormal(mass: FloatArray) -> FloatArray:
    """Combinations B with B^T M B = I of the boundary motions that carry mass."""
    size = np.sqrt(np.maximum(np.diagonal(mass), MASSLESS * np.trace(mass) / mass.shape[0]))
    values, vectors = la.eigh(0.5 * (mass + mass.T) / np.outer(size, size))
    moving = values > MASSLESS
    return np.asarray(vectors[:, moving] / np.sqrt(values[moving]) / size[:, None])
