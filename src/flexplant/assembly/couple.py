"""Couple components: equations 5-11, dual or primal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import accumulate
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from flexplant.assembly.agreement import check_units, warn_of_long_links
from flexplant.assembly.connection import GROUND, Connection
from flexplant.assembly.constraints import Resolved, Row, duplicates, resolve
from flexplant.assembly.system import METHODS, System, component_rigid_body
from flexplant.errors import CouplingError, nearest
from flexplant.model.arrays import items_of
from flexplant.model.component import Component, check_name
from flexplant.model.geometry import Placement
from flexplant.numerics.elimination import Elimination, eliminate

Offsets: TypeAlias = Mapping[str, slice]
ByName: TypeAlias = Mapping[str, Component]
RIGID_TOLERANCE = 1e-5  # relative strain of a rigid motion; node positions coincide to 1e-6 of a component's extent


def couple(
    components: Sequence[Component] | Mapping[str, Component],
    connections: Iterable[Connection] = (),
    *,
    method: str = "dual",
    placements: Mapping[str, Placement] | None = None,
) -> System:
    """Couple components at their boundary DOF into a `System`.

    components: with distinct names; a mapping {name: component} makes named copies of the same component.
    connections: see `Connection`. method: "dual" (bordered, equations 5-11) or "primal" (eliminated); the same physics.
    placements: by component name, x_system = rotation @ x_component + translation.
    Raises CouplingError for unknown names, missing or doubly coupled DOF, ambiguous positions, contradictory
    constraints (rows that strain a rigid-body motion, or that together lock a DOF nobody grounded) and clashing units.
    Warns (`PlausibilityWarning`) where only some components state their units, and of rigid links longer than what they join.
    """
    if not isinstance(method, str) or method not in METHODS:
        raise CouplingError(f"method {method!r:.60}: use 'dual' or 'primal'." + nearest(method, METHODS))
    parts = _named(components)
    by_name = {c.name: c for c in parts}
    if placements is not None and not isinstance(placements, Mapping):
        raise CouplingError(f"placements must be {{component name: Placement}}, got {type(placements).__name__}")
    placements = dict(placements or {})
    for name in placements:
        if name not in by_name:
            raise CouplingError(f"placements: no component is called {name!r}." + nearest(name, by_name))
        if not isinstance(placements[name], Placement):
            raise CouplingError(f"placements: {name!r} needs a Placement, got {type(placements[name]).__name__}")
    check_units(parts)
    resolved = [resolve(c, by_name, placements) for c in _distinct(connections)]
    warn_of_long_links(resolved, by_name)
    return assembled(parts, placements, resolved, method)


def assembled(
    parts: tuple[Component, ...], placements: Mapping[str, Placement], resolved: Sequence[Resolved], method: str
) -> System:
    """The system of components whose connections are resolved into rows; errors as for `couple`."""
    by_name = {c.name: c for c in parts}
    ends = list(accumulate(c.n for c in parts))
    offsets = {c.name: slice(end - c.n, end) for c, end in zip(parts, ends, strict=True)}
    rigid = [row for r in resolved if r.connection.rigid for row in r.rows]
    rigid.sort(key=lambda row: row.ground)  # ground last: what the others lock between them shows before it is clamped
    _check_rows(rigid, parts, placements)
    rows = _matrix(rigid, offsets, by_name)
    solved = eliminate(rows)
    _refuse_locked(rigid, solved, offsets, by_name)
    labels = [row.label for row in rigid]
    return System(
        components=parts,
        placements=placements,
        connections=tuple(resolved),
        method=method,
        offsets=offsets,
        uncoupled_mass=_block([c.mass for c in parts]),
        uncoupled_stiffness=_block([c.stiffness for c in parts]) + _compliance(resolved, "stiffness", offsets, by_name),
        uncoupled_damping=_block([_damping(c) for c in parts]) + _compliance(resolved, "damping", offsets, by_name),
        uncoupled_structural_damping=_structural(parts),
        constraints=sp.csr_array(rows[solved.independent]),
        constraint_labels=tuple(labels[i] for i in solved.independent),
        redundant=tuple(labels[i] for i in solved.redundant),
        basis=solved.basis,
        kept=solved.kept,
        springs=_spring_rows(resolved, offsets, by_name),
        grounded=any(r.connection.b == GROUND for r in resolved),
    )


def _named(components: Sequence[Component] | Mapping[str, Component]) -> tuple[Component, ...]:
    if isinstance(components, Component):
        components = [components]
    if isinstance(components, Mapping):
        components = [_copy(c, name) for name, c in components.items()]
    listed = items_of(components)
    if listed is None:
        raise CouplingError(f"couple takes a list of Components, got {type(components).__name__}")
    components = tuple(listed)
    for item in components:
        if not isinstance(item, Component):
            raise CouplingError(f"couple takes Components, got {type(item).__name__}; reduce a model first, with craig_bampton")
    names = [c.name for c in components]
    if not names:
        raise CouplingError("couple needs at least one component")
    twice = sorted({n for n in names if names.count(n) > 1}) if len(set(names)) < len(names) else []
    if twice:
        raise CouplingError(
            f"components called {twice[0]!r} appear {names.count(twice[0])} times; give copies names: {{'a': c, 'b': c}}"
        )
    if GROUND in names:
        raise CouplingError("a component must not be called 'ground': that name clamps nodes")
    return components


def _copy(component: Component, name: str) -> Component:
    return replace(component, name=check_name(name, "component")) if isinstance(component, Component) else component


def _distinct(connections: Iterable[Connection]) -> list[Connection]:
    """Connections with distinct names; an unnamed second one between the same components gets a number."""
    taken: dict[str, int] = {}
    out = []
    given = [connections] if isinstance(connections, Connection) else items_of(connections)
    if given is None or isinstance(connections, Mapping):
        raise CouplingError(f"connections must be a list of Connection, got {type(connections).__name__}")
    for connection in given:
        if not isinstance(connection, Connection):
            raise CouplingError(f"connections must be a list of Connection, got {type(connection).__name__} {connection!r}")
        base = str(connection.name)
        taken[base] = taken.get(base, 0) + 1
        out.append(connection if taken[base] == 1 else replace(connection, name=f"{base}-{taken[base]}"))
    return out


def _check_rows(rows: list[Row], parts: Sequence[Component], placements: Mapping[str, Placement]) -> None:
    for first, second in duplicates(rows)[:1]:
        raise CouplingError(f"the same DOF are coupled twice, by {first.label} and by {second.label}; keep one of them")
    rigid = {c.name: component_rigid_body(c, placements.get(c.name)) for c in parts if c.nodes is not None}
    lookup = {c.name: c.dofs for c in parts}
    for row in rows:
        if row.ground or not row.geometric or any(name not in rigid for name, _, _ in row.terms):
            continue
        motions = [value * rigid[name][lookup[name].row(node, d)] for (name, node, d), value in row.terms.items()]
        size = np.max(np.abs(motions), axis=0)
        if (abs(np.sum(motions, axis=0)) > RIGID_TOLERANCE * np.maximum(size, 1.0)).any():
            raise CouplingError(
                f"constraint {row.label} contradicts rigid-body motion: it ties DOF whose positions or axes differ and would "
                "ground the system; couple nodes instead of single coordinates, correct the placement, or use offset='ignore'"
            )


def _matrix(rows: Sequence[Row], offsets: Offsets, by_name: ByName) -> sp.csr_array:
    entries = [
        (i, offsets[name].start + by_name[name].dofs.row(node, direction), value)
        for i, row in enumerate(rows)
        for (name, node, direction), value in row.terms.items()
    ]
    n = sum(c.n for c in by_name.values())
    at, columns, values = (np.array(x) for x in zip(*entries, strict=True)) if entries else (np.zeros(0, int),) * 3
    return sp.csr_array((values.astype(float), (at, columns)), shape=(len(rows), n))


def _refuse_locked(
    rows: Sequence[Row], solved: Elimination, offsets: Mapping[str, slice], by_name: Mapping[str, Component]
) -> None:
    for i, column in solved.locked.items():
        if rows[i].ground or not rows[i].geometric:
            continue
        name = next(n for n, s in offsets.items() if s.start <= column < s.stop)
        node, direction = by_name[name].dofs.pairs[column - offsets[name].start]
        raise CouplingError(
            f"contradictory constraints: together with {rows[i].label} the connections lock {name}.{node}.{direction} "
            "although nothing grounds it; check signs, frames and placements of the connections at this node"
        )


def _damping(component: Component) -> Any:
    return sp.csr_array((component.n, component.n)) if component.damping is None else component.damping


def _structural(parts: Sequence[Component]) -> sp.csr_array | None:
    if all(c.structural_damping is None for c in parts):
        return None
    return _block([sp.csr_array((c.n, c.n)) if c.structural_damping is None else c.structural_damping for c in parts])


def _block(matrices: Sequence[Any]) -> sp.csr_array:
    sparse: dict[int, Any] = {id(m): sp.coo_array(m) for m in {id(m): m for m in matrices}.values()}
    return sp.csr_array(sp.block_diag([sparse[id(m)] for m in matrices], format="csr"))


def _spring_rows(resolved: Sequence[Resolved], offsets: Offsets, by_name: ByName) -> sp.csr_array:
    """Rows of the relative motions that compliant connections resist: orthonormal in the range of each stiffness."""
    rows = [sp.csr_array((0, sum(c.n for c in by_name.values())))]
    for r in resolved:
        if r.connection.stiffness is not None:
            values, vectors = np.linalg.eigh(np.asarray(r.connection.stiffness))
            resisted = vectors[:, abs(values) > 1e-12 * abs(values).max(initial=0.0)].T
            count = len(r.rows) // values.size
            rows.append(sp.kron(sp.eye_array(count), resisted) @ _matrix(r.rows, offsets, by_name))
    return sp.csr_array(sp.vstack(rows))


def _compliance(
    resolved: Sequence[Resolved], kind: str, offsets: Mapping[str, slice], by_name: Mapping[str, Component]
) -> sp.csr_array:
    """Sum over compliant connections of G^T k G, G the rows that a rigid connection would constrain."""
    n = sum(c.n for c in by_name.values())
    total = sp.csr_array((n, n))
    for r in resolved:
        matrix = getattr(r.connection, kind)
        if matrix is not None:
            relative = _matrix(r.rows, offsets, by_name)
            springs = sp.kron(sp.eye_array(len(r.rows) // matrix.shape[0]), matrix)
            total = sp.csr_array(total + relative.T @ springs @ relative)
    return total
