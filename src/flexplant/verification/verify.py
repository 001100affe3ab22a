"""`verify`: everything one checks before a coupled model goes into a control simulation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from flexplant.assembly import System, coupled_stiffness_scale, stiffness_scale, system_rigid_body
from flexplant.errors import InputError, expect, expect_count
from flexplant.model.arrays import FloatArray, dense, is_finite
from flexplant.model.component import Component
from flexplant.model.table import Table
from flexplant.modes import Modes, expect_modes_of, normal_modes
from flexplant.numerics.rank import lowest_eigenvalue, split_semidefinite
from flexplant.verification.agreement import agreement_checks
from flexplant.verification.checks import Check, CheckReport
from flexplant.verification.comparison import as_reference, compare_modes
from flexplant.verification.free_free import ENERGY_LIMIT, free_free
from flexplant.verification.mass import MassProperties, combined, mass_properties
from flexplant.verification.reduction_range import reduction_range
from flexplant.verification.rigid_body import DIRECTION_NAMES, blocked_directions, strain_energy

DEFINITE_LIMIT = -1e-8  # smallest eigenvalue of a matrix scaled to unit diagonal; single-precision files reach about -1e-9
SHARED_LIMIT = 1e-6
ROUNDED = 100 * float(np.finfo(float).eps)  # of the terms in a product
DENSE_CHECK = 3000  # coordinates up to which definiteness is checked by all eigenvalues


def verify(
    system: System,
    *,
    rigid_body_modes: int = 6,
    reference: Any = None,
    frequency_tolerance: float = 1e-3,
    mac_minimum: float = 0.9,
    modes: Modes | None = None,
    max_frequency_hz: float | None = None,
    reduction_error: float = 0.01,
) -> CheckReport:
    """Check a coupled system: rigid-body modes, energy, definiteness, mass, compatibility, reductions, and a reference.

    rigid_body_modes: expected number (0 for a clamped system). reference: frequencies in Hz, Modes or `Reference`, compared
    within `frequency_tolerance` (relative) and `mac_minimum`. modes: spare a second solution where they are known.
    max_frequency_hz: what the system is to serve; components reduced here must be complete up to there, and the frequency errors
    that `estimate_error` finds stay within `reduction_error` (relative). Of other components a note says what they suggest.
    Raises InputError for a negative count; a failed check is a value, see `CheckReport.raise_if_failed`.
    """
    if not isinstance(system, System):
        raise InputError(f"verify takes a coupled System, got {type(system).__name__}; couple it first, or use check_component")
    expect_count(rigid_body_modes, "rigid_body_modes")
    limits = {"frequency_tolerance": frequency_tolerance, "mac_minimum": mac_minimum, "reduction_error": reduction_error}
    for name, limit in limits.items():
        if not is_finite(limit) or limit < 0:
            raise InputError(f"verify: {name} must be a finite number from 0, got {limit!r:.60}")
    reference = None if reference is None else as_reference(reference)
    if max_frequency_hz is not None and not (is_finite(max_frequency_hz) and max_frequency_hz > 0):
        raise InputError(f"verify: max_frequency_hz must be positive and finite, got {max_frequency_hz!r:.60}")
    if modes is None:
        modes = normal_modes(system, n_modes=None if system.n <= DENSE_CHECK else rigid_body_modes + 20)
    expect_modes_of(modes, system, "verify")
    checks: list[Check] = [_count(system, modes, rigid_body_modes), *agreement_checks(system), *_matrices(system)]
    tables: list[Table] = []
    notes = [f"redundant constraints left out: {', '.join(system.redundant[:12])}"] if system.redundant else []
    if system.has_geometry:
        checks += [*_energy(system), *_mass(system), *_compatibility(system)]
        tables.append(_mass_table(system))
    else:
        unknown = [c.name for c in system.components if c.nodes is None]
        notes.append(f"no node positions for {', '.join(unknown)}: rigid-body energy and mass properties are not checked")
    notes += [
        f"{r.connection.name}: nodes up to {r.gap:.4g} apart ({r.connection.offset})" for r in system.connections if r.gap > 0
    ]
    checks += [_residual(modes), _shared_strain(system, modes)]
    reductions = reduction_range(system, modes, max_frequency_hz, reduction_error)
    checks, tables, notes = checks + reductions.checks, tables + reductions.tables, notes + reductions.notes
    if reference is not None:
        comparison = compare_modes(system, modes, reference)
        tables.append(comparison.table)
        checks += _reference_checks(comparison, frequency_tolerance, mac_minimum)
    return CheckReport(tuple(checks), tuple(tables), tuple(notes))


def check_component(component: Component) -> CheckReport:
    """The checks that one component allows by itself: energy, definiteness, mass properties, fixed-interface modes."""
    expect(component, Component, "check_component", "read_component gives one, craig_bampton reduces a model to one")
    checks = list(_definite_component(component))
    tables, notes = [], []
    if component.nodes is not None:
        checks.append(_energy_check(component))
        properties = mass_properties(component)
        checks.append(_isotropy(component.name, properties))
        tables.append(Table("Mass properties", _mass_columns(component.units), (_mass_row(component.name, properties),)))
    else:
        notes.append("no node positions: rigid-body energy and mass properties are not checked")
    return CheckReport(tuple(checks), tuple(tables), tuple(notes))


def _count(system: System, modes: Modes, expected: int) -> Check:
    result = free_free(system, modes, expected)
    return Check("rigid-body modes", result.found, expected, result.found == expected, "", result.explanation)


def _residual(modes: Modes) -> Check:
    worst = float(modes.residuals.max(initial=0.0))
    return Check("eigenvector residual", worst, 1e-6, worst <= 1e-6, "", "largest |K phi - w^2 M phi| / |stiffness scale x phi|")


def _shared_strain(system: System, modes: Modes) -> Check:
    """|phi_i^T K phi_j - w_i^2 d_ij| / (w_i w_j): soft modes show in it what of stiff ones a solver left in them, long before a
    residual does. Less what rounding the products can cause."""
    elastic = np.flatnonzero(modes.omega)
    omega = modes.omega[elastic]
    shapes = modes.shapes[:, elastic] / abs(omega)
    shared = abs(shapes.T @ (system.uncoupled_stiffness @ shapes) - np.diag(np.sign(omega)))
    size = np.sqrt(abs(system.uncoupled_stiffness.diagonal()) @ shapes**2)
    worst = float(np.max(shared - ROUNDED * np.outer(size, size), initial=0.0))
    text = "largest |phi_i^T K phi_j - w_i^2 (i = j)| / (w_i w_j): frequencies may be off by as much"
    return Check("strain energy shared by modes", worst, SHARED_LIMIT, worst <= SHARED_LIMIT, "", text)


def _matrices(system: System) -> Iterator[Check]:
    for name in ("mass", "stiffness", "damping"):
        matrix = getattr(system, name)
        size = float(abs(matrix).max()) if matrix.nnz else 0.0
        worst = float(abs(matrix - matrix.T).max()) / size if size else 0.0
        yield Check(f"symmetry of coupled {name}", worst, 1e-12, worst <= 1e-12, "", "largest |A - A^T| / largest |A|")
    for component in {id(c.mass): c for c in system.components}.values():
        yield from _definite_component(component)
    m = system.basis.T @ system.uncoupled_mass @ system.basis
    k = system.basis.T @ system.uncoupled_stiffness @ system.basis
    if m.shape[0] <= DENSE_CHECK:
        yield from _definite("coupled: ", m, k, coupled_stiffness_scale(system), strict=True)


def _definite_component(component: Component) -> Iterator[Check]:
    scale = stiffness_scale(component)
    return _definite(f"{component.name}: ", component.mass, component.stiffness, scale, strict=False)


def _definite(owner: str, mass: Any, stiffness: Any, scale: FloatArray, *, strict: bool) -> Iterator[Check]:
    """Positive semi-definiteness; a component's indefinite mass is reported but left to the coupled model."""
    lows = {"mass": split_semidefinite(dense(mass)).lowest, "stiffness": lowest_eigenvalue(dense(stiffness), scale)}
    for name, lowest in lows.items():
        decides = strict or name == "stiffness"
        text = "smallest eigenvalue, scaled to a unit diagonal"
        if not decides and lowest < DEFINITE_LIMIT:
            text += "; allowed in a component, the coupled mass decides"
        passed = lowest >= DEFINITE_LIMIT or not decides
        yield Check(f"{owner}{name} positive semi-definite", lowest, DEFINITE_LIMIT, passed, "", text)


def _energy_check(component: Component) -> Check:
    strain = strain_energy(component)
    value = float(strain.ratio.max())
    text = f"strain energy of rigid motion / diagonal energy; {strain.explanation}"
    return Check(f"{component.name}: rigid-body strain energy", value, ENERGY_LIMIT, value <= ENERGY_LIMIT, "", text)


def _energy(system: System) -> Iterator[Check]:
    for component in system.components:
        yield _energy_check(component)


def _isotropy(name: str, properties: MassProperties) -> Check:
    value = properties.anisotropy
    text = "difference between the masses seen in x, y and z: large where frames are wrong or the model is planar"
    return Check(f"{name}: mass equal in all directions", value, 1e-6, value <= 1e-6, "", text)


def _mass(system: System) -> Iterator[Check]:
    whole = mass_properties(system)
    parts = combined([(mass_properties(c), system.placement(c.name)) for c in system.components])
    for component in system.components:
        yield _isotropy(component.name, mass_properties(component))
    size = max(np.sqrt(abs(np.trace(whole.inertia)) / whole.mass), 1e-300)
    shift = float(np.linalg.norm(whole.center_of_gravity - parts.center_of_gravity) / size)
    turn = float(abs(whole.inertia - parts.inertia).max() / max(abs(parts.inertia).max(), 1e-300))
    text = "rigid-body mass of the coupled system against the sum of the placed components"
    for name, value, unit in (
        ("mass", abs(whole.mass / parts.mass - 1), ""),
        ("centre of gravity", shift, "radii of gyration"),
        ("inertia", turn, ""),
    ):
        yield Check(f"sum rule, {name}", value, 1e-6, value <= 1e-6, unit, text)


def _compatibility(system: System) -> Iterator[Check]:
    motion = system_rigid_body(system)
    blocked = blocked_directions(system, motion)
    for r in system.connections:
        if r.connection.rigid and not any(row.ground for row in r.rows):
            labels = {row.label for row in r.rows}
            broken = [d for d, held in blocked.items() if labels & set(held)]
            text = f"sides move apart in {', '.join(broken)}" if broken else "both sides move alike in rigid-body motion"
            yield Check(f"{r.connection.name}: compatible sides", len(broken), 0, not broken, "directions", text)


MASS_COLUMNS = (("part", ""), ("mass", "kg"), *((c, "m") for c in "xyz"))
INERTIA_COLUMNS = tuple((f"I{pair}", "kg m^2") for pair in ("xx", "yy", "zz", "xy", "yz", "zx"))
INERTIA_ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))


def _mass_columns(units: str) -> tuple[str, ...]:
    """Column heads, with their SI unit; other unit systems have no names for theirs."""
    return tuple(f"{name} [{unit}]" if unit and units == "SI" else name for name, unit in (*MASS_COLUMNS, *INERTIA_COLUMNS))


def _mass_row(name: str, p: MassProperties) -> tuple[object, ...]:
    return (name, p.mass, *p.center_of_gravity.tolist(), *(float(p.inertia[entry]) for entry in INERTIA_ENTRIES))


def _mass_table(system: System) -> Table:
    rows = [_mass_row(c.name, mass_properties(c)) for c in system.components]
    rows.append(_mass_row("system", mass_properties(system)))
    units = system.components[0].units
    title = f"Mass properties, {units} (components in their own frame; inertia about the centres)"
    return Table(title, _mass_columns(units), tuple(rows))


def _reference_checks(comparison: Any, frequency_tolerance: float, mac_minimum: float) -> Iterator[Check]:
    worst = float(abs(comparison.error_percent).max(initial=0.0))
    limit = 100 * frequency_tolerance
    yield Check("frequencies against the reference", worst, limit, worst <= limit, "%", "largest error of the elastic modes")
    if comparison.mac is not None:
        low = float(comparison.mac.min())
        text = "lowest MAC of a mode, or of the subspaces of a cluster"
        yield Check("shapes against the reference", low, mac_minimum, low >= mac_minimum, "MAC", text)


__all__ = ["DIRECTION_NAMES", "check_component", "verify"]
