"""Frequency response of modal plants: residues times modal transfer functions, in blocks of frequencies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.linalg

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.subset import with_modes
from flexplant.response.receptance import ModalSum

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
BLOCK = 512  # frequencies whose modal transfer functions stay in cache
RIGID_ROUND_OFF = 1e-9  # rigid-body response relative to its terms, below which it is taken as cancelled at 0 Hz
WELL_CONDITIONED = 1e5  # eigenvectors up to which pole-residue sums keep about eleven digits


def modal_response(plant: ModalPlant, hz: FloatArray, out: ComplexArray | None = None) -> ComplexArray:
    """(ny, nu, nf) complex response of a checked plant at checked frequencies, written into `out` where it is given."""
    return ModalResponse(plant)(2 * np.pi * hz, out)


class ModalResponse:
    """What does not depend on the frequency, made once: residues c_i b_i^T of each kind of output (see `ModalSum`).

    Call it with omega (nf,) rad/s, and C-contiguous complex memory (ny, nu, nf) for the result.
    """

    def __init__(self, plant: ModalPlant) -> None:
        self.plant, self._direct = plant, np.ascontiguousarray(plant.direct)
        self._first: list[_Kind] = []  # write the rows that no kind before wrote
        self._later: list[_Kind] = []  # add to rows
        self._silent = np.ones(len(plant.outputs), dtype=bool)
        if plant.damping is None and plant.n_modes and plant.inputs:
            for rows, order, shapes in _kinds(plant):
                for kinds, which in ((self._first, self._silent[rows]), (self._later, ~self._silent[rows])):
                    if which.any():
                        kinds.append(_kind(plant, rows[which], order, shapes[which]))
                self._silent[rows] = False

    def __call__(self, omega: FloatArray, out: ComplexArray | None = None) -> ComplexArray:
        """(ny, nu, nf) response; InputError on an undamped pole."""
        plant = self.plant
        out = np.empty((len(plant.outputs), len(plant.inputs), omega.size), dtype=complex) if out is None else out
        out[self._silent] = self._direct[self._silent][:, :, None]
        if plant.damping is not None:
            _add_fully_damped(plant, omega, out)
            return out
        if plant.n_modes:
            _refuse_poles(plant, omega)
            _refuse_infinite(plant, omega)
        flat = out.reshape(-1, omega.size)
        for kind in self._first:
            direct = self._direct.ravel()[kind.entries]
            kind.total(omega, derivative=kind.order, direct=direct, out=flat, rows=kind.entries)
            _add_at_zero(kind, omega, flat)
        for kind in self._later:
            flat[kind.entries] += kind.total(omega, derivative=kind.order)
            _add_at_zero(kind, omega, flat)
        return out


@dataclass(frozen=True, eq=False)
class _Kind:
    """Displacements, velocities or accelerations (order 0, 1, 2) at entries (output, input) of the response, counted flat."""

    total: ModalSum
    order: int
    entries: IntArray
    rigid: FloatArray


def _kind(plant: ModalPlant, rows: IntArray, order: int, shapes: FloatArray) -> _Kind:
    flexible, nu = plant.omega > 0, len(plant.inputs)
    residues, rigid = _residues(plant, shapes, flexible)
    omega, zeta = plant.omega[flexible], plant.zeta[flexible]
    if rigid.any():
        residues, omega, zeta = np.column_stack([residues, rigid]), np.append(omega, 0.0), np.append(zeta, 0.0)
    return _Kind(ModalSum(residues, omega, zeta), order, (rows[:, None] * nu + np.arange(nu)).ravel(), rigid)


def _add_at_zero(kind: _Kind, omega: FloatArray, flat: ComplexArray) -> None:
    """The accelerations of rigid-body modes at w = 0, which the sum does not see: (i w)^2 / -w^2 = 1."""
    if kind.order == 2 and not omega.all():
        flat[kind.entries[:, None], np.flatnonzero(omega == 0)] += kind.rigid[:, None]


def _residues(plant: ModalPlant, shapes: FloatArray, flexible: npt.NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """(rows * nu, modes) c_i b_i^T of each flexible mode, and (rows * nu,) the sum of those of the rigid-body modes."""
    product = shapes[:, None, flexible] * plant.shape_in[flexible].T[None, :, :]
    rigid = shapes[:, ~flexible] @ plant.shape_in[~flexible]
    return product.reshape(rigid.size, product.shape[2]), rigid.ravel()


def _refuse_infinite(plant: ModalPlant, omega: FloatArray) -> None:
    """InputError for 0 Hz where a displacement or velocity sees a rigid-body mode."""
    rigid = plant.omega == 0
    if rigid.any() and not omega.all():
        for rows, order, shapes in _kinds(plant):
            if order < 2:
                _refuse_rigid_at_zero(plant, rows, shapes, shapes[:, rigid] @ plant.shape_in[rigid])


def _kinds(plant: ModalPlant) -> Iterator[tuple[npt.NDArray[np.int64], int, FloatArray]]:
    """(rows, derivative order 0-2, shapes of those rows) of each kind of output that is used."""
    for order, shapes in enumerate((plant.shape_out, plant.shape_out_velocity, plant.shape_out_acceleration)):
        if shapes is not None and (rows := np.flatnonzero(shapes.any(axis=1))).size:
            yield rows, order, shapes[rows]


def _add_rigid(plant: ModalPlant, omega: FloatArray, out: ComplexArray) -> npt.NDArray[np.bool_]:
    """Adds the rigid-body modes, residue * (i w)^order / (-w^2), exactly; returns which modes are left."""
    rigid = np.asarray(plant.omega == 0)
    flexible: npt.NDArray[np.bool_] = ~rigid
    if flexible.all():
        return flexible
    at_zero = omega == 0
    safe = np.where(at_zero, 1.0, omega)
    for rows, order, shapes in _kinds(plant):
        residue = shapes[:, rigid] @ plant.shape_in[rigid]
        if order < 2 and at_zero.any():
            _refuse_rigid_at_zero(plant, rows, shapes, residue)
        factor = (-1 / safe**2 + 0j, -1j / safe, np.ones(omega.size, complex))[order]
        out[rows] += residue[:, :, None] * (factor if order == 2 else np.where(at_zero, 0.0, factor))
    return flexible


def _refuse_rigid_at_zero(plant: ModalPlant, rows: npt.NDArray[np.int64], shapes: FloatArray, residue: FloatArray) -> None:
    rigid = plant.omega == 0
    terms = abs(shapes[:, rigid]) @ abs(plant.shape_in[rigid])
    if not (abs(residue) > RIGID_ROUND_OFF * terms).any():
        return
    i, j = np.argwhere(abs(residue) > RIGID_ROUND_OFF * terms)[0]
    parts = abs(shapes[i, rigid] * plant.shape_in[rigid, j])
    mode = int(np.flatnonzero(rigid)[int(np.argmax(parts))])
    raise InputError(
        f"the response of {plant.outputs[rows[i]]!r} to {plant.inputs[j]!r} is infinite at 0 Hz: rigid-body mode {mode} "
        "(counted from 0) is free; start above 0 Hz, or ask for accelerations"
    )


def _refuse_poles(plant: ModalPlant, omega: FloatArray) -> None:
    """InputError for a frequency exactly on an undamped flexible mode."""
    undamped = np.flatnonzero((plant.zeta == 0) & (plant.omega > 0))
    if not undamped.size:
        return
    at, ascending = plant.omega[undamped], np.sort(omega)
    nearest_omega = ascending[np.minimum(np.searchsorted(ascending, at * (1 - 4e-16)), omega.size - 1)]
    hit = undamped[abs(nearest_omega - at) <= 4e-16 * at]
    if hit.size:
        raise InputError(
            f"modal plant {plant.name!r}: {plant.omega[hit[0]] / (2 * np.pi):.9g} Hz lies exactly on mode {hit[0]} (counted from "
            "0), which has no damping; give it a damping ratio or move the frequency"
        )


def _add_fully_damped(plant: ModalPlant, omega: FloatArray, out: ComplexArray) -> None:
    """Modes coupled by damping: undamped rigid-body modes apart, the rest by poles and residues, or frequency by frequency."""
    assert plant.damping is not None
    free = (plant.omega == 0) & ~plant.damping.any(axis=1)
    rest = ~free
    if free.any():
        _add_rigid(_part(plant, free), omega, out)
    if not rest.any():
        return
    part = _part(plant, rest)
    if (part.omega == 0).any() or not _add_pole_residue(part, omega, out):
        _add_by_solution(part, omega, out)


def _part(plant: ModalPlant, which: npt.NDArray[np.bool_]) -> ModalPlant:
    """The selected modes alone, without direct terms."""
    return replace(with_modes(plant, which), feedthrough=None, static_correction=None)


def _add_pole_residue(plant: ModalPlant, omega: FloatArray, out: ComplexArray) -> bool:
    """One complex eigen-decomposition in the states (wn eta, eta'); False where its vectors are badly conditioned.

    eta = wn^-1 x1 and eta' = x2; acceleration rows use eta'' = i w eta'.
    """
    n, wn = plant.n_modes, plant.omega
    A = np.block([[np.zeros((n, n)), np.diag(wn)], [-np.diag(wn), -plant.damping_matrix]])
    poles, vectors = scipy.linalg.eig(A)
    if np.linalg.cond(vectors) > WELL_CONDITIONED or not _clear_of(poles, omega):
        return False
    left = np.linalg.solve(vectors, np.vstack([np.zeros_like(plant.shape_in), plant.shape_in]).astype(complex))
    for rows, order, shapes in _kinds(plant):
        right = shapes @ (vectors[:n] / wn[:, None] if order == 0 else vectors[n:])
        residues = (right[:, None, :] * left.T[None, :, :]).reshape(-1, 2 * n)
        for start in range(0, omega.size, BLOCK):
            at = slice(start, start + BLOCK)
            s = 1j * omega[at]
            block = (residues @ (1 / (s - poles[:, None]))).reshape(rows.size, -1, s.size)
            out[rows, :, at] += block * s if order == 2 else block
    return True


def _clear_of(poles: ComplexArray, omega: FloatArray) -> bool:
    """False where an evaluation point coincides with a pole to round-off; the direct solution then decides."""
    near = poles[abs(poles.real) <= 1e-12 * abs(poles).max()]
    return not any((abs(1j * omega - p) <= 1e-12 * abs(poles).max()).any() for p in near)


def _add_by_solution(plant: ModalPlant, omega: FloatArray, out: ComplexArray) -> None:
    """(wn^2 - w^2 + i w Z) eta = b, one factorisation a frequency."""
    for k, w in enumerate(omega):
        dynamic = np.diag((plant.omega - w) * (plant.omega + w)) + 1j * w * plant.damping_matrix
        try:
            eta = np.linalg.solve(dynamic, plant.shape_in.astype(complex))
        except np.linalg.LinAlgError:
            mode = int(np.argmin(abs(plant.omega - w)))
            raise InputError(
                f"modal plant {plant.name!r}: {w / (2 * np.pi):.9g} Hz lies on a pole without damping, near mode {mode} "
                "(counted from 0); move the frequency"
            ) from None
        for rows, order, shapes in _kinds(plant):
            out[rows, :, k] += (1j * w) ** order * (shapes @ eta)
