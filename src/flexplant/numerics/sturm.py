"""Sturm counts: how many modes lie below a frequency, by Sylvester's law of inertia, and where such a count proves most."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.errors import SolverError
from flexplant.model.arrays import FloatArray
from flexplant.numerics.factorization import Analysis, Estimate, Factor
from flexplant.numerics.factorization.banded_backend import BandedAnalysis
from flexplant.numerics.factorization.supernodal_backend import SupernodalAnalysis

EQUAL = 1e-6  # relative distance of two w^2 below which they count as one repeated mode
CLOSE = 1e-4  # relative distance to the last modes at which they are counted: a pivot's sign is sure, and little left unsaid
CHEAP = 1.5  # flops of a factorisation over those of the solutions, up to which a count is made without being asked


def count_below(stiffness: Any, mass: Any, omega2: float, analysis: Analysis) -> int | None:
    """How many w^2 of K x = w^2 M x lie below `omega2` (Sylvester's law of inertia, a Sturm count); None if it cannot tell.

    A mode that sits on the limit to the last digit makes the matrix singular; the limit is then raised by 1e-9 of itself.
    """
    if isinstance(analysis, SupernodalAnalysis):
        count = analysis.negative_eigenvalues(sp.csr_array(stiffness - omega2 * mass))
        if count is not None:
            return count
        analysis = analysis.pivoting
    form = sp.csr_array if isinstance(analysis, BandedAnalysis) else sp.csc_array
    try:
        factor = analysis.factorize(form(stiffness - omega2 * mass))
    except SolverError:
        factor = analysis.factorize(form(stiffness - omega2 * (1 + 1e-9) * mass))
    return factor.negative_pivots


def gap_below_last(omega2: FloatArray) -> float:
    """A w^2 in the gap below the last group of equal ones (k,), ascending.

    A count there that agrees proves that no mode is missing among them: above it lie only copies of one mode, of which any
    choice is right.
    """
    floor = np.r_[0.0, omega2[:-1]]
    start = int(np.flatnonzero(omega2 - floor > EQUAL * omega2[-1])[-1])
    return max(0.5 * float(floor[start] + omega2[start]), float(omega2[start]) * (1 - CLOSE))


def is_cheap(estimate: Estimate | None, factor: Factor, columns: int) -> bool:
    """Whether one more factorisation takes little beside the solutions (`columns`) that the modes took."""
    return estimate is not None and estimate.flops <= CHEAP * 4.0 * factor.fill * columns
