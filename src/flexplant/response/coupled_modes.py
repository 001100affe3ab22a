"""Frequency response of modes that damping couples: poles and residues, the near-rigid modes solved beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.linalg

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.numerics.threads import one_thread
from flexplant.plant.modal import ModalPlant

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
Kind: TypeAlias = tuple[IntArray, int, FloatArray]  # rows of the response, derivative order 0-2, shapes of those rows
BLOCK = 512  # frequencies whose pole terms stay in cache
WELL_CONDITIONED = 1e5  # eigenvectors up to which sums of residues are tried
NEAR_RIGID = 1e-3  # of the highest frequency, below which round-off of the fast modes would blur a pole
FEW = 8  # frequencies that are solved one by one
SAMPLES = 4  # poles beside which sums are held against solutions, as at the ends of the grid
CHECKED, RESONANT = 1e-12, 2e-15  # error of a sum relative to its terms, and for each frequency / distance from a pole
STEP = 1e-6  # of a pole: a longer correction belongs to poles that meet


class CoupledResponse:
    """The response of all modes of a plant with full damping, without its direct terms; what is decomposed, is decomposed once.

    By poles and residues where these agree with solutions at a few frequencies, or by a solution at each frequency.
    """

    def __init__(self, plant: ModalPlant, kinds: list[Kind]) -> None:
        self.plant, self.kinds = plant, kinds
        self.near = plant.omega < NEAR_RIGID * plant.omega.max(initial=0.0)
        self._fast: _FastModes | None = None
        self._decomposable = bool(plant.n_modes) and not self.near.all()

    @one_thread
    def __call__(self, omega: FloatArray, out: ComplexArray) -> None:
        """Adds to out (ny, nu, nf); InputError on a pole without damping."""
        fast = self._trusted(np.sort(omega)) if omega.size > FEW else None
        for start in range(0, omega.size, BLOCK):
            at = slice(start, start + BLOCK)
            values = None if fast is None else _by_poles(self.plant, self.near, fast, self.kinds, omega[at])
            out[:, :, at] += (_by_solution(self.plant, self.kinds, omega[at]) if values is None else values).transpose(1, 2, 0)

    def _trusted(self, omega: FloatArray) -> _FastModes | None:
        """The decomposition, if it holds at ascending omega."""
        if self._fast is None and self._decomposable:
            self._fast = _fast_modes(self.plant, ~self.near, self.kinds)
            self._decomposable = self._fast is not None
        fast = self._fast
        if fast is None or not _clear_of(fast.poles, omega):
            return None
        return fast if _holds(self.plant, self.near, fast, self.kinds, omega) else None


@dataclass(frozen=True, eq=False)
class _FastModes:
    """poles (p,), left (p, nu + near-rigid), right (rows of all kinds + near-rigid, p): velocities for order > 0."""

    poles: ComplexArray
    left: ComplexArray
    right: ComplexArray


def _fast_modes(plant: ModalPlant, fast: npt.NDArray[np.bool_], kinds: list[Kind]) -> _FastModes | None:
    """One complex eigen-decomposition in the states (wn eta, eta'); None where its vectors are ill-conditioned.

    The QR algorithm keeps small eigenvalues where a matrix is graded downwards, so that the fastest mode comes first; a step of
    Rayleigh's quotient, phi^T (p^2 + p Z + wn^2) phi over its derivative, takes poles to round-off of their own size.
    """
    assert plant.damping is not None
    order = np.flatnonzero(fast)[np.argsort(plant.omega[fast])[::-1]]
    wn, Z, n = plant.omega[order], plant.damping[np.ix_(order, order)], order.size
    mixed = np.arange(2 * n).reshape(2, n).T.ravel()  # the two states of a mode side by side
    A = np.block([[np.zeros((n, n)), np.diag(wn)], [-np.diag(wn), -Z]])
    poles, graded = scipy.linalg.eig(A[np.ix_(mixed, mixed)])
    vectors = np.empty_like(graded)
    vectors[mixed] = graded
    factor, pivots, _ = scipy.linalg.lapack.zgetrf(vectors)
    reciprocal, _ = scipy.linalg.lapack.zgecon(factor, np.linalg.norm(vectors, 1))
    if reciprocal * WELL_CONDITIONED < 1:
        return None
    forces = np.hstack([plant.shape_in[order], plant.damping[np.ix_(order, ~fast)]])
    left, _ = scipy.linalg.lapack.zgetrs(factor, pivots, np.vstack([np.zeros_like(forces), forces]).astype(complex))
    phi = vectors[:n] / wn[:, None]
    poles = _corrected(poles, phi, wn, Z)
    moved = phi * poles
    shown = [shapes[:, order] @ (phi if k == 0 else moved) for _, k, shapes in kinds]
    return _FastModes(poles, left, np.vstack([*shown, plant.damping[np.ix_(~fast, order)] @ moved]))


def _corrected(poles: ComplexArray, phi: ComplexArray, wn: FloatArray, Z: FloatArray) -> ComplexArray:
    damped = Z @ phi
    residual = (poles - 1j * wn[:, None]) * (poles + 1j * wn[:, None]) * phi + poles * damped
    slope = 2 * poles * (phi * phi).sum(axis=0) + (phi * damped).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        step = (phi * residual).sum(axis=0) / slope
    return np.asarray(np.where(abs(step) < STEP * abs(poles), poles - step, poles))


def _by_poles(
    plant: ModalPlant, near: npt.NDArray[np.bool_], fast: _FastModes, kinds: list[Kind], omega: FloatArray
) -> ComplexArray | None:
    """(nf, ny, nu); None where a frequency lies on a pole of the near-rigid modes.

    With fast modes f and near-rigid ones r, D_ff = wn_f^2 + s Z_ff + s^2 and the like:
    (D_rr - s^2 Z_rf D_ff^-1 Z_fr) eta_r = b_r - s Z_rf D_ff^-1 b_f and eta_f = D_ff^-1 (b_f - s Z_fr eta_r).
    """
    nu, beside = len(plant.inputs), int(near.sum())
    residues = (fast.right[:, None, :] * fast.left.T[None, :, :]).reshape(len(fast.right) * fast.left.shape[1], fast.poles.size)
    s = np.asarray(1j * omega, dtype=np.complex128)
    terms = residues @ (1 / (s - fast.poles[:, None]))
    H = terms.reshape(len(fast.right), fast.left.shape[1], s.size).transpose(2, 0, 1)
    eta = _near_rigid(plant, near, H, s) if beside else None
    if beside and eta is None:
        return None
    out, first, s = np.zeros((s.size, len(plant.outputs), nu), dtype=complex), 0, s[:, None, None]
    for rows, order, shapes in kinds:
        mine = H[:, first : first + rows.size]
        part = mine[:, :, :nu]
        if eta is not None:
            part = part - mine[:, :, nu:] @ (s * eta) + (shapes[:, near] @ eta) * (1 if order == 0 else s)
        out[:, rows] += part * s if order == 2 else part
        first += rows.size
    return out


def _near_rigid(plant: ModalPlant, near: npt.NDArray[np.bool_], H: ComplexArray, s: ComplexArray) -> ComplexArray | None:
    """(nf, near-rigid modes, nu) eta_r."""
    assert plant.damping is not None
    wn, w, nu = plant.omega[near], s.imag[:, None], len(plant.inputs)
    own = H[:, -wn.size :]
    dynamic = s[:, None, None] * (plant.damping[np.ix_(near, near)] - own[:, :, nu:])
    at = np.arange(wn.size)
    dynamic[:, at, at] += (wn - w) * (wn + w)
    try:
        return np.asarray(np.linalg.solve(dynamic, plant.shape_in[near] - own[:, :, :nu]))
    except np.linalg.LinAlgError:
        return None


def _holds(plant: ModalPlant, near: npt.NDArray[np.bool_], fast: _FastModes, kinds: list[Kind], omega: FloatArray) -> bool:
    """True where sums of residues agree with solutions at the ends of the grid and beside the poles that are nearest to it."""
    inside = fast.poles[(fast.poles.imag >= omega[0]) & (fast.poles.imag <= omega[-1])]
    nearest = inside[np.argsort(abs(inside.real) / abs(inside))[:SAMPLES]]
    at = np.minimum(np.searchsorted(omega, np.r_[nearest.imag, abs(inside).min(initial=np.inf)]), omega.size - 1)
    w = omega[np.unique(np.r_[0, at, omega.size - 1])]
    found = _by_poles(plant, near, fast, kinds, w)
    if found is None:
        return False
    eta, s = _solved(plant, w), np.asarray(1j * w, dtype=np.complex128)
    terms = _shown(plant, [(rows, order, abs(shapes)) for rows, order, shapes in kinds], abs(eta) + 0j, abs(s) + 0j)
    allowed = CHECKED + RESONANT * w / abs(s[:, None] - fast.poles).min(axis=1)
    return bool((abs(found - _shown(plant, kinds, eta, s)) <= allowed[:, None, None] * abs(terms)).all())


def _clear_of(poles: ComplexArray, omega: FloatArray) -> bool:
    """False where an evaluation point coincides with a pole to round-off; the direct solution then decides."""
    near = poles[abs(poles.real) <= 1e-12 * abs(poles).max()]
    return not any((abs(1j * omega - p) <= 1e-12 * abs(poles).max()).any() for p in near)


def _by_solution(plant: ModalPlant, kinds: list[Kind], omega: FloatArray) -> ComplexArray:
    """(nf, ny, nu), one factorisation a frequency."""
    return _shown(plant, kinds, _solved(plant, omega), np.asarray(1j * omega, dtype=np.complex128))


def _solved(plant: ModalPlant, omega: FloatArray) -> ComplexArray:
    """eta (nf, n, nu) of (wn^2 - w^2 + i w Z) eta = b; InputError on a pole without damping."""
    assert plant.damping is not None
    eta = np.empty((omega.size, *plant.shape_in.shape), dtype=complex)
    for k, w in enumerate(omega):
        dynamic = np.diag((plant.omega - w) * (plant.omega + w)) + 1j * w * plant.damping
        try:
            eta[k] = np.linalg.solve(dynamic, plant.shape_in.astype(complex))
        except np.linalg.LinAlgError:
            mode = int(np.argmin(abs(plant.omega - w)))
            raise InputError(
                f"modal plant {plant.name!r}: {w / (2 * np.pi):.9g} Hz lies on a pole without damping, near mode {mode} "
                "(counted from 0); move the frequency"
            ) from None
    return eta


def _shown(plant: ModalPlant, kinds: list[Kind], eta: Any, s: Any) -> ComplexArray:
    out = np.zeros((s.size, len(plant.outputs), len(plant.inputs)), dtype=complex)
    for rows, order, shapes in kinds:
        out[:, rows] += s[:, None, None] ** order * (shapes @ eta)
    return out
