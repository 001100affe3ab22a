"""How far a basis can be off, whatever it is coupled to; and the smallest basis that keeps a promise."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from flexplant.errors import SolverError
from flexplant.model.arrays import FloatArray
from flexplant.numerics.lanczos import Progress
from flexplant.reduction.interior import Interior, coupling, fixed_interface
from flexplant.reduction.partition import Partition
from flexplant.reduction.reduced import amplification

CUTS = (1.5, 2.0, 3.0)  # modes up to these multiples of the frequency asked
MAX_BLOCKS = 8
RESONANCE = 1e-6  # of w^2: nearer than this the motion is the mode itself, which the basis has exactly
SAMPLES = 12  # frequencies at which the bound is evaluated; it grows with frequency, resonances are covered by the modes
MASSLESS = 1e-12  # of a boundary motion's mass, below which it cannot store kinetic energy that counts


def frequency_error_bound(interior: Interior, max_frequency_hz: float) -> float:
    """Bound of the relative error of any frequency up to max_frequency_hz of any system that contains the component.

    A mode of w^2 with boundary motion b has q = w^2 Mqb b / (w_q^2 - w^2), and the basis costs it at most

        dw / w <= w^2 |L p|^2 / (1 - w^2 / w_c^2) / (2 p^T M p),     p = [b; q],

    since the rest of the system only adds kinetic energy. The bound is the largest value over all b and over frequencies up to
    the limit. Source: Rayleigh-Ritz with the residual's static answer; compare Elssel and Voss 2006.
    """
    return assess(interior, max_frequency_hz, np.inf)[0]


def assess(interior: Interior, max_frequency_hz: float, accuracy: float) -> tuple[float, FloatArray]:
    """The bound, and combinations (m, k) of the pending vectors that motions beyond `accuracy` need at the worst frequency."""
    n_b = interior.part.b.size
    worst, directions = 0.0, np.zeros((interior.drive.shape[0], 0))
    if not interior.error_rows.size:
        return worst, directions
    mbb, mqb = interior.part.condensed("mass"), coupling(interior)
    for hz in np.linspace(max_frequency_hz / SAMPLES, max_frequency_hz, SAMPLES):
        w2 = (2 * np.pi * hz) ** 2
        gap = interior.diagonal - w2
        gap[abs(gap) < RESONANCE * w2] = RESONANCE * w2
        q = w2 * mqb / gap[:, None]
        motion = np.vstack([np.eye(n_b), q])
        lost = interior.error_rows @ motion
        factor = 0.5 * w2 * float(amplification(np.array([w2]), interior.complete)[0])
        ratio, boundary = _ratios(lost.T @ lost, mbb + q.T @ mqb + mqb.T @ q + q.T @ q)
        if ratio.size and factor * ratio[-1] > worst:
            worst = float(factor * ratio[-1])
            directions = interior.drive @ motion @ boundary[:, factor * ratio > accuracy]
    return worst, directions


def _ratios(energy: FloatArray, mass: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ascending x^T E x / x^T M x and the x, over the motions that carry mass."""
    size = np.sqrt(np.maximum(np.diagonal(mass), MASSLESS * np.trace(mass) / mass.shape[0]))
    values, vectors = la.eigh(0.5 * (mass + mass.T) / np.outer(size, size))
    moving = values > MASSLESS
    basis = vectors[:, moving] / np.sqrt(values[moving]) / size[:, None]
    ratio, x = la.eigh(basis.T @ energy @ basis)
    return np.asarray(ratio), np.asarray(basis @ x)


def chosen_for(
    part: Partition, accuracy: float, max_frequency_hz: float, loads: FloatArray, progress: Progress | None
) -> tuple[Interior, float]:
    """Modes and blocks whose error bound meets `accuracy`, and the bound; SolverError with the best one reached."""
    best = np.inf
    for cut in CUTS:
        interior = fixed_interface(part, max_frequency_hz=cut * max_frequency_hz, n_modes=None, loads=loads, progress=progress)
        if loads.shape[1]:
            interior = interior.extended()
        for _ in range(MAX_BLOCKS):
            bound, directions = assess(interior, max_frequency_hz, accuracy)
            best = min(best, bound)
            if bound <= accuracy:
                return interior, bound
            interior = interior.extended(directions)
    raise SolverError(
        f"accuracy {accuracy:g} up to {max_frequency_hz:g} Hz is out of reach: the best bound with {MAX_BLOCKS} blocks was "
        f"{best:.1e}; ask for less, or add the DOF that move most as boundary"
    )
