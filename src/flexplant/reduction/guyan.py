"""Guyan (static) condensation."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.dofs import DofSet
from flexplant.reduction.partition import Partition, project


def guyan(model: FiniteElementModel, boundary: DofSet | Iterable[tuple[int, int | str]]) -> Component:
    """Static condensation to the boundary: u = [I; -Kii^-1 Kib] u_b, a component without modal coordinates.

    Exact in statics; mass and damping are projected on the constraint modes. Raises ModelError for DOF that the model
    does not have, SolverError where the held interior is a mechanism. Source: Guyan 1965.
    """
    part = Partition.of(model, boundary)
    basis = part.full_basis(np.zeros((part.i.size, 0)))
    return Component(
        name=model.name,
        boundary=part.boundary,
        mass=project(model.mass, basis),
        stiffness=project(model.stiffness, basis),
        damping=None if model.damping is None else project(model.damping, basis),
        nodes=model.nodes,
        source={**model.source, "reduction": "Guyan"},
        units=model.units,
    )
