"""Rows of recovery matrices in SI, where the set's name and the row's label say which quantity they are.

Ours are "displacement" (of a reduction's `recover=`) and "display" (of a sidecar), with labels "node.direction". Nastran names
its sets mug1 (displacements), mqg1 and mqmg1 (forces at grids), mef1 (element forces), mes1 (stresses), mee1 (strains), and its
tables the element and item of each row. A set with a row of unknown quantity stays in the file's units, and says so.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from flexplant.model.arrays import FloatArray, Matrix
from flexplant.model.recovery import Recovery
from flexplant.model.units import INCH, SI, UNIT_SYSTEMS, UnitSystem

LENGTH, FORCE, MOMENT, PRESSURE, PER_LENGTH = "m", "N", "N m", "Pa", "N/m"
MODAL, PLAIN = "modal", ""  # a coordinate q; an angle or a strain
OWN_SETS = ("displacement", "display")
LENGTH_NAMES = {1.0: LENGTH, 1e-3: "mm", INCH: "inch", 0.3048: "ft"}
GRID_SETS = {
    **dict.fromkeys(OWN_SETS, (LENGTH, "rad")),
    "mug1": (LENGTH, "rad"),
    "mqg1": (FORCE, MOMENT),
    "mqmg1": (FORCE, MOMENT),
}
FORCES = {  # items of an element's forces, from the first; none where the items are not all of a known quantity
    **dict.fromkeys(("CROD", "CONROD"), (FORCE, MOMENT)),
    "CBAR": (MOMENT,) * 4 + (FORCE,) * 3 + (MOMENT,),
    "CBUSH": (FORCE,) * 3 + (MOMENT,) * 3,
    **dict.fromkeys(("CQUAD4", "CTRIA3"), (PER_LENGTH,) * 3 + (FORCE,) * 3 + (PER_LENGTH,) * 2),
}
STRESSED = ("CROD", "CONROD", "CBAR", "CSHEAR", "CQUAD4", "CQUAD8", "CTRIA3", "CTRIA6", "CTETRA", "CHEXA", "CPENTA")


def recovery_in_si(recovery: Recovery, units: UnitSystem, modal_ids: Collection[int]) -> Recovery:
    """The set with its rows in SI and their unit as text; unchanged but for a text where a row's quantity is not known.

    Columns are taken to act on SI coordinates already. modal_ids: scalar points of mug1 that are the component's q.
    """
    if recovery.units:  # whoever wrote the file said what the rows are
        return recovery
    quantities = [_quantity(recovery.name, label.split("."), modal_ids) for label in recovery.labels]
    known = [q for q in quantities if q is not None]
    if len(known) < len(quantities):
        return recovery if units.name == SI.name else replace(recovery, units=f"units of the file ({units.name})")
    factors = np.array([_factor(q, units) for q in known])
    return replace(
        recovery,
        displacement=_scaled(recovery.displacement, factors),
        velocity=_scaled(recovery.velocity, factors),
        acceleration=_scaled(recovery.acceleration, factors),
        units=" or ".join(dict.fromkeys(q for q in known if q not in (MODAL, PLAIN))),
    )


def displacement_units(name: str, labels: Iterable[str], units: str) -> str:
    """The unit of one of our sets in the units of its component, as text: "m", "rad", "mm or rad"; "" where it is not known."""
    quantities = [_quantity(name, label.split("."), ()) for label in labels]
    if name not in OWN_SETS or units not in UNIT_SYSTEMS or None in quantities:
        return ""
    length = LENGTH_NAMES[UNIT_SYSTEMS[units].length]
    return " or ".join(dict.fromkeys(length if q == LENGTH else str(q) for q in quantities))


def row_units(recovery: Recovery, label: str) -> str:
    """The unit of one row: of "m or rad" the one that is the row's; the set's own text where its rows do not differ."""
    return next((u for u in recovery.units.split(" or ") if u == _quantity(recovery.name, label.split("."), ())), recovery.units)


def _quantity(name: str, label: list[str], modal_ids: Collection[int]) -> str | None:
    """The unit of a row in SI; None where it is not known."""
    item = int(label[-1]) if len(label) > 1 and label[-1].isdigit() else None
    if item is None:
        return None
    if name in OWN_SETS and not (len(label) == 2 and label[0].isdigit()):
        return None
    if name in GRID_SETS:
        if 1 <= item <= 6:
            return GRID_SETS[name][item > 3]
        return MODAL if name == "mug1" and label[0].isdigit() and int(label[0]) in modal_ids else None
    if name == "mef1":
        items = FORCES.get(label[0], ())
        return items[item - 1] if 1 <= item <= len(items) else None
    if label[0] not in STRESSED:
        return None
    return {"mes1": PRESSURE, "mee1": PLAIN}.get(name)


def _factor(quantity: str, units: UnitSystem) -> float:
    factors = {
        LENGTH: units.length,
        FORCE: units.force,
        MOMENT: units.force * units.length,
        PRESSURE: units.force / units.length**2,
        PER_LENGTH: units.force / units.length,
        MODAL: math.sqrt(units.mass * units.mass_factor) * units.length,
    }
    return factors.get(quantity, 1.0)


def _scaled(matrix: Matrix | None, factors: FloatArray) -> Matrix | None:
    if matrix is None:
        return None
    return sp.csr_array(sp.diags_array(factors) @ matrix) if sp.issparse(matrix) else factors[:, None] * matrix
