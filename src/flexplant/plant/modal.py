"""The modal plant: mass-normalised modes with named inputs and outputs; the form everything fast runs on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from flexplant.assembly import System
from flexplant.errors import InputError, ModelError, expect, expect_text, nearest
from flexplant.model.arrays import FloatArray, checked_switch, real_values
from flexplant.model.damping import DampingRatio
from flexplant.model.describe import channels, count, paragraph
from flexplant.modes import Modes, expect_modes_of, normal_modes
from flexplant.plant.channels import (
    OutputRows,
    checked_system,
    input_matrix,
    listed_names,
    output_matrices,
    refuse_structural_damping,
)
from flexplant.plant.damping import ModalDamping, check_choice, projected_damping, ratio_damping
from flexplant.plant.fields import check_mapping, checked_dense, checked_names, checked_units, checked_vector
from flexplant.plant.massless import with_rates
from flexplant.plant.origin import origin
from flexplant.plant.residual_modes import residual_of
from flexplant.reduction.coverage import coverage, shortfall


@dataclass(frozen=True, eq=False, kw_only=True)
class ModalPlant:
    """A structure in mass-normalised modal coordinates (E = I).

        eta'' + Z eta' + omega^2 eta = shape_in u
        y = shape_out eta + shape_out_velocity eta' + shape_out_acceleration eta'' + (feedthrough + static_correction) u

    omega: (n,) rad/s, exactly 0 for a rigid-body mode. zeta: (n,) damping ratios, or one value for all modes.
    shape_in: (n, nu) modal forces of unit inputs. shape_out, shape_out_velocity, shape_out_acceleration: (ny, n) or None.
    damping: (n, n) full symmetric Z, or None for diag(2 zeta omega). static_correction, feedthrough: (ny, nu) or None.
    inputs, outputs: distinct names; input_units, output_units: one text a channel. report: what was truncated or dropped.
    source: the file that it was read from, or those of its components (provenance).
    Raises ModelError with the names and shapes that disagree.
    """

    omega: FloatArray
    zeta: FloatArray
    shape_in: FloatArray
    shape_out: FloatArray | None = None
    inputs: Sequence[str]
    outputs: Sequence[str]
    shape_out_velocity: FloatArray | None = None
    shape_out_acceleration: FloatArray | None = None
    damping: FloatArray | None = None
    static_correction: FloatArray | None = None
    feedthrough: FloatArray | None = None
    name: str = "plant"
    input_units: Sequence[str] = ()
    output_units: Sequence[str] = ()
    report: Mapping[str, Any] = field(default_factory=dict)
    source: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        expect_text(self.name, "modal plant: name")
        owner = f"modal plant {self.name!r}"
        check_mapping(self.report, f"{owner}: report")
        check_mapping(self.source, f"{owner}: source")
        self._set("omega", checked_vector(self.omega, None, f"{owner}: omega"))
        zeta = real_values(self.zeta, f"{owner}: zeta")
        zeta = np.full(self.n_modes, float(zeta)) if zeta.ndim == 0 else zeta
        self._set("zeta", checked_vector(zeta, self.n_modes, f"{owner}: zeta"))
        for kind in ("inputs", "outputs"):
            names = checked_names(getattr(self, kind), kind, owner)
            self._set(kind, names)
            units = f"{kind[:-1]}_units"
            self._set(units, checked_units(getattr(self, units), len(names), units, owner))
        self._check_shapes(owner)
        if self.damping is not None and not np.allclose(
            self.damping, self.damping.T, rtol=1e-6, atol=1e-6 * abs(self.damping).max(initial=0.0)
        ):
            raise ModelError(f"{owner}: damping matrix is not symmetric")

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def _check_shapes(self, owner: str) -> None:
        n, nu, ny = self.n_modes, len(self.inputs), len(self.outputs)
        shapes = {
            "shape_in": (n, nu),
            "shape_out": (ny, n),
            "shape_out_velocity": (ny, n),
            "shape_out_acceleration": (ny, n),
            "damping": (n, n),
            "static_correction": (ny, nu),
            "feedthrough": (ny, nu),
        }
        if self.shape_out is None:
            self._set("shape_out", np.zeros((ny, n)))
        for kind, shape in shapes.items():
            if (matrix := getattr(self, kind)) is not None or kind == "shape_in":
                what = f"{owner} ({n} modes, {nu} inputs, {ny} outputs): {kind}"
                self._set(kind, checked_dense(matrix, shape, what))

    def __repr__(self) -> str:
        rigid = f", {self.n_rigid} of them rigid-body" if self.n_rigid else ""
        top = f" up to {self.frequency_hz.max():.5g} Hz" if self.n_modes else ""
        low, high = (self.zeta.min(), self.zeta.max()) if self.n_modes else (0.0, 0.0)
        ratios = f"zeta {low:.3g}" + ("" if low == high else f" to {high:.3g}")
        rows = {
            "inputs": channels(self.inputs, self.input_units),
            "outputs": channels(self.outputs, self.output_units),
            "damping": ratios if self.damping is None else "a full modal matrix",
            "static": "a direct term for the truncated modes" if self.static_correction is not None else "",
            "from": str(self.source.get("path", "")),
        }
        return paragraph(f"ModalPlant {self.name!r}: {count(self.n_modes, 'mode')}{top}{rigid}", rows)

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return int(self.omega.size)

    @property
    def n_rigid(self) -> int:
        """Number of rigid-body modes (omega exactly 0)."""
        return int(np.count_nonzero(self.omega == 0.0))

    @property
    def frequency_hz(self) -> FloatArray:
        """(n,) undamped frequencies, Hz."""
        return self.omega / (2 * np.pi)

    @property
    def damping_matrix(self) -> FloatArray:
        """(n, n) modal damping Z, 1/s."""
        return np.diag(2 * self.zeta * self.omega) if self.damping is None else self.damping

    @property
    def direct(self) -> FloatArray:
        """(ny, nu) feedthrough + static_correction: the part of y proportional to u, beside that through eta''."""
        parts = [p for p in (self.feedthrough, self.static_correction) if p is not None]
        return np.sum(parts, axis=0) if parts else np.zeros((len(self.outputs), len(self.inputs)))


def modal_plant(
    system: System,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    max_frequency_hz: float | None = None,
    n_modes: int | None = None,
    damping_ratio: DampingRatio | None = None,
    static_correction: bool | Literal["modes"] = True,
    off_diagonal_damping: str = "keep",
    modes: Modes | None = None,
    name: str = "plant",
) -> ModalPlant:
    """The coupled system in its mass-normalised modes, with named inputs and outputs (see `channels`).

    max_frequency_hz, n_modes: which modes are kept, rigid-body modes counted; all finite modes where neither is given.
    damping_ratio: one value, one a kept mode, or a table [(frequency_hz, ratio), ...]; None projects the system's own
    damping, Phi^T Z Phi. off_diagonal_damping: "keep" or "drop" what couples modes; `report` states it either way.
    static_correction: True adds the residual flexibility of all truncated modes to displacement outputs and interface forces as
    a direct term; "modes" adds it as residual modes, one an input at most, above the kept ones (see `residual_modes`): velocity
    and acceleration outputs are corrected too, and y has no direct term; damping ratios apply to them as to modes. Coordinates
    without mass keep a direct term for displacements; their velocities and accelerations, which follow the input's derivatives,
    are shown by fast modes ("modes", see `massless`) or left out with a `LeftOutWarning` (True).
    modes: those of an earlier normal_modes(system, ...), to save the solution.
    Raises InputError for unknown names or choices, and for structural damping without ratios in its place, SolverError
    where modes or static correction cannot be computed. `report` states up to where components reduced here are complete, with a
    notice where kept modes lie beyond (`complete_below_hz`, `notice`).
    """
    checked_system(system, "modal_plant")
    check_choice(off_diagonal_damping)
    if damping_ratio is None:
        refuse_structural_damping(
            system, "modal_plant",
            "use structural_frequency_response, give damping_ratio, or couple with_equivalent_viscous_damping(component, hz)",
        )  # fmt: skip
    if not (isinstance(static_correction, str) and static_correction == "modes"):
        checked_switch(static_correction, "modal_plant: static_correction (or 'modes')")
    if modes is None:
        modes = normal_modes(system, max_frequency_hz=max_frequency_hz, n_modes=n_modes)
    expect_modes_of(modes, system, "modal_plant")
    _refuse_buckled(modes)
    columns, rows = input_matrix(system, inputs), output_matrices(system, outputs)
    kept, residual, as_modes = modes, None, static_correction == "modes"
    if static_correction and len(modes) < system.basis.shape[1]:
        residual = residual_of(system, columns.matrix, modes)
        modes = residual.modes if as_modes else modes
    shapes, omega = modes.shapes, modes.omega
    if damping_ratio is None:
        damping = projected_damping(system.uncoupled_damping, shapes, omega, off_diagonal_damping)
    else:
        damping = ratio_damping(damping_ratio, omega)
    acceleration = None if rows.acceleration is None else rows.acceleration @ shapes
    correction = None if residual is None else _direct_part(rows, residual.massless if as_modes else residual.displacement)
    plant = ModalPlant(
        omega=omega,
        zeta=damping.zeta,
        damping=damping.matrix,
        shape_in=(columns.matrix.T @ shapes).T,
        shape_out=rows.displacement @ shapes,
        shape_out_velocity=_velocity_rows(rows, shapes, omega, acceleration, damping),
        shape_out_acceleration=acceleration,
        static_correction=correction,
        feedthrough=None if rows.force is None else (rows.force @ columns.matrix).toarray(),
        inputs=columns.names,
        outputs=rows.names,
        input_units=columns.units,
        output_units=rows.units,
        name=name,
        report=_kept_report(system, kept, len(modes) - len(kept), correction)
        | _range_report(system, kept, max_frequency_hz or 0.0)
        | damping.report,
        source=origin(system),
    )
    return plant if residual is None else with_rates(plant, system, columns, rows, residual.massless, as_modes)


def _refuse_buckled(modes: Modes) -> None:
    """ModelError where a mode has negative w^2: it grows without bound, and is no oscillator."""
    at = np.flatnonzero(modes.frequency_hz < 0)
    if at.size:
        hz = float(modes.frequency_hz[at[0]])
        raise ModelError(
            f"modal_plant: the structure buckles: {count(at.size, 'mode')} of negative stiffness, mode {at[0] + 1} with w^2 = "
            f"{-((2 * np.pi * hz) ** 2):.4g} (rad/s)^2 (in normal_modes {hz:.4g} Hz); lower the prestress, check the sign of its "
            "geometric stiffness, or hold more DOF; descriptor(system, ...) keeps such a mode, as an unstable one"
        )


def _direct_part(rows: OutputRows, displacement: FloatArray) -> FloatArray | None:
    return np.asarray(rows.displacement @ displacement) if displacement.any() else None


def _kept_report(system: System, modes: Modes, residual_modes: int, correction: FloatArray | None) -> dict[str, Any]:
    return {
        "modes_kept": len(modes),
        "residual_modes": residual_modes,
        "coupled_coordinates": int(system.basis.shape[1]),
        "highest_frequency_hz": float(modes.frequency_hz[-1]) if len(modes) else 0.0,
        "static_correction": correction is not None or residual_modes > 0,
    }


def _range_report(system: System, modes: Modes, asked_hz: float) -> dict[str, Any]:
    """complete_below_hz: of the components reduced here, where there are any. notice: kept modes beyond what components cover."""
    covered = [coverage(c) for c in system.components]
    known = [c.complete_below_hz for c in covered if c.complete_below_hz is not None and np.isfinite(c.complete_below_hz)]
    highest = max(asked_hz, float(modes.frequency_hz[-1]) if len(modes) else 0.0)
    notices = [text for text in (shortfall(covered, highest), *(c.note(highest) for c in covered)) if text is not None]
    report: dict[str, Any] = {"complete_below_hz": min(known)} if known else {}
    return report | ({"notice": "; ".join(notices)} if notices and highest else {})


def _velocity_rows(
    rows: OutputRows, shapes: FloatArray, omega: FloatArray, acceleration: FloatArray | None, damping: ModalDamping
) -> FloatArray | None:
    """Rows on eta'. Where modal damping replaces Z, an interface force takes M Phi Zm eta' in place of Z Phi eta'."""
    velocity = None if rows.velocity is None else rows.velocity @ shapes
    if not damping.replaced or acceleration is None or not rows.is_multiplier.any():
        return velocity
    modal = np.diag(2 * damping.zeta * omega) if damping.matrix is None else damping.matrix
    velocity = np.zeros_like(acceleration) if velocity is None else velocity
    return np.where(rows.is_multiplier[:, None], acceleration @ modal, velocity)


def select(plant: ModalPlant, *, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None) -> ModalPlant:
    """The plant with only these inputs and outputs, in this order; InputError suggests the nearest names."""
    expect(plant, ModalPlant, "select", "modal_plant(system, ...) makes one")
    columns = _positions(plant.inputs, inputs, f"modal plant {plant.name!r} has no input")
    rows = _positions(plant.outputs, outputs, f"modal plant {plant.name!r} has no output")

    def picked(matrix: FloatArray | None, both: bool) -> FloatArray | None:
        return None if matrix is None else matrix[rows][:, columns] if both else matrix[rows]

    return replace(
        plant,
        shape_in=plant.shape_in[:, columns],
        shape_out=picked(plant.shape_out, False),
        shape_out_velocity=picked(plant.shape_out_velocity, False),
        shape_out_acceleration=picked(plant.shape_out_acceleration, False),
        static_correction=picked(plant.static_correction, True),
        feedthrough=picked(plant.feedthrough, True),
        inputs=[plant.inputs[k] for k in columns],
        outputs=[plant.outputs[k] for k in rows],
        input_units=[plant.input_units[k] for k in columns],
        output_units=[plant.output_units[k] for k in rows],
    )


def _positions(known: Sequence[str], wanted: Sequence[str] | None, what: str) -> list[int]:
    if wanted is None:
        return list(range(len(known)))
    wanted = listed_names(wanted, "select: inputs and outputs")
    for name in wanted:
        if name not in known:
            raise InputError(f"{what} {name!r}." + nearest(name, known))
    return [list(known).index(name) for name in wanted]
