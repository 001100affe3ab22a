"""Directions without mass: they follow a load at once, so that their velocities follow the load's rate."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from flexplant.assembly import System
from flexplant.errors import LeftOutWarning, SolverError
from flexplant.model.arrays import FloatArray, dense
from flexplant.plant.channels import InputColumns, OutputRows

if TYPE_CHECKING:
    from flexplant.plant.modal import ModalPlant

FASTEST = 1e4  # times the highest frequency of a plant: beyond it a direction has no dynamics that a band could show
DEPENDENT = 1e-10  # strain energy of a combination of vectors, relative to the largest, below which it is round-off
ROUND_OFF = 1e-9
DAMPED = np.sqrt(0.5)  # damping ratio of a mode that stands for a direction without mass: flat below it, no ringing above


def massless_displacement(system: System, forces: Any) -> FloatArray:
    """(n, nu) static displacement p of unit inputs through the coordinates without mass alone, K_mm^-1 F_m.

    Where M has no entries, M x'' = F - K x says K_mm x_m = F_m - K_ma x_a: the second part belongs to the modes, the first
    follows the load at any frequency. forces: F (n, nu).
    """
    L = system.basis
    mass = sp.csr_array(L.T @ system.uncoupled_mass @ L)
    at = np.flatnonzero(abs(mass).sum(axis=1) == 0)
    load = dense(L.T @ dense(forces))[at]
    out = np.zeros(forces.shape)
    if not load.any():
        return out
    basis = sp.csr_array(L[:, at])
    stiffness = sp.csc_array(basis.T @ system.uncoupled_stiffness @ basis)
    used = np.flatnonzero(load.any(axis=0))
    try:
        out[:, used] = basis @ splu(stiffness).solve(load[:, used])
    except RuntimeError:
        raise SolverError(
            "modal_plant: coordinates without mass have no stiffness either; run verify(system) to see which"
        ) from None
    return out


def stiff_basis(vectors: FloatArray, stiffness: Any) -> FloatArray:
    """Vectors with the same span that are orthonormal in the stiffness."""
    energy = np.einsum("ij,ij->j", vectors, stiffness @ vectors)
    used = energy > 0
    if not used.any():
        return np.zeros((len(vectors), 0))
    scaled = vectors[:, used] / np.sqrt(energy[used])
    size, directions = la.eigh(scaled.T @ (stiffness @ scaled))
    independent = size > DEPENDENT * size.max(initial=0.0)
    return np.asarray(scaled @ (directions[:, independent] / np.sqrt(size[independent])))


def with_rates(
    plant: ModalPlant, system: System, columns: InputColumns, rows: OutputRows, massless: FloatArray, as_modes: bool
) -> ModalPlant:
    """The plant, with a fast mode for each direction without mass whose velocity or acceleration an output shows, or a warning.

    massless (n, nu): static displacement of unit inputs that has no inertia, X X^T F. The velocities s X X^T F u are no proper
    function of u; the fast modes show X X^T F s w^2 / (s^2 + sqrt(2) w s + w^2) instead, w = FASTEST times the highest frequency:
    with the wrong phase by sqrt(2) / FASTEST there, less in proportion below, and no ringing above. Displacements keep their
    direct term. Without modes to compare with, or with as_modes False, a `LeftOutWarning` names the channels.
    """
    seen = _seen(rows, massless)
    if not seen.any():
        return plant
    highest = float(plant.omega.max(initial=0.0))
    if not (as_modes and highest):
        return replace(plant, report=_told(plant.report, _warn(columns.names, rows.names, seen)))
    return _with_fast_modes(plant, columns, rows, stiff_basis(massless, system.uncoupled_stiffness), FASTEST * highest)


def _seen(rows: OutputRows, massless: FloatArray) -> Any:
    """(ny, nu) True where a velocity or acceleration output shows a direction without mass that an input moves."""
    seen = np.zeros((len(rows.names), massless.shape[1]), dtype=bool)
    for matrix in (rows.velocity, rows.acceleration):
        if matrix is not None:
            seen |= abs(matrix @ massless) > ROUND_OFF * (abs(matrix) @ abs(massless))
    return seen & ~rows.is_multiplier[:, None]


def _with_fast_modes(plant: ModalPlant, columns: InputColumns, rows: OutputRows, basis: FloatArray, omega: float) -> ModalPlant:
    """Fast modes for each vector of the basis: one for velocities, and one more where there are accelerations.

    Two modes at w and 2 w, weighed 4/3 and -1/3, show the acceleration without a direct term, so that steps of sampled inputs
    do not appear in it with w^2.
    """
    own = rows.velocity, rows.acceleration
    speeds = np.array([1.0, 2.0] if own[1] is not None and (own[1] @ basis).any() else [1.0])
    weights = {1: [1.0, 0.0], 2: [4 / 3, -1 / 3]}
    fast, shapes = np.repeat(speeds * omega, basis.shape[1]), np.hstack([basis * (speed * omega) for speed in speeds])

    def beside(order: int, known: FloatArray | None) -> FloatArray | None:
        if (matrix := own[order - 1]) is None:
            return known
        shown = np.hstack([weight * (matrix @ basis) * (k * omega) for weight, k in zip(weights[order], speeds, strict=False)])
        shown[rows.is_multiplier] = 0.0
        return np.hstack([np.zeros((len(shown), plant.n_modes)) if known is None else known, shown])

    assert plant.shape_out is not None
    damping = None if plant.damping is None else la.block_diag(plant.damping, np.diag(2 * DAMPED * fast))
    counted = {"residual_modes": plant.report["residual_modes"] + fast.size, "massless_modes": fast.size}
    return replace(
        plant,
        omega=np.r_[plant.omega, fast],
        zeta=np.r_[plant.zeta, np.full(fast.size, DAMPED)],
        damping=damping,
        shape_in=np.vstack([plant.shape_in, (columns.matrix.T @ shapes).T]),
        shape_out=np.hstack([plant.shape_out, np.zeros((len(plant.outputs), fast.size))]),
        shape_out_velocity=beside(1, plant.shape_out_velocity),
        shape_out_acceleration=beside(2, plant.shape_out_acceleration),
        report={**plant.report, **counted, "massless_hz": omega / (2 * np.pi)},
    )


def _warn(inputs: Sequence[str], outputs: Sequence[str], seen: Any) -> str:
    """Warns; returns what is left out."""
    i, j = np.argwhere(seen)[0]
    more = f" (and {int(seen.sum()) - 1} pairs more)" if seen.sum() > 1 else ""
    lacking = (
        f"{inputs[j]!r} moves coordinates without mass, and {outputs[i]!r}{more} lacks their part, which follows the input's rate"
    )
    warnings.warn(
        LeftOutWarning(
            f"modal_plant: {lacking}; use static_correction='modes' (fast modes), descriptor(system, ...), a displacement "
            "output, or give these coordinates inertia"
        ),
        stacklevel=4,
    )
    return lacking


def _told(report: Mapping[str, Any], notice: str) -> dict[str, Any]:
    return {**report, "notice": "; ".join(text for text in (report.get("notice"), notice) if text)}
