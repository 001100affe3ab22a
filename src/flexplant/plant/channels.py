"""Named inputs and outputs of a system: what a name selects, as sparse rows over the uncoupled coordinates p."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from flexplant.assembly import System
from flexplant.errors import InputError, nearest
from flexplant.model.arrays import items_of
from flexplant.model.recovery_units import row_units
from flexplant.plant.interface_force import ForceRow, force_labels, force_row

DERIVATIVES = {":v": 1, ":a": 2}
UNIT_SUFFIX = ("", "/s", "/s^2")


@dataclass(frozen=True, eq=False)
class InputColumns:
    """names (nu,), matrix (n, nu) CSR: p-coordinate forces of unit inputs, units (nu,)."""

    names: tuple[str, ...]
    matrix: sp.csr_array
    units: tuple[str, ...]

    def __iter__(self) -> Any:
        """Unpacks as names, matrix."""
        return iter((self.names, self.matrix))


@dataclass(frozen=True, eq=False)
class OutputRows:
    """y = displacement p + velocity p' + acceleration p'' + force F u, with F the input matrix.

    displacement, velocity, acceleration, force: (ny, n) CSR or None where no output needs them.
    is_multiplier: (ny,) True for forces of rigid connections: their rows hold -K, -Z, -M and F of one multiplier.
    """

    names: tuple[str, ...]
    displacement: sp.csr_array
    velocity: sp.csr_array | None
    acceleration: sp.csr_array | None
    force: sp.csr_array | None
    is_multiplier: npt.NDArray[np.bool_]
    units: tuple[str, ...]


@dataclass(frozen=True)
class _Channel:
    """One output: sparse (1, n) rows by kind ("displacement", "velocity", "acceleration", "force")."""

    name: str
    rows: dict[str, Any]
    units: str = ""


def input_matrix(system: System, inputs: Sequence[str]) -> InputColumns:
    """Force inputs "component.node.direction": a unit force (N) or moment (N m) on that DOF, in the node's displacement frame.

    The DOF is on the boundary, or one of the component's `interior` (the `loads` of its reduction), where the force acts as
    T^T F. Several digits expand ("bus.101.123"); direction 0 is a generalised force on a scalar or modal coordinate.
    Raises InputError with the nearest names for an unknown component, node or direction.
    """
    found: list[tuple[str, sp.csr_array, str]] = []
    for name in listed_names(inputs, "inputs"):
        component, node, directions = _dof_name(system, name)
        found += [(f"{component}.{node}.{d}", _row(system, component, node, d, name), _unit(d, "N", "N m")) for d in directions]
    names = _distinct([f[0] for f in found], "inputs")
    rows = [f[1] for f in found]
    matrix = sp.csr_array(sp.vstack(rows).T) if rows else sp.csr_array((system.n, 0))
    return InputColumns(names, matrix, tuple(f[2] for f in found))


def output_matrices(system: System, outputs: Sequence[str]) -> OutputRows:
    """Output rows over p.

    "component.node.direction": displacement in the node's displacement frame; ":v" its velocity, ":a" its acceleration.
    "component.recovery.label", or "component.recovery" for all its rows; ":v" and ":a" differentiate displacement rows.
    "connection.force.node_a.direction": force that side a exerts on side b; "connection.force" for all of them.
    Raises InputError with the nearest names for what is not there.
    """
    channels = [channel for name in listed_names(outputs, "outputs") for channel in _output(system, name)]
    stacked = {kind: _stack(channels, kind, system.n) for kind in ("displacement", "velocity", "acceleration", "force")}
    used = {kind: m if any(kind in c.rows for c in channels) else None for kind, m in stacked.items()}
    return OutputRows(
        names=_distinct([c.name for c in channels], "outputs"),
        displacement=stacked["displacement"],
        velocity=used["velocity"],
        acceleration=used["acceleration"],
        force=used["force"],
        is_multiplier=np.array(["force" in c.rows for c in channels], dtype=bool),
        units=tuple(c.units for c in channels),
    )


def listed_names(names: Sequence[str], what: str) -> list[str]:
    """The names as a list; InputError for one text or anything that is no name."""
    listed = items_of(names)
    if listed is None or not all(isinstance(name, str) for name in listed):
        raise InputError(f"{what} must be a list of names such as ['bus.101.1'], got {names!r:.60}")
    return listed


def checked_system(system: object, what: str) -> None:
    """InputError unless `system` is coupled."""
    if not isinstance(system, System):
        raise InputError(f"{what} takes a coupled System, got {type(system).__name__}; use couple([component]), reduced before")


def refuse_structural_damping(system: System, what: str, instead: str) -> None:
    """InputError where a component has structural damping, which has no time-domain form; `instead`: what to do."""
    names = [c.name for c in system.components if c.structural_damping is not None]
    if names:
        raise InputError(f"{what}: component {names[0]!r} has structural damping, which has no time-domain form; {instead}")


def _distinct(names: list[str], what: str) -> tuple[str, ...]:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{what} listed twice: {', '.join(twice[:8])}")
    return tuple(names)


def _stack(channels: list[_Channel], kind: str, n: int) -> sp.csr_array:
    empty = sp.csr_array((1, n))
    blocks = [sp.csr_array(c.rows.get(kind, empty)) for c in channels]
    return sp.csr_array(sp.vstack(blocks)) if blocks else sp.csr_array((0, n))


def _unit(direction: int, translation: str, rotation: str) -> str:
    return "" if direction == 0 else translation if direction <= 3 else rotation


def _dof_name(system: System, name: str) -> tuple[str, int, tuple[int, ...]]:
    """(component, node, directions) of "component.node.directions"; InputError suggests real names."""
    parts = name.split(".")
    if len(parts) != 3 or not all(p.isascii() and p.isdigit() for p in parts[1:]):
        raise InputError(f"{name!r} is not 'component.node.direction'." + nearest(name, system.labels))
    component, node = system.component(parts[0]), int(parts[1])
    directions = tuple(int(d) for d in parts[2])
    if len(set(directions)) != len(directions) or max(directions) > 6:
        raise InputError(f"{name!r}: directions must be distinct digits 1-6 (0 for a scalar or modal coordinate)")
    return component.name, node, directions


def _row(system: System, component: str, node: int, direction: int, name: str) -> sp.csr_array:
    try:
        return system.dof_row(component, node, direction)
    except InputError as error:
        labels = [label for label in system.labels if label.startswith(f"{component}.")]
        labels += [f"{component}.{n}.{d}" for n, d in system.component(component).interior.pairs]
        raise InputError(f"{name!r}: {error}" + nearest(f"{component}.{node}.{direction}", labels)) from None


def _output(system: System, name: str) -> list[_Channel]:
    stem, order = (name[:-2], DERIVATIVES[name[-2:]]) if name[-2:] in DERIVATIVES else (name, 0)
    parts = name.split(".")
    is_component = any(c.name == parts[0] for c in system.components)
    if not is_component and len(parts) > 1 and parts[1].partition(":")[0] == "force":
        return _interface(system, name, order)
    if not is_component:
        raise InputError(
            f"{name!r}: the system has no component or connection {parts[0]!r}." + nearest(parts[0], _first_parts(system))
        )
    component = system.component(parts[0])
    recovery = stem.split(".")[1] if "." in stem else ""
    if recovery in component.recovery:
        return _recovered(system, name, stem, order)
    if not (recovery.isascii() and recovery.isdigit()):
        known = [f"{component.name}.{r}" for r in component.recovery] + [
            f"{component.name}.{n}.{d}" for n, d in component.boundary.pairs
        ]
        raise InputError(f"{name!r} is neither a DOF nor a recovery of component {component.name!r}." + nearest(stem, known))
    return _displacement(system, stem, name[len(stem) :], order)


def _first_parts(system: System) -> list[str]:
    return [c.name for c in system.components] + [str(r.connection.name) for r in system.connections]


def _displacement(system: System, stem: str, suffix: str, order: int) -> list[_Channel]:
    component, node, directions = _dof_name(system, stem)
    out = []
    for d in directions:
        row = _row(system, component, node, d, stem + suffix)
        kind = ("displacement", "velocity", "acceleration")[order]
        unit = _unit(d, "m", "rad")
        out.append(_Channel(f"{component}.{node}.{d}{suffix}", {kind: row}, unit and unit + UNIT_SUFFIX[order]))
    return out


def _recovered(system: System, name: str, stem: str, order: int) -> list[_Channel]:
    component_name, recovery_name = name.split(".")[:2]
    recovery_name, _, label = stem.partition(".")[2].partition(".")
    recovery = system.component(component_name).recovery[recovery_name]
    full_label = name.partition(".")[2].partition(".")[2]
    if full_label in recovery.labels:  # a label may itself end in ":v"
        label, order = full_label, 0
    suffix = "" if order == 0 else name[-2:]
    labels = [label] if label else list(recovery.labels)
    return [_recovery_row(system, component_name, recovery_name, one, order, suffix) for one in labels]


def _recovery_row(system: System, component: str, recovery_name: str, label: str, order: int, suffix: str) -> _Channel:
    recovery = system.component(component).recovery[recovery_name]
    name = f"{component}.{recovery_name}.{label}"
    if label not in recovery.labels:
        raise InputError(f"{name!r}: " + f"no such row in recovery {recovery_name!r}." + nearest(label, recovery.labels))
    at = recovery.row(label)
    kinds = ("displacement", "velocity", "acceleration")
    given = {k: getattr(recovery, k) for k in kinds if getattr(recovery, k) is not None}
    rows = {k: system.spread(component, sp.csr_array(m)[[at], :]) for k, m in given.items()}
    used = {k: row for k, row in rows.items() if row.nnz or k == "displacement"}
    if order and set(used) - {"displacement"}:
        raise InputError(
            f"{name + suffix!r}: the row has velocity or acceleration parts of its own, so it cannot be differentiated"
        )
    shifted = {kinds[kinds.index(k) + order]: row for k, row in used.items()}
    units = row_units(recovery, label)
    return _Channel(name + suffix, shifted, units and units + UNIT_SUFFIX[order])


def _interface(system: System, name: str, order: int) -> list[_Channel]:
    if order:
        raise InputError(f"{name!r}: interface forces have no ':v' or ':a'")
    connection, _, rest = name.partition(".force")
    labels = force_labels(system, connection, rest.lstrip("."), name)
    return [_force_channel(connection, label, force_row(system, label)) for label in labels]


def _force_channel(connection: str, label: str, row: ForceRow) -> _Channel:
    node, direction = label.split(".")[-2:]
    unit = _unit(int(direction), "N", "N m")
    return _Channel(f"{connection}.force.{node}.{direction}", row, unit)
