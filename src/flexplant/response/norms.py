"""Singular values over frequency and the H-infinity norm, certified by interval bounds or by the Hamiltonian test."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.optimize import minimize_scalar

from flexplant.errors import InputError, expect_choice
from flexplant.model.arrays import FloatArray, is_number
from flexplant.numerics.threads import one_thread
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace, state_space
from flexplant.plant.subset import with_modes
from flexplant.plant.truncation import peak_gains
from flexplant.response.frequency import Plant, frequency_response
from flexplant.response.interval_bound import Bracket, bracket, polished
from flexplant.response.level import Gain
from flexplant.response.modal_bound import ModalAxis
from flexplant.response.pole_bound import PoleAxis
from flexplant.response.singular import stacked_singular_values

CERTIFIED_STATES = 400  # states up to which the Hamiltonian certificate takes a few seconds
ROUND_OFF = 1e-9


@dataclass(frozen=True)
class HinfNorm:
    """The peak gain: lower <= norm <= upper, value = lower reached at frequency_hz; explanation where it is infinite.

    certificate: how `upper` is known; "" where it is not (upper = inf).
    """

    value: float
    frequency_hz: float
    lower: float
    upper: float
    explanation: str = ""
    certificate: str = ""


@one_thread
def singular_values(plant: Plant | xr.DataArray, frequency_hz: npt.ArrayLike | None = None) -> xr.DataArray:
    """Singular values of the response, dims (frequency, index), descending; (nf, min(ny, nu)).

    plant: a plant with frequencies in Hz, or a frequency response (output, input, frequency) computed already.
    Raises InputError for frequencies that are missing or bad, and for arrays with other dims.
    """
    if not isinstance(plant, xr.DataArray):
        if not isinstance(plant, ModalPlant | StateSpace | Descriptor):
            name = type(plant).__name__
            raise InputError(f"singular_values needs a plant, or a response from frequency_response (diagrams too), got {name}")
        if frequency_hz is None:
            raise InputError("singular_values of a plant needs frequency_hz")
        plant = frequency_response(plant, frequency_hz)
    elif set(plant.dims) != {"output", "input", "frequency"} or frequency_hz is not None:
        raise InputError(
            f"singular_values: give a plant and frequencies, or a response (output, input, frequency); dims are {plant.dims}"
        )
    values = stacked_singular_values(plant.transpose("output", "input", "frequency").values)
    coords = {"frequency": plant["frequency"], "index": np.arange(values.shape[1])}
    return xr.DataArray(values, dims=("frequency", "index"), coords=coords, name="singular_values", attrs=plant.attrs)


@one_thread
def hinf_norm(plant: Plant, *, tolerance: float = 1e-7, unbounded: str = "infinite") -> HinfNorm:
    """The largest singular value over all frequencies, its frequency located and its value bracketed to `tolerance` (relative).

    Modal plants with modal damping, of any size: interval bounds over the whole axis (see `interval_bound`), rigorous up to the
    round-off of the modal sums; a second for thousands of modes. Others up to 400 states: refined from the poles, then certified
    by the Hamiltonian test (no crossing of the level), raised and repeated until it passes. Larger others: interval bounds on
    poles and residues where the eigenvectors are well conditioned; else refined from all poles, upper = inf.
    unbounded: "infinite" returns inf for unstable, undamped and rigid-body poles that are seen; "error" raises InputError.
    Source: Boyd and Balakrishnan 1990; Bruinsma and Steinbuch 1990.
    """
    check_request(tolerance, unbounded)
    found = _modal_norm(plant, tolerance) if isinstance(plant, ModalPlant) else _norm(_first_order(plant), tolerance)
    if unbounded == "error" and not np.isfinite(found.value):
        raise InputError(f"the norm of {plant.name!r} is infinite: {found.explanation}")
    return found


def check_request(tolerance: float, unbounded: str) -> None:
    """InputError for a tolerance or a choice that `hinf_norm` does not take."""
    expect_choice(unbounded, ("infinite", "error"), "unbounded")
    if not (is_number(tolerance) and 0 < tolerance < 1):
        raise InputError(f"hinf_norm: tolerance is relative, between 0 and 1, got {tolerance!r:.60}")


def _first_order(plant: StateSpace | Descriptor) -> StateSpace:
    if not isinstance(plant, (StateSpace, Descriptor)):
        raise InputError(f"hinf_norm needs a plant, got {type(plant).__name__}")
    return state_space(plant)


def _infinite(hz: float, explanation: str) -> HinfNorm:
    return HinfNorm(np.inf, hz, np.inf, np.inf, explanation)


def _modal_norm(plant: ModalPlant, tolerance: float) -> HinfNorm:
    if plant.damping is not None:
        return _norm(state_space(plant), tolerance)
    gains = peak_gains(plant)
    undamped = np.flatnonzero((plant.zeta == 0) | (plant.omega == 0))
    seen = [i for i in undamped if plant.omega[i] > 0 and np.isinf(gains[i])]
    rigid = plant.omega == 0
    if _sees_rigid(plant, rigid):
        return _infinite(0.0, "rigid-body modes (0 Hz) move the outputs without bound")
    if seen:
        hz = float(plant.frequency_hz[seen[0]])
        return _infinite(hz, f"mode {seen[0]} (counted from 0) at {hz:.6g} Hz has no damping")
    return _by_intervals(_without(plant, undamped), tolerance)


def _by_intervals(plant: ModalPlant, tolerance: float) -> HinfNorm:
    edge = 2 * float(plant.omega.max(initial=0.0))
    if not edge:
        largest = float(np.linalg.norm(plant.direct, 2)) if plant.direct.size else 0.0
        return HinfNorm(largest, 0.0, largest, largest, certificate="static gain")
    axes = [ModalAxis(plant, edge, high) for high in (False, True)]
    found = polished(axes, bracket(axes, tolerance))[0]
    return _from_bracket(found, lambda omega: omega / (2 * np.pi), "")


def _from_bracket(found: Bracket, hz: Callable[[float], float | FloatArray], what: str) -> HinfNorm:
    """Axis 0 is omega, axis 1 its inverse."""
    omega = found.t if found.axis == 0 else 1 / found.t if found.t else np.inf
    certificate = f"interval bounds ({what}{found.intervals} intervals)"
    return HinfNorm(found.lower, float(hz(omega)), found.lower, found.upper, certificate=certificate)


def _sees_rigid(plant: ModalPlant, rigid: npt.NDArray[np.bool_]) -> bool:
    for shapes in (plant.shape_out, plant.shape_out_velocity):
        if shapes is not None and rigid.any():
            residue, terms = shapes[:, rigid] @ plant.shape_in[rigid], abs(shapes[:, rigid]) @ abs(plant.shape_in[rigid])
            if (abs(residue) > ROUND_OFF * terms).any():
                return True
    return False


def _without(plant: ModalPlant, modes: npt.NDArray[np.int64]) -> ModalPlant:
    """The plant without modes that the outputs do not see, but for the constant share of rigid-body accelerations."""
    kept = np.setdiff1d(np.arange(plant.n_modes), modes)
    constant = np.zeros_like(plant.direct)
    if plant.shape_out_acceleration is not None:
        constant = plant.shape_out_acceleration[:, modes] @ plant.shape_in[modes]
    return replace(with_modes(plant, kept), feedthrough=plant.direct + constant, static_correction=None)


def _norm(system: StateSpace, tolerance: float) -> HinfNorm:
    gain = Gain(system)
    poles = gain.transfer.poles
    size = float(abs(poles).max(initial=0.0))
    if poles.size and poles.real.max() > 1e-10 * size:
        worst = poles[int(np.argmax(poles.real))]
        return _infinite(float(abs(gain.hz(abs(worst.imag)))), f"an unstable pole at {worst:.6g} rad/s")
    for pole in poles[abs(poles.real) <= 1e-10 * size]:
        if _unbounded_at(gain, abs(pole.imag), size):
            return _infinite(float(gain.hz(abs(pole.imag))), f"an undamped pole at {gain.hz(abs(pole.imag)):.6g} Hz")
    if system.n_states <= CERTIFIED_STATES:
        return _certified(gain, _searched(gain, tolerance), tolerance)
    residues = gain.transfer.residues
    if residues is None or (poles.real >= 0).any():
        return _searched(gain, tolerance)
    axes = [PoleAxis(gain.transfer, residues, 2 * size, high) for high in (False, True)]
    return _from_bracket(polished(axes, bracket(axes, tolerance))[0], gain.hz, "poles and residues, ")


def _unbounded_at(gain: Gain, omega: float, size: float) -> bool:
    """True where the gain grows on the way to a pole on the axis; an unseen pole does not make it grow."""
    steps = np.array([1e-5, 1e-7]) * (max(omega, 1e-3 * size) or 1.0)  # poles at zero alone have no size
    far, near = gain(omega + steps)
    return bool(near > 5 * far)


def _searched(gain: Gain, tolerance: float) -> HinfNorm:
    """The highest of all local peaks found by refinement from the poles; upper is not known (inf)."""
    poles = gain.transfer.poles
    reach = np.maximum(abs(poles.real), 1e-9 * abs(poles))
    resonance = np.sqrt(np.maximum(poles.imag**2 - poles.real**2, 0.0))
    starts = np.unique(np.r_[0.0, resonance, abs(poles.imag), abs(poles)])
    direct = gain.continuous.D  # the gain at infinite frequency, or of a discrete system at the Nyquist frequency
    largest = float(np.linalg.norm(direct, 2)) if direct.size else 0.0
    if not poles.size:
        return HinfNorm(largest, 0.0, largest, largest)
    starts = starts[[not (abs(1j * s - poles) <= 1e-12 * abs(poles).max()).any() for s in starts]]
    values = gain(starts)
    best, at = (largest, np.inf) if not values.size or largest >= values.max() else (values.max(), starts[np.argmax(values)])
    for start in starts[np.argsort(values)[::-1][:8]]:
        width = 4 * reach[int(np.argmin(abs(abs(poles.imag) - start)))] + tolerance * start
        best, at = _higher((best, at), _refined(gain, max(start - width, 0.0), start + width))
    return HinfNorm(float(best), float(gain.hz(at)), float(best), np.inf)


def _higher(known: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """The (value, omega) of larger value; the known one where they differ by round-off."""
    return other if other[0] > known[0] * (1 + 1e-13) else known


def _refined(gain: Gain, low: float, high: float) -> tuple[float, float]:
    found = minimize_scalar(lambda w: -gain(w)[0], bounds=(low, high), method="bounded", options={"xatol": 1e-10 * high})
    return float(-found.fun), float(found.x)


def _certified(gain: Gain, found: HinfNorm, tolerance: float) -> HinfNorm:
    """Raises the lower bound through every interval above it, until the Hamiltonian shows that there is none."""
    best, at = found.value, float(gain.omega(found.frequency_hz)) if np.isfinite(found.frequency_hz) else np.inf
    for _ in range(40):
        level = best * (1 + tolerance)
        if level == 0.0:
            return HinfNorm(0.0, 0.0, 0.0, 0.0)
        candidates = np.r_[0.0, gain.candidates(level)]
        middles = 0.5 * (candidates[:-1] + candidates[1:])
        middles = middles[middles > 0]
        values = gain(middles) if middles.size else np.zeros(0)
        if not (values > level).any():
            return HinfNorm(float(best), float(gain.hz(at)), float(best), float(level), certificate="Hamiltonian test")
        k = int(np.argmax(values))
        inside = np.searchsorted(candidates, middles[k])
        best, at = _higher((best, at), (values[k], middles[k]))
        best, at = _higher((best, at), _refined(gain, candidates[inside - 1], candidates[inside]))
    return replace(found, value=float(best), lower=float(best), frequency_hz=float(gain.hz(at)))
