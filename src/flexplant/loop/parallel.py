"""The parallel form of a cascade: other states that no longer listen to the modes, which only the outputs read then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg

from flexplant.loop.cascade import Cascade
from flexplant.model.arrays import FloatArray

WORST = 2000.0  # size of the terms of a mode's equation over their sum, up to which the parallel form keeps its digits


def separation(cascade: Cascade) -> FloatArray | None:
    """T (m, 2n) with A T - T F = -from_modes, F the modes: l' = l - T [eta, eta'] is driven by the inputs alone.

    For T = [T1, T2] and each mode (A^2 + 2 zeta omega A + omega^2) T2 = -(P + A V), T1 = A T2 + 2 zeta omega T2 + V.
    None where there is nothing to separate, or a pole of A is so near to a mode that T would grow and cost digits.
    """
    n, m = cascade.omega.size, cascade.A.shape[0]
    if not n or not m or cascade.dt is not None or not cascade.from_modes.any():
        return None
    A, (scale, _) = scipy.linalg.matrix_balance(cascade.A, permute=False, separate=True)
    P, V = (part.T / scale for part in (cascade.from_modes[:, :n], cascade.from_modes[:, n:]))
    decay = 2 * cascade.zeta * cascade.omega
    norm = float(np.linalg.norm(A, 2))
    terms = norm**2 + decay * norm + cascade.omega**2
    matrix = A @ A + decay[:, None, None] * A + (cascade.omega**2)[:, None, None] * np.eye(m)
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:  # a pole on a mode, as an integrator behind a rigid-body mode
        return None
    if not (terms**2 * np.einsum("nij,nij->n", inverse, inverse) <= WORST**2).all():
        return None
    velocity = -np.einsum("nij,nj->ni", inverse, P + V @ A.T)
    position = velocity @ A.T + decay[:, None] * velocity + V
    return np.hstack([(position * scale).T, (velocity * scale).T])


def separated(cascade: Cascade, T: FloatArray) -> Cascade:
    """The cascade in the states [eta, eta', l - T [eta, eta']]."""
    n = cascade.omega.size
    return replace(
        cascade,
        from_modes=np.zeros_like(cascade.from_modes),
        B=cascade.B - T[:, n:] @ cascade.shape_in,
        C_modes=cascade.C_modes + cascade.C @ T,
    )
