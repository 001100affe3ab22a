"""Comparison with reference modes: frequencies, relative errors, MAC of clusters of close modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from flexplant.assembly import System
from flexplant.errors import InputError, expect_text, nearest
from flexplant.model.arrays import FloatArray, checked_matrix, dense, frozen, is_number, items_of, real_values
from flexplant.model.table import Table
from flexplant.modes import Modes

CLUSTER = 2e-3  # relative gap below which neighbouring modes may mix, so that only their subspaces compare


@dataclass(frozen=True, eq=False)
class Reference:
    """Reference modes: frequency_hz (k,), and optionally shapes (n_rows, k) at `labels`.

    labels: "component.node.direction" or "component.recovery.label", one a row. names: optional text per mode.
    Modes below `rigid_below_hz` count as rigid-body modes and are left out of the comparison. source: its name in tables.
    provenance: of the file that it was read from, as a component's `source`.
    """

    frequency_hz: FloatArray
    shapes: FloatArray | None = None
    labels: Sequence[str] = ()
    names: Sequence[str] = field(default_factory=tuple)
    rigid_below_hz: float = 0.01
    source: str = "reference"
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        hz = frozen(self.frequency_hz, what="reference: frequency_hz")
        if hz.ndim != 1 or not hz.size or not np.isfinite(hz).all():
            raise InputError(f"reference: frequency_hz must be a finite (k,) array, got shape {hz.shape}")
        object.__setattr__(self, "frequency_hz", hz)
        for kind in ("labels", "names"):
            listed = items_of(getattr(self, kind))
            if listed is None or not all(isinstance(text, str) for text in listed):
                raise InputError(f"reference: {kind} must be a list of texts, got {getattr(self, kind)!r:.60}")
        if not is_number(self.rigid_below_hz) or not 0 <= self.rigid_below_hz < np.inf:
            raise InputError(f"reference: rigid_below_hz must be a frequency in Hz from 0, got {self.rigid_below_hz!r:.60}")
        expect_text(self.source, "reference: source")
        if not isinstance(self.provenance, Mapping):
            raise InputError(f"reference: provenance must be a mapping, got {type(self.provenance).__name__}")
        if self.shapes is not None:
            sizes = f"reference: shapes of {len(self.labels)} labels x {hz.size} modes"
            checked_matrix(self.shapes, (len(self.labels), hz.size), sizes)


def as_reference(reference: Any) -> Reference:
    """A Reference from one, from Modes, or from a sequence of frequencies in Hz."""
    if isinstance(reference, Reference):
        return reference
    if isinstance(reference, Modes):
        return Reference(reference.frequency_hz)
    return Reference(real_values(reference, "reference frequencies"))


@dataclass(frozen=True, eq=False)
class Comparison:
    """Elastic modes side by side: ours and reference in Hz (k,), error in percent (k,), mac (k,) of clusters or None."""

    ours_hz: FloatArray
    reference_hz: FloatArray
    error_percent: FloatArray
    mac: FloatArray | None
    table: Table


def compare_modes(system: System, modes: Modes, reference: Any) -> Comparison:
    """Pair the elastic modes in ascending order and compare; shapes by MAC, clusters of close modes by subspace.

    The MAC of a cluster is the smallest squared cosine of the principal angles between the two subspaces.
    Raises InputError where the reference has more elastic modes than were computed.
    """
    reference = as_reference(reference)
    elastic = np.flatnonzero(abs(reference.frequency_hz) > reference.rigid_below_hz)
    target = reference.frequency_hz[elastic]
    ours = modes.frequency_hz[modes.n_rigid :]
    if target.size > ours.size:
        raise InputError(f"the reference has {target.size} elastic modes, only {ours.size} were computed; raise the limit")
    error = 100 * (ours[: target.size] / target - 1)
    mac = None
    if reference.shapes is not None:
        rows = recovery_rows(system, reference.labels)
        mine = dense(rows @ modes.shapes[:, modes.n_rigid : modes.n_rigid + target.size])
        mac = cluster_mac(target, mine, np.asarray(reference.shapes)[:, elastic])
    return Comparison(ours[: target.size], target, error, mac, _table(reference, elastic, target, ours, error, mac))


def _table(
    reference: Reference, elastic: Any, target: FloatArray, ours: FloatArray, error: FloatArray, mac: FloatArray | None
) -> Table:
    names = [reference.names[i] if i < len(reference.names) else f"mode {j + 1}" for j, i in enumerate(elastic)]
    columns: tuple[str, ...] = ("mode", f"{reference.source} [Hz]", "coupled [Hz]", "error [%]")
    rows: list[tuple[object, ...]] = list(zip(names, target.tolist(), ours[: target.size].tolist(), error.tolist(), strict=True))
    if mac is not None:
        columns, rows = (*columns, "MAC"), [(*row, value) for row, value in zip(rows, mac.tolist(), strict=True)]
    return Table("Elastic modes against the reference", columns, tuple(rows))


def cluster_mac(frequency_hz: FloatArray, ours: FloatArray, reference: FloatArray) -> FloatArray:
    """(k,) MAC per mode; modes closer than CLUSTER share the MAC of their subspaces. Shapes (n_rows, k)."""
    out = np.zeros(frequency_hz.size)
    breaks = np.flatnonzero(np.diff(frequency_hz) > CLUSTER * frequency_hz[:-1]) + 1
    for group in np.split(np.arange(frequency_hz.size), breaks):
        angles = la.subspace_angles(ours[:, group], reference[:, group])
        out[group] = np.cos(angles.max()) ** 2
    return out


def recovery_rows(system: System, labels: Sequence[str]) -> sp.csr_array:
    """(k, n) rows over uncoupled coordinates for "component.node.direction" or "component.recovery.label"."""
    rows = [_row(system, label) for label in labels]
    return sp.csr_array(sp.vstack(rows)) if rows else sp.csr_array((0, system.n))


def _row(system: System, label: str) -> sp.csr_array:
    component_name, _, rest = label.partition(".")
    component = system.component(component_name)
    head, _, tail = rest.partition(".")
    if head in component.recovery:
        recovery = component.recovery[head]
        if recovery.displacement is None:
            raise InputError(f"{label!r}: recovery {head!r} has no displacement rows to compare shapes with")
        return system.spread(component_name, sp.csr_array(recovery.displacement[[recovery.row(tail)]]))
    try:
        column = system.row(component_name, int(head), int(tail))
    except ValueError:
        known = [*component.recovery, *map(str, component.boundary.nodes)]
        raise InputError(f"{label!r} is neither a DOF nor a recovery row." + nearest(head, known)) from None
    return sp.csr_array(([1.0], ([0], [column])), shape=(1, system.n))
