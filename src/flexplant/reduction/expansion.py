"""From a component's coordinates back to the degrees of freedom of the model that it stands for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from flexplant.errors import InputError, expect, expect_text
from flexplant.model.arrays import FloatArray, Matrix, is_sparse, real_or_complex
from flexplant.model.component import Component
from flexplant.model.dofs import DofSet
from flexplant.model.recovery import Recovery
from flexplant.reduction.reduced import ReducedComponent

GRIDS = "mug1"  # Nastran's displacements of grids in an external superelement


@dataclass(frozen=True, eq=False)
class Expansion:
    """u = T p. dofs: (node, direction) of the rows, each in the displacement frame of its node. rows: T (len(dofs), n).

    complete: every DOF of the model is there, so that what is not there does not move.
    """

    dofs: DofSet
    rows: Matrix
    complete: bool


def expansion(component: Component, *, recovery: str = GRIDS) -> Expansion:
    """The rows T of `expand` and their DOF: the basis that a reduction kept, else what a vendor's file recovers.

    recovery: name of the recovery with rows "node.direction" of displacements ("mug1" in Nastran's files: DISPLACEMENT in the
    superelement's case control); the boundary and interior DOF are added where it does not have them. Raises InputError
    where the component has neither basis nor such rows, or was converted to other units after its reduction.
    """
    expect(component, Component, "expand", "craig_bampton(..., keep_basis=True) makes one")
    expect_text(recovery, "expansion: recovery")
    kept = component if isinstance(component, ReducedComponent) else None
    if kept is not None and kept.basis is not None:
        if kept.units != kept.reduced_units:
            raise InputError(f"expand: component {kept.name!r} changed units after its reduction; convert the model first")
        return Expansion(kept.model_dofs, kept.basis, complete=True)
    given = component.recovery.get(recovery)
    if given is not None and given.displacement is not None:
        return _recovered(component, given, given.displacement)
    if kept is not None:
        size = kept.report.basis_bytes / 1e6
        raise InputError(f"expand: component {kept.name!r} did not keep its basis; reduce with keep_basis=True ({size:.3g} MB)")
    raise InputError(
        f"expand: component {component.name!r} was not made by a reduction in this session and has no recovery {recovery!r}; "
        "reduce its model, or ask for the displacements of its grids in the run that wrote it (Nastran: DISPLACEMENT(PLOT) = ALL)"
    )


def _recovered(component: Component, recovery: Recovery, matrix: Matrix) -> Expansion:
    """Rows of grids in the recovery, then boundary and interior DOF that it has not."""
    pairs, at = _grids(recovery)
    if not pairs:
        raise InputError(f"expand: recovery {recovery.name!r} of component {component.name!r} has no rows such as '101.1'")
    known = set(pairs)
    extra = [i for i, pair in enumerate(component.boundary.pairs) if pair[1] > 0 and pair not in known]
    parts: list[Matrix] = [matrix[at], sp.eye_array(component.n, format="csr")[extra]]
    pairs += [component.boundary.pairs[i] for i in extra]
    if component.interior_rows is not None:
        known = set(pairs)
        inner = [i for i, pair in enumerate(component.interior.pairs) if pair not in known]
        parts.append(component.interior_rows[inner])
        pairs += [component.interior.pairs[i] for i in inner]
    sparse = all(is_sparse(part) for part in parts)
    rows = sp.csr_array(sp.vstack(parts)) if sparse else np.vstack([p.toarray() if is_sparse(p) else p for p in parts])
    return Expansion(DofSet.of(pairs), rows, complete=False)


def _grids(recovery: Recovery) -> tuple[list[tuple[int, int]], list[int]]:
    """(node, direction) and place of the rows "node.direction"; scalar points, whose first row is "node.0", left out."""
    split = [label.partition(".") for label in recovery.labels]
    scalars = {node for node, _, item in split if item == "0"}
    at = [
        i
        for i, (node, _, item) in enumerate(split)
        if node.isdecimal() and len(node) < 16 and item in ("1", "2", "3", "4", "5", "6") and node not in scalars
    ]
    return [(int(split[i][0]), int(split[i][2])) for i in at], at


def expand(component: Component, coordinates: npt.ArrayLike) -> FloatArray:
    """Displacements u = T p, (n_model, ...): rows as in the unreduced model's dofs, or `expansion(component).dofs`.

    The basis of a reduction gives every DOF; a component of a vendor's file with displacement recovery those of its grids.
    coordinates: (n, ...) of the component; for a system, `shapes[system.offsets[name]]`. Raises InputError where there is
    neither (reduce with `keep_basis=True`), or the number of coordinates differs.
    """
    found = expansion(component)
    p = real_or_complex(coordinates, "expand: coordinates")
    if p.shape[:1] != (component.n,):
        raise InputError(f"expand: got {p.shape[:1]} coordinates, component {component.name!r} has {component.n}")
    return np.asarray(found.rows @ p)
