"""Physical damping of an unreduced model, which every reduction projects: proportional, and discrete dampers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp

from flexplant.errors import InputError, expect
from flexplant.model.component import FiniteElementModel

Dof: TypeAlias = tuple[int, int]


def with_proportional_damping(
    model: FiniteElementModel, *, mass_factor: float = 0.0, stiffness_factor: float = 0.0
) -> FiniteElementModel:
    """The model with Z = a M + b K added to its damping; a in 1/s, b in s (ratio a / (2 w) + b w / 2, Rayleigh 1877).

    Raises InputError for negative or infinite factors.
    """
    expect(model, FiniteElementModel, "with_proportional_damping", "read_model gives one from a file")
    if not (0 <= mass_factor < np.inf and 0 <= stiffness_factor < np.inf):
        raise InputError(f"proportional damping: factors must be finite and not negative, got {mass_factor}, {stiffness_factor}")
    added = mass_factor * model.mass + stiffness_factor * model.stiffness
    return replace(model, damping=added if model.damping is None else model.damping + added)


def with_dampers(model: FiniteElementModel, dampers: Iterable[tuple[Dof, Dof | None, float]]) -> FiniteElementModel:
    """The model with discrete dampers (dof_a, dof_b, c): force c (v_a - v_b) along the two DOF; None grounds that side.

    dof: (node, direction). Raises ModelError for DOF that the model does not have, InputError for a negative c.
    """
    expect(model, FiniteElementModel, "with_dampers", "read_model gives one from a file")
    n, owner = len(model.dofs), f"model {model.name!r}"
    total = sp.csr_array((n, n))
    for a, b, c in dampers:
        if not 0 <= c < np.inf:
            raise InputError(f"damper between {a} and {b or 'ground'}: c must be finite and not negative, got {c}")
        rows = model.dofs.rows([a] if b is None else [a, b], owner=owner)
        relative = sp.csr_array((np.array([1.0, -1.0])[: rows.size], (np.zeros(rows.size, dtype=int), rows)), shape=(1, n))
        total = total + c * (relative.T @ relative)
    return replace(model, damping=total if model.damping is None else sp.csr_array(model.damping) + total)
