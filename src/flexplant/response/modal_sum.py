"""Frequency response of modal plants: residues times modal transfer functions, in blocks of frequencies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.subset import with_modes
from flexplant.response.coupled_modes import CoupledResponse
from flexplant.response.receptance import ModalSum

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
RIGID_ROUND_OFF = 1e-9  # rigid-body response relative to its terms, below which it is taken as cancelled at 0 Hz


def modal_response(plant: ModalPlant, hz: FloatArray, out: ComplexArray | None = None) -> ComplexArray:
    """(ny, nu, nf) complex response of a checked plant at checked frequencies, written into `out` where it is given."""
    return ModalResponse(plant)(2 * np.pi * hz, out)


class ModalResponse:
    """What does not depend on the frequency, made once: residues c_i b_i^T of each kind of output (see `ModalSum`).

    Call it with omega (nf,) rad/s, and C-contiguous complex memory (ny, nu, nf) for the result.
    """

    def __init__(self, plant: ModalPlant) -> None:
        self._coupled: CoupledResponse | None = None
        if plant.damping is not None:
            plant, rest = _divided(plant)
            self._coupled = CoupledResponse(rest, list(_kinds(rest))) if rest.n_modes else None
        self.plant, self._direct = plant, np.ascontiguousarray(plant.direct)
        self._first: list[_Kind] = []  # write the rows that no kind before wrote
        self._later: list[_Kind] = []  # add to rows
        self._silent = np.ones(len(plant.outputs), dtype=bool)
        if plant.n_modes and plant.inputs:
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
        if self._coupled is not None:
            self._coupled(omega, out)
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


def _divided(plant: ModalPlant) -> tuple[ModalPlant, ModalPlant]:
    """(the plant with all modes but only those excited that damping does not couple, their ratios its own; the others alone)."""
    assert plant.damping is not None
    own = np.diag(plant.damping)
    coupled = (plant.damping - np.diag(own)).any(axis=1) | ((plant.omega == 0) & (own != 0))
    zeta = np.divide(own, 2 * plant.omega, out=np.zeros_like(own), where=plant.omega > 0)
    coupled |= zeta < 0
    apart = replace(
        plant, damping=None, zeta=np.where(coupled, 1.0, zeta), shape_in=np.where(coupled[:, None], 0.0, plant.shape_in)
    )
    rest = replace(with_modes(plant, coupled), feedthrough=None, static_correction=None)
    return (with_modes(apart, ~coupled) if coupled.all() else apart), rest
