"""Modal damping: physical damping projected on the modes, kept full or made diagonal by an explicit choice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexplant.errors import expect_choice
from flexplant.model.arrays import FloatArray
from flexplant.model.damping import DampingRatio, damping_ratios

CHOICES = ("keep", "drop")
ROUND_OFF = 1e-9  # damping of a rigid-body motion, and coupling of two modes, below which it is cancellation of Phi^T Z Phi


@dataclass(frozen=True, eq=False)
class ModalDamping:
    """zeta (n,), matrix (n, n) or None where it is diag(2 zeta omega), replaced: not the projected Z; report for the plant."""

    zeta: FloatArray
    matrix: FloatArray | None
    replaced: bool
    report: dict[str, Any]


def ratio_damping(ratio: DampingRatio, omega: FloatArray) -> ModalDamping:
    """Damping ratios (one value, one a mode, or a table over frequency in Hz) in place of physical damping."""
    zeta = damping_ratios(ratio, omega / (2 * np.pi))
    return ModalDamping(zeta, None, True, {"damping": "ratios given for the coupled modes"})


def check_choice(choice: object) -> None:
    """InputError unless `choice` says what to do with damping that couples modes."""
    expect_choice(choice, CHOICES, "off_diagonal_damping")


def projected_damping(damping: Any, shapes: FloatArray, omega: FloatArray, choice: str) -> ModalDamping:
    """Phi^T Z Phi (n, n). choice "keep" keeps it full where modes are coupled by damping; "drop" keeps its diagonal.

    damping: (m, m) physical Z; shapes: (m, n) mass-normalised. The report states the largest coupling
    |z_ij| / sqrt(z_ii z_jj), its pair of modes and their frequencies.
    """
    Z = _without_round_off(damping, shapes, omega)
    size = np.sqrt(np.maximum(np.diag(Z), 0.0))
    coupling = np.divide(abs(Z), np.outer(size, size), out=np.zeros_like(Z), where=np.outer(size, size) > 0)
    np.fill_diagonal(coupling, 0.0)
    largest = float(coupling.max()) if coupling.size else 0.0
    coupled = largest > ROUND_OFF
    diagonal = np.diag(Z)
    zeta = np.divide(diagonal, 2 * omega, out=np.zeros_like(omega), where=omega > 0)
    zeta[(zeta < 0) & (zeta > -1e-12)] = 0.0
    matrix = Z if coupled and choice == "keep" else None
    if matrix is None and (diagonal[omega == 0] != 0).any():
        matrix = np.diag(diagonal)  # a grounded damper acts on a rigid-body mode, which has no damping ratio
    report = {"damping": "projected physical damping", "off_diagonal_damping": _coupling_report(coupling, omega, choice, coupled)}
    return ModalDamping(zeta, matrix, choice == "drop" and coupled, report)


def _without_round_off(damping: Any, shapes: FloatArray, omega: FloatArray) -> FloatArray:
    """Phi^T Z Phi, with rows of rigid-body modes set to exactly zero where Z Phi is cancellation."""
    product = damping @ shapes
    Z: FloatArray = shapes.T @ product
    Z = 0.5 * (Z + Z.T)
    scale = np.sqrt(np.einsum("ij,ij->j", abs(shapes), abs(damping) @ abs(shapes)))
    for i in np.flatnonzero(omega == 0):
        cancelled = abs(product[:, i]) <= ROUND_OFF * (abs(damping) @ abs(shapes[:, i]))
        if cancelled.all() or Z[i, i] <= ROUND_OFF * scale[i] ** 2:
            Z[i, :] = Z[:, i] = 0.0
    return Z


def _coupling_report(coupling: FloatArray, omega: FloatArray, choice: str, coupled: bool) -> dict[str, Any]:
    if not coupled:
        return {"largest": 0.0, "dropped": False}
    i, j = (int(k) for k in np.unravel_index(int(np.argmax(coupling)), coupling.shape))
    return {
        "largest": float(coupling[i, j]),
        "modes": (min(i, j), max(i, j)),
        "frequency_hz": tuple(float(omega[k] / (2 * np.pi)) for k in sorted((i, j))),
        "dropped": choice == "drop",
    }
