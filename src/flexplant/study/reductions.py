"""What a study's reductions chose: a sentence and a row for each component that was reduced in it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexplant.assembly import System
from flexplant.reduction import ReducedComponent
from flexplant.study.schema import ComponentSpec, StudySpec
from flexplant.study.schema_reduce import ReduceSpec
from flexplant.verification import Table

TITLE = "Reductions of this study"
COLUMNS = (
    "component",
    "method",
    "model DOF",
    "boundary",
    "modal",
    "interface",
    "complete below [Hz]",
    "bound [%]",
    "full basis [MB]",
)


def reductions_table(study: StudySpec, system: System) -> Table | None:
    """Sizes, ranges and bounds; None where nothing was reduced here."""
    rows = tuple(_row(component) for _, component in _reduced(study, system))
    return Table(TITLE, COLUMNS, rows) if rows else None


def reductions_text(study: StudySpec, system: System) -> str:
    """ "Reduced here: plate by Rubin from 324 DOF to 6 boundary and 27 modal DOF, node 9001 averaging a patch of 12." """
    parts = [_sentence(how, component) for how, component in _reduced(study, system)]
    return f"Reduced here: {'; '.join(parts)}." if parts else ""


def how_reduced(spec: ComponentSpec) -> str:
    """ " by rubin with 20 modes", for a component of the study file that is compared only."""
    how = spec.reduce
    if how is None:
        return ""
    modes = f"{how.n_modes} modes" if how.n_modes is not None else f"modes up to {how.max_frequency_hz:g} Hz"
    if how.method != "craig_bampton":
        return f" by {how.method}" + (f" with {modes}" if how.method == "rubin" else "")
    return f" with {modes} and {how.residual_vectors} block{'s'[: how.residual_vectors != 1]} of Ritz vectors"


def _reduced(study: StudySpec, system: System) -> Iterator[tuple[ReduceSpec, ReducedComponent]]:
    for name, spec in study.components.items():
        component = system.component(name)
        if spec.reduce is not None and isinstance(component, ReducedComponent):
            yield spec.reduce, component


def _row(component: ReducedComponent) -> tuple[object, ...]:
    report = component.report
    interface = f"{report.interface_coordinates} for {report.interface_dofs}" if report.interface_dofs else ""
    complete = report.complete_below_hz
    return (
        component.name,
        report.method,
        len(component.model_dofs),
        component.n_boundary,
        component.n_modal,
        interface,
        complete if 0 < complete < np.inf else "",
        "" if report.verified is None else 100 * report.verified,
        report.basis_bytes / 1e6,
    )


def _sentence(how: ReduceSpec, component: ReducedComponent) -> str:
    report = component.report
    text = (
        f"{component.name} by {report.method} from {len(component.model_dofs)} DOF to {component.n_boundary} boundary and "
        f"{component.n_modal} modal DOF"
    )
    if report.verified is not None:
        text += f", frequency errors up to {report.max_frequency_hz:g} Hz bounded by {100 * report.verified:.2g} %"
    if report.interface_dofs:
        text += f", {report.interface_coordinates} coordinates standing for {report.interface_dofs} DOF of its interface"
    return text + "".join(_patch(node.node, node.kind) for node in how.interface_nodes)


def _patch(node: int, kind: str) -> str:
    return f", node {node} {'averaging its patch' if kind == 'average' else 'moving its patch rigidly'}"
