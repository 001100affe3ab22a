"""Modes ranked by what they contribute to chosen inputs and outputs, and dropped below a stated tolerance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import scipy.linalg

from flexplant.errors import InputError, expect, expect_choice, expect_count
from flexplant.model.arrays import FloatArray, checked_switch, is_number
from flexplant.plant.balanced import gramian_singular_values, gramians
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, state_space
from flexplant.plant.subset import with_modes

MEASURES = ("peak", "hankel")


def _rows(plant: ModalPlant) -> tuple[FloatArray, FloatArray, FloatArray]:
    zero = np.zeros((len(plant.outputs), plant.n_modes))
    kinds = (plant.shape_out, plant.shape_out_velocity, plant.shape_out_acceleration)
    position, velocity, acceleration = (zero if shapes is None else shapes for shapes in kinds)
    return position, velocity, acceleration


def _peaks(c0: FloatArray, c1: FloatArray, c2: FloatArray, plant: ModalPlant) -> FloatArray:
    """Exact H-infinity norm of each mode (c0 + s c1 + s^2 c2) b^T / (s^2 + 2 zeta w s + w^2), (n,).

    With x = frequency^2 the squared gain is a ratio of two quadratics in x, whose extrema solve a quadratic.
    """
    w, zeta = plant.omega, plant.zeta
    size = (c1**2).sum(axis=0) - 2 * (c0 * c2).sum(axis=0)
    n0, n1, n2 = (c0**2).sum(axis=0), size * w**2, (c2**2).sum(axis=0) * w**4  # x in units of w^2, to keep the scale
    middle = 4 * zeta**2 - 2  # denominator: w^4 (1 + middle x + x^2)
    a, b, c = n2 * middle - n1, 2 * (n2 - n0), n1 - n0 * middle
    root = np.sqrt(np.maximum(b * b - 4 * a * c, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -0.5 * (b + np.where(b >= 0, root, -root))
        points = np.stack([np.zeros_like(w), np.ones_like(w), q / a, c / q])
        points = np.where(np.isfinite(points) & (points > 0), points, 0.0)
        below = (1 - points) ** 2 + 4 * zeta**2 * points
        gain = np.sqrt(np.maximum(n0 + n1 * points + n2 * points**2, 0.0) / below) / w**2
        gain = np.where(np.isnan(gain), 0.0, gain).max(axis=0)
    high = np.sqrt((c2**2).sum(axis=0))
    forced = np.linalg.norm(plant.shape_in, axis=1)
    return np.asarray(np.multiply(np.maximum(gain, high), forced, out=np.zeros_like(w), where=forced > 0))


def peak_gains(plant: ModalPlant) -> FloatArray:
    """(n,) peak gain (H-infinity norm) of each mode by itself, inf for an undamped or rigid-body mode that is seen.

    Modal damping is taken as diag(2 zeta omega). Gains of unlike units add up as they stand: choose channels accordingly.
    """
    expect(plant, ModalPlant, "peak_gains", "modal_plant(system, ...) makes one")
    flexible = plant.omega > 0
    gains = np.zeros(plant.n_modes)
    safe = replace(plant, omega=np.where(flexible, plant.omega, 1.0), damping=None)
    gains[flexible] = _peaks(*_rows(plant), safe)[flexible]
    seen = np.any([abs(rows).sum(axis=0) > 0 for rows in _rows(plant)], axis=0) & plant.shape_in.any(axis=1)
    gains[~flexible & seen] = np.inf
    return gains


def hankel_singular_values(plant: ModalPlant) -> FloatArray:
    """(n,) Hankel singular value of each mode.

    Modal damping: the closed form of light damping, ||b|| sqrt(||c0 / w - w c2||^2 + ||c1||^2) / (4 zeta w), where
    acceleration rows c2 count through eta'' = -w^2 eta. Full damping: sqrt of the largest eigenvalue of the mode's own 2x2
    blocks of the exact Gramians, Wc_i Wo_i, from the Lyapunov equations. Rigid-body modes: inf.
    Source: Gawronski, Advanced Structural Dynamics and Active Control of Structures, chapter 4.
    """
    expect(plant, ModalPlant, "hankel_singular_values", "modal_plant(system, ...) makes one")
    flexible = plant.omega > 0
    values = np.full(plant.n_modes, np.inf)
    if plant.damping is not None:
        values[flexible] = _from_gramians(with_modes(plant, flexible))
        return values
    c0, c1, c2 = (rows[:, flexible] for rows in _rows(plant))
    w, b = plant.omega[flexible], np.linalg.norm(plant.shape_in[flexible], axis=1)
    c = np.sqrt(((c0 / w - c2 * w) ** 2).sum(axis=0) + (c1**2).sum(axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        found = b * c / (4 * plant.zeta[flexible] * w)
    values[flexible] = np.where(b * c == 0, 0.0, found)
    return values


def _from_gramians(plant: ModalPlant) -> FloatArray:
    n, system = plant.n_modes, state_space(plant)
    controllable, observable = gramians(system)
    pairs = np.stack([np.arange(n), np.arange(n) + n], axis=1)
    blocks = [g[pairs[:, :, None], pairs[:, None, :]] for g in (controllable, observable)]
    found = np.linalg.eigvals(blocks[0] @ blocks[1]).real.max(axis=1)
    return np.asarray(np.sqrt(np.maximum(found, 0.0)))


def reduce_modes(
    plant: ModalPlant,
    *,
    tolerance: float | None = None,
    keep: int | None = None,
    measure: str = "peak",
    static_correction: bool = True,
) -> ModalPlant:
    """Drops the modes that matter least to the plant's inputs and outputs; rigid-body modes always stay.

    tolerance: the dropped modes' measures add up to at most tolerance times the largest flexible mode's measure.
    keep: number of flexible modes to keep instead. measure: "peak" (H-infinity norm of a mode) or "hankel".
    static_correction: the dropped modes' static gain goes to static_correction, and the bound is that of what remains.
    The result's report: dropped (mode numbers), error_bound >= max over frequency of the largest singular value of the
    error: the sum of the dropped modes' peak gains (modal damping), or 2 sum(Hankel singular values) of the error (full).
    Raises InputError unless exactly one of tolerance and keep is given, and for values out of range.
    """
    expect(plant, ModalPlant, "reduce_modes", "modal_plant(system, ...) makes one")
    _check_request(plant, tolerance, keep, measure)
    checked_switch(static_correction, "reduce_modes: static_correction")
    values = peak_gains(plant) if measure == "peak" else hankel_singular_values(plant)
    flexible = np.flatnonzero(plant.omega > 0)
    order = flexible[np.argsort(values[flexible], kind="stable")]
    if keep is not None:
        dropped = order[: max(order.size - keep, 0)]
    else:
        total = np.cumsum(values[order])
        dropped = order[: int(np.count_nonzero(total <= tolerance * values[order[-1]]))] if order.size else order
    dropped = np.sort(dropped)
    reduced = with_modes(plant, np.setdiff1d(np.arange(plant.n_modes), dropped))
    if static_correction and dropped.size:
        position, _, _ = _rows(plant)
        gain = (position[:, dropped] / plant.omega[dropped] ** 2) @ plant.shape_in[dropped]
        given = np.zeros_like(gain) if plant.static_correction is None else plant.static_correction
        reduced = replace(reduced, static_correction=given + gain)
    bound = _error_bound(plant, reduced, dropped, static_correction)
    report = {**reduced.report, "dropped": dropped.tolist(), "error_bound": bound, "measure": measure}
    return replace(reduced, report=report)


def _check_request(plant: ModalPlant, tolerance: float | None, keep: int | None, measure: str) -> None:
    if (tolerance is None) == (keep is None):
        raise InputError("reduce_modes: give either tolerance or keep")
    if tolerance is not None and not (is_number(tolerance) and 0 <= tolerance < np.inf):
        raise InputError(f"reduce_modes: tolerance must be finite and not negative, got {tolerance!r:.60}")
    if keep is not None:
        expect_count(keep, "reduce_modes: keep")
    if keep is not None and keep > plant.n_modes - plant.n_rigid:
        raise InputError(f"reduce_modes: keep = {keep!r}, but the plant has {plant.n_modes - plant.n_rigid} flexible modes")
    expect_choice(measure, MEASURES, "reduce_modes: measure")


def _error_bound(plant: ModalPlant, reduced: ModalPlant, dropped: npt.NDArray[np.int64], static: bool) -> float:
    if not dropped.size:
        return 0.0
    if plant.damping is not None:
        return _lyapunov_bound(plant, reduced)
    part = with_modes(plant, dropped)
    c0, c1, c2 = _rows(part)
    if static:  # c0 + s c1 + s^2 c2 - c0 (s^2 + 2 zeta w s + w^2) / w^2
        c0, c1, c2 = np.zeros_like(c0), c1 - 2 * part.zeta * c0 / part.omega, c2 - c0 / part.omega**2
    return float(_peaks(c0, c1, c2, part).sum())


def _lyapunov_bound(plant: ModalPlant, reduced: ModalPlant) -> float:
    """||D|| + 2 sum of the Hankel singular values of plant - reduced, rigid-body modes (the same in both) left out."""
    a, b = (state_space(with_modes(p, p.omega > 0)) for p in (plant, reduced))
    A, B, C = scipy.linalg.block_diag(a.A, b.A), np.vstack([a.B, b.B]), np.hstack([a.C, -b.C])
    error = StateSpace(A, B, C, a.D - b.D, plant.inputs, plant.outputs)
    return float(np.linalg.norm(error.D, 2) + 2 * gramian_singular_values(error).sum())
