"""Do the numbers of the components belong together? What tells that one is in metres and another in millimetres."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from flexplant.assembly.connection import GROUND
from flexplant.assembly.constraints import Resolved
from flexplant.errors import CouplingError, PlausibilityWarning
from flexplant.model.component import Component
from flexplant.model.units import UNSTATED


@dataclass(frozen=True)
class Link:
    """The longest rigid link of a connection, and the smaller of the extents of the two components (of their nodes)."""

    connection: str
    length: float
    extent: float

    @property
    def share(self) -> float:
        """Length over extent: far above 1 where the two are in different units, or one is placed wrongly."""
        return self.length / self.extent

    def __str__(self) -> str:
        return f"{self.connection}: a rigid link {self.length:.4g} long between components whose nodes span {self.extent:.4g}"


def rigid_links(connections: Iterable[Resolved], by_name: Mapping[str, Component]) -> list[Link]:
    """Of every connection whose nodes are apart and joined rigidly, where at least one side has an extent."""
    out = []
    for found in connections:
        joint = found.connection
        if found.gap <= 0 or joint.offset != "rigid" or joint.b == GROUND:
            continue
        sides = [by_name[name].nodes for name in (joint.a, joint.b)]
        extents = [nodes.extent for nodes in sides if nodes is not None and nodes.extent > 0]
        if extents:
            out.append(Link(str(joint.name), found.gap, min(extents)))
    return out


def unstated(parts: Sequence[Component]) -> list[str]:
    """Components whose file did not state its units, where others' did; [] where all or none did."""
    silent = [c.name for c in parts if c.units == UNSTATED]
    return silent if len(silent) < len(parts) else []


def check_units(parts: Sequence[Component]) -> None:
    """CouplingError for components in different units; a `PlausibilityWarning` where only some of them say which."""
    systems = {c.units: c.name for c in parts if c.units != UNSTATED}
    if len(systems) > 1:
        shown = ", ".join(f"{name!r} in {units}" for units, name in systems.items())
        raise CouplingError(f"units clash: {shown}; convert while reading with units=... (component_to_si)")
    if silent := unstated(parts):
        stated = next(iter(systems))
        text = f"units of {', '.join(silent)} are not stated, while others are in {stated}; pass units= where they are read"
        warnings.warn(PlausibilityWarning(f"{text} (--units, units: of a study)"), stacklevel=4)


def warn_of_long_links(connections: Iterable[Resolved], by_name: Mapping[str, Component]) -> None:
    """A `PlausibilityWarning` for rigid links longer than the components that they join."""
    for link in rigid_links(connections, by_name):
        if link.share > 1:
            warnings.warn(PlausibilityWarning(f"{link}: are both in the same units, and in their place?"), stacklevel=4)
