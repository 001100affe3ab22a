"""Guyan (static) condensation."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from flexplant.errors import expect
from flexplant.model.component import FiniteElementModel
from flexplant.model.dofs import DofSet
from flexplant.reduction.component import basis_bytes, checked_extras, hcb_component
from flexplant.reduction.interior import Interior
from flexplant.reduction.partition import Partition
from flexplant.reduction.reduced import ReducedComponent, ReductionReport, Storage


def guyan(
    model: FiniteElementModel,
    boundary: DofSet | Iterable[tuple[int, int | str]],
    *,
    recover: DofSet | Iterable[tuple[int, int | str]] = (),
    keep_basis: Storage = False,
) -> ReducedComponent:
    """Static condensation to the boundary: u = [I; -Kii^-1 Kib] u_b, a component without modal coordinates.

    Exact in statics; mass and damping are projected on the constraint modes. recover, keep_basis: see `craig_bampton`. Raises
    ModelError for DOF that the model does not have, SolverError where the held interior is a mechanism. Source: Guyan 1965.
    """
    expect(model, FiniteElementModel, "guyan", "read_model gives one from a file")
    recover = checked_extras(model, recover, keep_basis)
    part = Partition.of(model, boundary)
    none = np.zeros((part.i.size, 0))
    interior = Interior(part, none, np.zeros(0), 0.0, False, none, none)
    report = ReductionReport(method="Guyan", n_modes=0, basis_bytes=basis_bytes(model, part.b.size))
    return hcb_component(interior, report, recover=recover, keep_basis=keep_basis)
