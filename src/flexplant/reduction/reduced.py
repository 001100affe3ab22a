"""What a reduction returns: a component that remembers how it was made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray
from flexplant.model.component import Component
from flexplant.model.coordinates import LeftOut
from flexplant.model.dofs import DofSet

Storage: TypeAlias = bool | Callable[[tuple[int, int]], Any]


@dataclass(frozen=True)
class ReductionReport:
    """What a reduction chose, and what it proved.

    n_modes: exact modes of the held (or free) model. n_residual: residual (Ritz) vectors besides them, in `blocks` blocks, or
    drawn from a basis of `drawn_from` vectors that had so many blocks.
    complete_below_hz: the basis holds every fixed-interface (Rubin: free) mode below it; proved: a Sturm count said so.
    residuals: of each mode, |K x - w^2 M x| / |K x|, computed from the matrices of the held (Rubin: free) model.
    accuracy: asked relative frequency error, None where modes and blocks were given. verified: bound of the relative error of
    any system's frequency up to max_frequency_hz that this component causes, never less than what rounding its matrices to
    double precision may cause; None where it was not computed.
    basis_bytes: memory that keeping the basis takes (or would take).
    interface_dofs: boundary DOF that interface_coordinates stand for since then (characteristic constraint modes).
    """

    method: str
    n_modes: int
    n_residual: int = 0
    blocks: int = 0
    drawn_from: int | None = None
    complete_below_hz: float = 0.0
    proved: bool = False
    residuals: tuple[float, ...] = ()
    max_frequency_hz: float | None = None
    accuracy: float | None = None
    verified: float | None = None
    basis_bytes: int = 0
    interface_dofs: int = 0
    interface_coordinates: int = 0

    def __str__(self) -> str:
        text = f"{self.method}: {self.n_modes} modes + {self.n_residual} residual vectors"
        if self.drawn_from is not None:
            text += f" drawn from {self.drawn_from} in {self.blocks} blocks"
        elif self.blocks:
            text += f" in {self.blocks} blocks"
        kind = "free" if self.method == "Rubin" else "fixed-interface"
        text += f"; all {kind} modes below {self.complete_below_hz:.6g} Hz" if self.complete_below_hz else ""
        text += (" (counted)" if self.proved else " (not counted)") if self.complete_below_hz else ""
        if not self.interface_dofs and self.complete_below_hz < (1 - 1e-9) * (self.max_frequency_hz or 0.0):
            text += f", short of the {self.max_frequency_hz:g} Hz asked" + (
                "" if kind == "free" else " because n_modes came first"
            )
        text += f", residuals at most {max(self.residuals):.0e}" if self.residuals else ""
        if self.verified is not None:
            asked = "" if self.accuracy is None else f", asked {self.accuracy:.1e}"
            text += f"; frequency error below {self.max_frequency_hz:g} Hz at most {self.verified:.1e}{asked}"
        if self.interface_dofs:
            text += f"; {self.interface_coordinates} coordinates of the interface for {self.interface_dofs} boundary DOF"
        return text + f"; full basis {self.basis_bytes / 1e6:.3g} MB"

    def narrowed(self, left_out: LeftOut, size: float) -> ReductionReport:
        """The report after an interface was described by fewer coordinates, which left `size` of all coordinates.

        No motion left out inside or at the interface lies below w_c: in coordinates of unit strain energy, where w^-2 are the
        eigenvalues of the mass, they are at most 1 / w_i^2 + 1 / w_x^2.
        """
        hz = np.array([self.complete_below_hz, np.sqrt(left_out.slowest) / (2 * np.pi)])
        slowness = float(np.hypot(*(1 / hz))) if hz.all() else np.inf
        dofs, coordinates = left_out.interface
        return replace(
            self,
            complete_below_hz=1 / slowness if slowness else np.inf,
            verified=self.verified if np.isinf(left_out.slowest) else None,
            basis_bytes=round(self.basis_bytes * size),
            interface_dofs=self.interface_dofs + dofs,
            interface_coordinates=self.interface_coordinates + coordinates,
        )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ReducedComponent(Component):
    """A component made by a reduction, u = T p.

    basis: T (n_model, n) or None; rows are the model's `model_dofs`. error_rows: L (k, n) with which a coupled mode p of
    w^2 has the residual energy |w^2 L p|^2 that the basis cannot balance; None where it was not asked for.
    """

    report: ReductionReport
    model_dofs: DofSet
    reduced_units: str
    basis: FloatArray | None = None
    error_rows: FloatArray | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)

    def _made(self) -> dict[str, str]:
        rows = "" if self.error_rows is None else f"{len(self.error_rows)} rows"
        return {"reduction": str(self.report), "basis": "" if self.basis is None else "kept", "error estimate": rows}

    def followed(self, basis: FloatArray, left_out: LeftOut, /) -> dict[str, Any]:
        """Basis, error rows and report on p = T p'; motions of the interface that T leaves out are errors too."""
        report = self.report.narrowed(left_out, basis.shape[1] / basis.shape[0])
        return {
            "basis": None if self.basis is None else np.asarray(self.basis @ basis),
            "error_rows": None if self.error_rows is None else np.vstack([self.error_rows @ basis, left_out.rows]),
            "report": report,
            "source": {**self.source, "reduction": str(report)},
        }


def _checked(component: Component, what: str) -> ReducedComponent:
    if not isinstance(component, ReducedComponent):
        raise InputError(f"{what}: component {component.name!r} was not made by a reduction in this session; reduce its model")
    if component.units != component.reduced_units:
        raise InputError(f"{what}: component {component.name!r} changed units after its reduction; convert the model first")
    return component


def can_estimate(component: Component) -> bool:
    """Whether the component's reduction kept what `residual_products` needs."""
    return (
        isinstance(component, ReducedComponent)
        and component.error_rows is not None
        and component.units == component.reduced_units
    )


def residual_products(component: Component, coordinates: npt.ArrayLike) -> FloatArray:
    """G = (L p)^T (L p), (k, k), of modes p (n, k): at a frequency w their residuals' energies are w^4 G / (1 - w^2 / w_c^2).

    w_c is the frequency below which the reduction's exact modes are complete (`amplification`). Raises InputError where the
    reduction kept no error rows.
    """
    reduced = _checked(component, "estimate_error")
    if reduced.error_rows is None:
        raise InputError(
            f"estimate_error: component {component.name!r} has no error rows; reduce it with error_estimate=True (not by guyan)"
        )
    lost = reduced.error_rows @ np.asarray(coordinates)
    return np.asarray(lost.T @ lost)


def amplification(omega2: FloatArray, complete: float) -> FloatArray:
    """1 / (1 - w^2 / w_c^2), infinite from w_c on: how much dynamics amplify the static answer to a residual."""
    left = 1 - omega2 / complete if complete > 0 else np.full_like(omega2, -1.0)
    return np.divide(1.0, left, out=np.full_like(left, np.inf), where=left > 0)
