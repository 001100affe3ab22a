"""Checks that the components of a system are in the same units and in their places."""

from __future__ import annotations

from flexplant.assembly import System
from flexplant.assembly.agreement import rigid_links, unstated
from flexplant.verification.checks import Check

LONGEST = 10.0  # of a link over an extent: an inch is 25 millimetres, so other units are beyond, and brackets are not


def agreement_checks(system: System) -> list[Check]:
    """Units that only some components state (never right), and the longest rigid link over the extent of what it joins."""
    silent = unstated(system.components)
    out = []
    if silent:
        text = f"{', '.join(silent)} from files that do not say; pass units= where they are read"
        out.append(Check("units stated by all components", len(silent), 0, False, "", text))
    links = rigid_links(system.connections, {c.name: c for c in system.components})
    if links:
        worst = max(links, key=lambda link: link.share)
        text = f"{worst}; far apart where units differ or a placement is wrong"
        out.append(Check("longest rigid link / extent", worst.share, LONGEST, worst.share <= LONGEST, "", text))
    return out
