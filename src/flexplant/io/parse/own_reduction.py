"""What a reduced component remembers of its reduction, in the project's own layout: report, error rows, and the basis."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

import numpy as np

from flexplant.errors import InputError, ModelError
from flexplant.model.arrays import checked_matrix, is_number
from flexplant.model.component import Component
from flexplant.model.dofs import DofSet
from flexplant.reduction.reduced import ReducedComponent, ReductionReport

Arrays = dict[str, Any]


def pairs_of(dofs: DofSet) -> Any:
    """(n, 2) node and direction."""
    return np.column_stack([dofs.node, dofs.direction])


def dofs_of(arrays: Arrays, name: str) -> DofSet:
    """The DOF of an array that `pairs_of` made."""
    pairs = arrays[name].reshape(-1, 2)
    return DofSet(pairs[:, 0], pairs[:, 1])


def reduction_texts(component: Component) -> dict[str, Any]:
    """Header entries: the report, and the units in which the reduction was done."""
    if not isinstance(component, ReducedComponent):
        return {}
    return {"reduction": {"report": asdict(component.report), "units": component.reduced_units}}


def pack_reduction(component: Component, *, basis: bool) -> Arrays:
    """error_rows; with basis=True also the basis and its DOF. InputError where the component kept none."""
    kept = component.basis if isinstance(component, ReducedComponent) else None
    if basis and kept is None:
        raise InputError(f"component {component.name!r} has no basis to write; reduce its model with keep_basis=True")
    arrays: Arrays = {}
    if isinstance(component, ReducedComponent) and component.error_rows is not None:
        arrays["error_rows"] = component.error_rows
    if basis and isinstance(component, ReducedComponent):
        arrays |= {"basis": kept, "model_dofs": pairs_of(component.model_dofs)}
    return arrays


def reduced_component(arrays: Arrays, reduction: dict[str, Any], given: dict[str, Any]) -> ReducedComponent:
    """The component with what it remembers; ModelError, TypeError or KeyError for anything that does not fit."""
    n = int(given["mass"].shape[0])
    dofs = dofs_of(arrays, "model_dofs") if "model_dofs" in arrays else DofSet.of(())
    basis = checked_matrix(arrays["basis"], (len(dofs), n), "basis") if "basis" in arrays else None
    rows = checked_matrix(arrays["error_rows"], (None, n), "error rows") if "error_rows" in arrays else None
    kept: dict[str, Any] = {"model_dofs": dofs, "basis": basis, "error_rows": rows}
    return ReducedComponent(**given, **kept, report=_report(reduction["report"]), reduced_units=str(reduction["units"]))


def _report(values: dict[str, Any]) -> ReductionReport:
    wrong = [f.name for f in fields(ReductionReport) if f.name in values and not _fits(values[f.name], str(f.type))]
    if wrong:
        raise ModelError(f"the reduction's report has unusable values of {', '.join(wrong)}")
    given: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in values.items()}
    return ReductionReport(**given)


def _fits(value: Any, kind: str) -> bool:
    if value is None:
        return "None" in kind
    if kind.startswith("tuple"):
        return isinstance(value, list) and all(map(is_number, value))
    return isinstance(value, str) if kind == "str" else isinstance(value, bool) if kind == "bool" else is_number(value)
