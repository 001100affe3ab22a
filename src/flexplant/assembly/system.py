"""The coupled system: uncoupled matrices, constraint rows, and the dual and primal coupled forms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from flexplant.assembly.constraints import Resolved
from flexplant.errors import CouplingError, InputError, nearest
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.model.component import Component
from flexplant.model.describe import count, listed, paragraph
from flexplant.model.geometry import Placement, rigid_body_vectors
from flexplant.model.recovery import Recovery

METHODS = ("dual", "primal")


@dataclass(frozen=True, eq=False, kw_only=True)
class System:
    """Coupled components. Uncoupled coordinates p stack the components' coordinates in order, B p = 0 couples them.

    Dual (equations 5-10): z = [p; lambda], K = [[K_u, B^T], [B, 0]], M and Z padded with zeros, so M is singular; the
    multiplier lambda is the force that side a exerts on side b: M p'' + Z p' + K p + B^T lambda = F.
    Primal: p = L z, B L = 0, K = L^T K_u L and so on.

    components; placements by name; connections: resolved, with rows and gaps; offsets: slice into p by component name;
    constraints: B (m, n) independent rows; constraint_labels: m names; redundant: names of rows left out because they
    follow from the others; basis: L (n, r); uncoupled_*: (n, n) block diagonal plus compliant connections (structural damping:
    of the components that have it, None without);
    springs: rows (k, n) of the relative motions that compliant connections resist, whatever their stiffness.
    Source: de Klerk, Rixen and Voormeeren 2008.
    """

    components: tuple[Component, ...]
    placements: Mapping[str, Placement]
    connections: tuple[Resolved, ...]
    method: str
    offsets: Mapping[str, slice]
    uncoupled_mass: sp.csr_array
    uncoupled_stiffness: sp.csr_array
    uncoupled_damping: sp.csr_array
    uncoupled_structural_damping: sp.csr_array | None
    constraints: sp.csr_array
    constraint_labels: tuple[str, ...]
    redundant: tuple[str, ...]
    basis: sp.csr_array
    kept: IntArray
    springs: sp.csr_array
    grounded: bool = False

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise CouplingError(f"method {self.method!r}: use 'dual' or 'primal'")

    def __repr__(self) -> str:
        head = f"System of {count(len(self.components), 'component')}, {self.method}: {self.n} coordinates, "
        head += f"{count(self.n_constraints, 'constraint')}, {self.basis.shape[1]} independent"
        rows = {
            "components": listed(f"{c.name} ({len(c.boundary)} + {c.n_modal})" for c in self.components),
            "connections": listed(str(r.connection.name) for r in self.connections),
            "grounded": "yes" if self.grounded else "no, it floats",
        }
        return paragraph(head, rows)

    @property
    def n(self) -> int:
        """Number of uncoupled coordinates."""
        return int(self.uncoupled_mass.shape[0])

    @property
    def n_constraints(self) -> int:
        """Number of independent constraint rows."""
        return int(self.constraints.shape[0])

    @property
    def n_coupled(self) -> int:
        """Size of the coupled matrices: n + m (dual) or n - m (primal)."""
        return self.n + self.n_constraints if self.method == "dual" else self.n - self.n_constraints

    def _coupled(self, matrix: sp.csr_array, border: bool = False) -> sp.csr_array:
        if self.method == "primal":
            return sp.csr_array(self.basis.T @ matrix @ self.basis)
        if border:
            return sp.csr_array(sp.block_array([[matrix, self.constraints.T], [self.constraints, None]]))
        empty = sp.csr_array((self.n_constraints, self.n_constraints))
        return sp.csr_array(sp.block_diag([matrix, empty]))

    @cached_property
    def mass(self) -> sp.csr_array:
        """Coupled mass (equation 9)."""
        return self._coupled(self.uncoupled_mass)

    @cached_property
    def damping(self) -> sp.csr_array:
        """Coupled damping (equation 10)."""
        return self._coupled(self.uncoupled_damping)

    @cached_property
    def structural_damping(self) -> sp.csr_array | None:
        """Coupled structural damping D of the complex stiffness K + i D, in the form of the damping; None without."""
        return None if self.uncoupled_structural_damping is None else self._coupled(self.uncoupled_structural_damping)

    @cached_property
    def stiffness(self) -> sp.csr_array:
        """Coupled stiffness (equation 8 for the dual form)."""
        return self._coupled(self.uncoupled_stiffness, border=True)

    @cached_property
    def recovery(self) -> dict[str, Recovery]:
        """Recovery by "component.name", acting on the coupled coordinates (equation 11: [DRM_a DRM_b 0])."""
        return {f"{c.name}.{r.name}": self._padded(c, r) for c in self.components for r in c.recovery.values()}

    def _padded(self, component: Component, recovery: Recovery) -> Recovery:
        kinds = {k: getattr(recovery, k) for k in ("displacement", "velocity", "acceleration")}
        coupled = {k: self.to_coupled(self.spread(component.name, m)) for k, m in kinds.items() if m is not None}
        return Recovery(recovery.name, recovery.labels, units=recovery.units, **coupled)

    def spread(self, name: str, rows: Any) -> sp.csr_array:
        """Rows over one component's coordinates (k, n_component), as rows over all of p (k, n)."""
        at = self.offsets[name]
        entries = sp.coo_array(rows)
        return sp.csr_array((entries.data, (entries.row, entries.col + at.start)), shape=(entries.shape[0], self.n))

    def to_coupled(self, rows: Any) -> sp.csr_array:
        """Rows over p (k, n) as rows over the coupled coordinates: padded with zeros (dual) or times L (primal)."""
        if self.method == "primal":
            return sp.csr_array(rows @ self.basis)
        return sp.csr_array(sp.hstack([rows, sp.csr_array((rows.shape[0], self.n_constraints))]))

    def expand(self, z: npt.ArrayLike) -> Any:
        """Uncoupled coordinates p (n, ...) from coupled ones z (n_coupled, ...); InputError names the two sizes."""
        z = np.asarray(z)
        if z.shape[:1] != (self.n_coupled,):
            raise InputError(f"expand: got {z.shape[:1]} coordinates, the {self.method} system has {self.n_coupled}")
        return self.basis @ z if self.method == "primal" else z[: self.n]

    def component(self, name: str) -> Component:
        """The component of that name; InputError suggests the nearest."""
        for component in self.components:
            if component.name == name:
                return component
        raise InputError(f"the system has no component {name!r}." + nearest(name, [c.name for c in self.components]))

    def placement(self, name: str) -> Placement:
        """Placement of a component (identity where none was given)."""
        return self.placements.get(name, Placement())

    def row(self, component: str, node: int, direction: int) -> int:
        """Row of p of one coordinate; ModelError names what is missing."""
        found = self.component(component)
        return int(self.offsets[component].start) + found.dofs.row(node, direction, owner=f"component {component!r}")

    def dof_row(self, component: str, node: int, direction: int) -> sp.csr_array:
        """(1, n) row R over p of one coordinate, or of an interior DOF that the component kept: u = R p, p-forces R^T f."""
        found = self.component(component)
        if (node, direction) in found.interior:
            return self.spread(component, sp.csr_array(found.interior_rows)[[found.interior.row(node, direction)], :])
        return sp.csr_array(([1.0], ([0], [self.row(component, node, direction)])), shape=(1, self.n))

    @cached_property
    def labels(self) -> list[str]:
        """Names of the uncoupled coordinates, "component.node.direction" (direction 0: modal)."""
        return [f"{c.name}.{n}.{d}" for c in self.components for n, d in c.dofs.pairs]

    @property
    def has_geometry(self) -> bool:
        """True where every component knows its nodes' positions."""
        return all(c.nodes is not None for c in self.components)


def component_rigid_body(
    component: Component, placement: Placement | None = None, about: npt.ArrayLike = (0, 0, 0)
) -> FloatArray:
    """(n_component, 6) geometric rigid-body vectors in all coordinates; modal coordinates do not move (Phi_q = 0)."""
    if component.nodes is None:
        raise InputError(f"component {component.name!r} has no node positions, so its rigid-body motion is unknown")
    return rigid_body_vectors(component.nodes, component.dofs, about=about, placement=placement)


def stiffness_scale(component: Component) -> FloatArray:
    """(n,) diagonal against which the strain energy of a rigid motion of the component is small or not.

    The stiffness' own diagonal, plus the mass' times ten typical modal w^2: behind a statically determinate interface (one
    node) the boundary stiffness is nothing but the round-off of its condensation, and no scale for itself.
    """
    modal = (2 * np.pi * component.fixed_interface_hz) ** 2
    modal = modal[np.isfinite(modal)]
    typical = float(np.median(modal)) if modal.size else 0.0
    return np.asarray(abs(component.stiffness.diagonal()) + 10 * typical * abs(component.mass.diagonal()))


def coupled_stiffness_scale(system: System) -> FloatArray:
    """(r,) `stiffness_scale` of the components, in the eliminated coordinates of `basis`."""
    return np.asarray((system.basis**2).T @ np.concatenate([stiffness_scale(c) for c in system.components]))


def system_rigid_body(system: System, about: npt.ArrayLike = (0, 0, 0)) -> FloatArray:
    """(n, 6) rigid-body vectors of the system as placed, in uncoupled coordinates."""
    parts = [component_rigid_body(c, system.placement(c.name), about) for c in system.components]
    return np.vstack(parts)
