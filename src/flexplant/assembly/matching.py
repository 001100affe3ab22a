"""Resolve the pairs of a connection: node ids, single coordinates, or positions within a tolerance."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flexplant.assembly.connection import GROUND, Connection
from flexplant.assembly.pairs import Pair
from flexplant.errors import CouplingError, nearest
from flexplant.model.arrays import FloatArray
from flexplant.model.component import Component
from flexplant.model.geometry import Placement

POSITION_TOLERANCE = 1e-6  # of the larger component's extent, when the connection names no tolerance


def find_component(name: str, components: Mapping[str, Component], owner: str) -> Component:
    """The component of that name; CouplingError suggests the nearest."""
    if name not in components:
        raise CouplingError(f"{owner}: no component is called {name!r}." + nearest(name, components))
    return components[name]


def node_pairs(connection: Connection, components: Mapping[str, Component], placements: Mapping[str, Placement]) -> list[Pair]:
    """[(node_a, node_b or None for ground), ...] of a connection given by node ids or by position."""
    if isinstance(connection.pairs, str):
        return list(by_position(connection, components, placements))
    out = connection.listed_nodes()
    for side, name in ((0, connection.a), (1, connection.b)):
        if name == GROUND:
            continue
        component = find_component(name, components, f"connection {connection.name!r}")
        chosen = [p[side] for p in out]
        missing = [n for n in chosen if n not in component.boundary.nodes]
        if missing:
            known = [str(n) for n in component.boundary.nodes]
            raise CouplingError(
                f"connection {connection.name!r}: component {name!r} has no boundary node {', '.join(map(str, missing[:8]))}."
                + nearest(str(missing[0]), known)
            )
        twice = sorted({n for n in chosen if chosen.count(n) > 1 and n is not None})
        if twice and len(set(out)) < len(out):
            raise CouplingError(f"connection {connection.name!r}: node {twice[0]} of {name!r} is coupled twice to the same node")
    return out


def _positions(component: Component, placement: Placement, owner: str, only: object = None) -> tuple[list[int], FloatArray]:
    if component.nodes is None:
        raise CouplingError(f"{owner}: component {component.name!r} has no node positions; couple by node ids instead")
    ids = component.boundary.nodes if only is None else [int(n) for n in only]  # type: ignore[attr-defined]
    missing = [n for n in ids if n not in component.boundary.nodes]
    if missing:
        raise CouplingError(f"{owner}: component {component.name!r} has no boundary node {missing[0]}")
    return ids, placement.apply(np.array([component.nodes.position(n) for n in ids]).reshape(-1, 3))


def default_tolerance(*components: Component) -> float:
    """Distance below which two nodes coincide: 1e-6 of the larger extent."""
    extents = [c.nodes.extent for c in components if c.nodes is not None]
    return POSITION_TOLERANCE * max([e for e in extents if e > 0], default=1.0)


def by_position(
    connection: Connection, components: Mapping[str, Component], placements: Mapping[str, Placement]
) -> list[tuple[int, int]]:
    """Match nodes by position; ambiguous or missing matches raise CouplingError that lists the nodes."""
    from scipy.spatial import cKDTree  # takes a while to import, and most systems are joined by numbers

    owner = f"connection {connection.name!r}"
    a, b = (find_component(n, components, owner) for n in (connection.a, connection.b))
    ids_a, at_a = _positions(a, placements.get(a.name, Placement()), owner, connection.nodes)
    ids_b, at_b = _positions(b, placements.get(b.name, Placement()), owner)
    tolerance = default_tolerance(a, b) if connection.tolerance is None else float(connection.tolerance)
    near = cKDTree(at_b).query_ball_point(at_a, tolerance) if len(ids_b) and len(ids_a) else []
    pairs = [(ids_a[i], ids_b[j]) for i, js in enumerate(near) for j in js]
    _refuse_ambiguous(owner, pairs, a.name, b.name, tolerance)
    missing_a = [n for n in ids_a if n not in {p[0] for p in pairs}]
    missing_b = [n for n in ids_b if n not in {p[1] for p in pairs}]
    if missing_a and (missing_b or connection.nodes is not None):
        distance = cKDTree(at_b).query(at_a)[0] if len(ids_b) else np.full(len(ids_a), np.inf)
        shown = ", ".join(f"{n} (nearest {distance[ids_a.index(n)]:.3g} away)" for n in missing_a[:8])
        raise CouplingError(
            f"{owner}: {len(missing_a)} nodes of {a.name!r} have no node of {b.name!r} within {tolerance:.3g}: {shown}; "
            f"unmatched in {b.name!r}: {missing_b[:8]}. List the interface nodes with nodes=[...], place the components, "
            "or set tolerance="
        )
    return pairs


def _refuse_ambiguous(owner: str, pairs: list[tuple[int, int]], a: str, b: str, tolerance: float) -> None:
    for side, name in ((0, a), (1, b)):
        seen = [p[side] for p in pairs]
        twice = sorted({n for n in seen if seen.count(n) > 1})
        if twice:
            others = [p[1 - side] for p in pairs if p[side] == twice[0]]
            raise CouplingError(
                f"{owner}: node {twice[0]} of {name!r} matches several nodes {others} within {tolerance:.3g}; "
                f"make the tolerance smaller or give the pairs (also ambiguous: {twice[1:8]})"
            )
