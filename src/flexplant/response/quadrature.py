"""Integrals of spectra over frequency by Gauss quadrature on panels that are halved until halving changes nothing."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flexplant.errors import SolverError
from flexplant.model.arrays import FloatArray

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
TOLERANCE = 1e-9  # of the integral, by which the halves of all panels together may differ from the panels
MOST_PANELS = 400_000


def integrated(density: Callable[[FloatArray], FloatArray], edges: FloatArray) -> FloatArray:
    """(ny,) integral of density (ny, nt) from the first to the last of the ascending edges.

    Each panel is compared with its two halves (8 points each) and halved again where they differ by more than TOLERANCE of the
    integral, shared out by its length on a logarithmic scale and by the number of panels. SolverError where this has no end.
    """
    a, b = edges[:-1], edges[1:]
    coarse, done, size = _panels(density, a, b), 0.0, a.size
    total = coarse.sum(axis=1)
    while True:
        middle = 0.5 * (a + b)
        left, right = _panels(density, a, middle), _panels(density, middle, b)
        off = abs(left + right - coarse)
        open_ = (off > TOLERANCE * total[:, None] / np.sqrt(size)).any(axis=0)
        done = done + (left + right)[:, ~open_].sum(axis=1)
        if not open_.any():
            return np.asarray(done)
        a, b = np.r_[a[open_], middle[open_]], np.r_[middle[open_], b[open_]]
        coarse = np.hstack([left[:, open_], right[:, open_]])
        total, size = np.maximum(total, done + coarse.sum(axis=1)), size + a.size
        if size > MOST_PANELS:
            raise SolverError(f"an integral over {edges[0]:.6g} to {edges[-1]:.6g} Hz needs more than {MOST_PANELS} panels")


def _panels(density: Callable[[FloatArray], FloatArray], a: FloatArray, b: FloatArray) -> FloatArray:
    """(ny, panels) integrals over each panel."""
    at = 0.5 * (a + b)[:, None] + 0.5 * (b - a)[:, None] * NODES
    order = np.argsort(at.ravel(), kind="stable")
    sorted_values = density(at.ravel()[order])
    values = np.empty_like(sorted_values)
    values[:, order] = sorted_values
    return np.asarray((values.reshape(-1, *at.shape) @ WEIGHTS) * (0.5 * (b - a)))
