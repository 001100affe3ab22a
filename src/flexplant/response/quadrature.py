"""Integrals of spectra over frequency by Gauss quadrature on panels that are halved until halving changes nothing."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flexplant.errors import SolverError
from flexplant.model.arrays import FloatArray

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
TOLERANCE = 1e-9  # of the integral, by which the halves of all panels together may differ from the panels
MOST_PANELS = 400_000


def panel_integrals(density: Callable[[FloatArray], FloatArray], a: FloatArray, b: FloatArray) -> FloatArray:
    """(ny, panels) integrals of density (ny, nt) over the panels from a to b (Hz, ascending, they do not overlap).

    Each panel is compared with its two halves (8 points each) and halved again where they differ by more than TOLERANCE of the
    whole integral, shared out by the number of panels. SolverError where this has no end.
    """
    coarse, size, home = _gauss(density, a, b), a.size, np.arange(a.size)
    done, total = np.zeros_like(coarse), coarse.sum(axis=1)
    while True:
        middle = 0.5 * (a + b)
        left, right = _gauss(density, a, middle), _gauss(density, middle, b)
        open_ = (abs(left + right - coarse) > TOLERANCE * total[:, None] / np.sqrt(size)).any(axis=0)
        np.add.at(done.T, home[~open_], (left + right)[:, ~open_].T)
        if not open_.any():
            return done
        a, b, home = np.r_[a[open_], middle[open_]], np.r_[middle[open_], b[open_]], np.tile(home[open_], 2)
        coarse = np.hstack([left[:, open_], right[:, open_]])
        total, size = np.maximum(total, done.sum(axis=1) + coarse.sum(axis=1)), size + a.size
        if size > MOST_PANELS:
            raise SolverError(f"an integral over {a[0]:.6g} to {b[-1]:.6g} Hz needs more than {MOST_PANELS} panels")


def _gauss(density: Callable[[FloatArray], FloatArray], a: FloatArray, b: FloatArray) -> FloatArray:
    """(ny, panels) eight-point integrals over each panel."""
    at = 0.5 * (a + b)[:, None] + 0.5 * (b - a)[:, None] * NODES
    order = np.argsort(at.ravel(), kind="stable")
    sorted_values = density(at.ravel()[order])
    values = np.empty_like(sorted_values)
    values[:, order] = sorted_values
    return np.asarray((values.reshape(-1, *at.shape) @ WEIGHTS) * (0.5 * (b - a)))
