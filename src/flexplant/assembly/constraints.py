"""Constraint rows of connections: frames, offsets and directions turned into sparse coefficients."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from flexplant.assembly.connection import GROUND, Connection
from flexplant.assembly.matching import default_tolerance, find_component, node_pairs
from flexplant.assembly.pairs import coordinate_pair
from flexplant.errors import CouplingError, ModelError
from flexplant.model.arrays import FloatArray
from flexplant.model.component import Component
from flexplant.model.dofs import expand_directions
from flexplant.model.geometry import Placement, cross_matrix

Terms: TypeAlias = dict[tuple[str, int, int], float]  # (component, node, direction) -> coefficient
CLEAN = 1e-14  # direction cosines closer than this to 0 or +-1 are round-off of frames that are aligned


@dataclass(frozen=True)
class Row:
    """One constraint row: coefficients over (component, node, direction)."""

    label: str
    connection: str
    terms: Terms
    ground: bool = False
    geometric: bool = True  # False: coordinates are equated on the user's word, whatever the geometry says


@dataclass(frozen=True)
class Resolved:
    """A connection with its node pairs and rows; gap: largest distance between two connected nodes."""

    connection: Connection
    pairs: list[tuple[int, int | None]]
    rows: list[Row]
    gap: float = 0.0


@dataclass(frozen=True)
class _Side:
    """One node of a component, seen from the system."""

    component: Component
    node: int
    placement: Placement
    axes: FloatArray = field(init=False)  # (3, 3): u_system = axes @ u_displacement

    def __post_init__(self) -> None:
        nodes = self.component.nodes
        frame = np.eye(3) if nodes is None else nodes.frame(self.node)
        object.__setattr__(self, "axes", self.placement.rotation @ frame.T)

    @property
    def position(self) -> FloatArray | None:
        nodes = self.component.nodes
        return None if nodes is None else self.placement.apply(nodes.position(self.node))


def resolve(connection: Connection, components: Mapping[str, Component], placements: Mapping[str, Placement]) -> Resolved:
    """Pairs and constraint rows of one connection; CouplingError names what does not fit."""
    owner = f"connection {connection.name!r}"
    for name in (connection.a, connection.b):
        if name != GROUND:
            find_component(name, components, owner)
    if connection.by_coordinate:
        return Resolved(connection, [], [_coordinate_row(connection, p, components) for p in connection.pairs])
    pairs = node_pairs(connection, components, placements)
    rows: list[Row] = []
    gap = 0.0
    for node_a, node_b in pairs:
        a = _Side(components[connection.a], node_a, placements.get(connection.a, Placement()))
        b = None if node_b is None else _Side(components[connection.b], node_b, placements.get(connection.b, Placement()))
        arm = _arm(connection, a, b)
        gap = max(gap, float(np.linalg.norm(arm)))
        rows.extend(_rows_of_pair(connection, a, b, arm))
    return Resolved(connection, pairs, rows, gap)


def _arm(connection: Connection, a: _Side, b: _Side | None) -> FloatArray:
    """Vector from node a to node b in the system frame, zero where they coincide or a position is unknown."""
    if b is None or a.position is None or b.position is None:
        return np.zeros(3)
    arm = b.position - a.position
    same = default_tolerance(a.component, b.component)  # a wider tolerance finds partners; the gap stays a gap
    tolerance = same if connection.tolerance is None else max(same, connection.tolerance)
    distance = float(np.linalg.norm(arm))
    if distance <= same:
        return np.zeros(3)
    if connection.offset == "forbid" and distance > tolerance:
        raise CouplingError(
            f"connection {connection.name!r}: {a.component.name}.{a.node} and {b.component.name}.{b.node} are {distance:.4g} "
            f"apart (tolerance {tolerance:.3g}); correct the placement, or use offset='rigid' or 'ignore'"
        )
    return arm


def _frame(connection: Connection, a: _Side, b: _Side | None) -> FloatArray:
    """(3, 3), rows are the connection's axes in the system frame."""
    if not isinstance(connection.frame, str):
        return connection.frame
    if connection.frame == "system":
        return np.eye(3)
    return (a if connection.frame == "a" or b is None else b).axes.T


def _clean(matrix: FloatArray) -> FloatArray:
    rounded = np.round(matrix)
    return np.where(abs(matrix - rounded) < CLEAN, rounded, matrix)


def _rows_of_pair(connection: Connection, a: _Side, b: _Side | None, arm: FloatArray) -> Iterator[Row]:
    """Rows C (u_a + theta_a x r - u_b) = 0 and C (theta_a - theta_b) = 0, in the connection's axes C."""
    axes = _frame(connection, a, b)
    linked = connection.offset == "rigid" and bool(arm.any())
    turn_a = _clean(axes @ a.axes)
    arm_a = -axes @ cross_matrix(arm) @ a.axes if linked else np.zeros((3, 3))
    turn_b = None if b is None else _clean(axes @ b.axes)
    for direction in expand_directions(connection.directions):
        axis, rotation = (direction - 1) % 3, direction > 3
        terms = _terms(a, turn_a[axis], rotation, 1.0)
        if linked and not rotation:
            terms |= _terms(a, arm_a[axis], True, 1.0)
        if b is not None and turn_b is not None:
            for key, value in _terms(b, turn_b[axis], rotation, -1.0).items():
                terms[key] = terms.get(key, 0.0) + value
        _refuse_self(connection, terms, a.node)
        label = f"{connection.name}.{a.node}.{direction}"
        geometric = connection.offset == "rigid" or not arm.any()
        yield Row(label, str(connection.name), _existing(connection, terms, (a, b)), b is None, geometric)


def _terms(side: _Side, coefficients: FloatArray, rotation: bool, sign: float) -> Terms:
    first = 4 if rotation else 1
    return {(side.component.name, side.node, first + i): sign * float(c) for i, c in enumerate(coefficients) if c != 0.0}


def _existing(connection: Connection, terms: Terms, sides: tuple[_Side, _Side | None]) -> Terms:
    for name, node, direction in terms:
        side = next(s for s in sides if s is not None and s.component.name == name and s.node == node)
        if (node, direction) not in side.component.boundary:
            here = "".join(str(d) for n, d in side.component.boundary.pairs if n == node)
            raise CouplingError(
                f"connection {connection.name!r}: {name}.{node} has no boundary DOF in direction {direction} (it has {here}); "
                f"name the directions to couple with directions={here!r}, or check the frames; a gap needs rotations for its "
                "rigid link, or offset='ignore'"
            )
    return terms


def _coordinate_row(connection: Connection, pair: Any, components: Mapping[str, Component]) -> Row:
    terms: Terms = {}
    dofs = coordinate_pair(pair, f"connection {connection.name!r}")
    for name, (node, direction), sign in ((connection.a, dofs[0], 1.0), (connection.b, dofs[1], -1.0)):
        component = components[name]
        try:
            component.dofs.row(node, direction, owner=f"component {name!r}")
        except ModelError as error:
            raise CouplingError(f"connection {connection.name!r}: {error}") from None
        terms[(name, node, direction)] = terms.get((name, node, direction), 0.0) + sign
    (node_a, direction_a) = dofs[0]
    _refuse_self(connection, terms, node_a)
    return Row(f"{connection.name}.{node_a}.{direction_a}", str(connection.name), terms, geometric=connection.offset == "rigid")


def _refuse_self(connection: Connection, terms: Terms, node: int) -> None:
    if not any(terms.values()):
        raise CouplingError(f"connection {connection.name!r} ties node {node} of {connection.a!r} to itself; remove that pair")


def duplicates(rows: list[Row]) -> list[tuple[Row, Row]]:
    """Pairs of rows that state the same thing about the same coordinates, up to a factor."""
    seen: dict[tuple[tuple[tuple[str, int, int], float], ...], Row] = {}
    out = []
    for row in rows:
        terms = {k: v for k, v in row.terms.items() if v}
        first = terms[min(terms)]
        key = tuple(sorted((k, round(v / first, 9)) for k, v in terms.items()))
        if key in seen:
            out.append((seen[key], row))
        seen.setdefault(key, row)
    return out
