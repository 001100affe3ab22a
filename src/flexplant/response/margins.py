"""Stability margins of a loop gain with negative feedback: gain, phase, delay and disk margins, sensitivity peaks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy.linalg

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, is_finite
from flexplant.numerics.threads import one_thread
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, channels_of, state_space
from flexplant.response.level import Gain, on_axis, sign_changes
from flexplant.response.norms import HinfNorm, hinf_norm

ComplexArray = npt.NDArray[np.complex128]
END = 1e-2  # of the smallest pole, and the same beyond the largest: beside the ends of the axis
ROUND_OFF = 1e-9
REGULAR = 1e14  # condition of A up to which it has no pole at zero
MAX_DB = 6000  # factors of 10^300
HALF_POWER_DB = 10 * float(np.log10(0.5))  # what "-3 dB" means in a bandwidth: -3.0103


@dataclass(frozen=True)
class DiskMargin:
    """alpha = 1 / max over frequency of sigma_max((S - T) / 2), at frequency_hz.

    The loop stays stable for any gain factor within [gain_low, gain_high] or phase within +-phase_deg in every channel at
    once, also complex and simultaneous ones in that disk. Source: Seiler, Packard and Gahinet 2020 (skew 0).
    """

    alpha: float
    gain_low: float
    gain_high: float
    phase_deg: float
    frequency_hz: float


@dataclass(frozen=True, eq=False)
class LoopMargins:
    """Margins of one loop broken at a time.

    gain_crossings_hz, phase_margins_deg: every frequency with |L| = 1, and 180 deg + phase there, in (-180, 180].
    phase_crossings_hz, gain_margins_db: every frequency with phase -180 deg, and -20 log10 |L| there, 0 Hz and the Nyquist
    frequency included, where L is real.
    phase_margin_deg: the smallest in size. gain_margin_db: the smallest positive one (gain up); gain_reduction_db: the
    smallest gain decrease that destabilises; inf where there is none. delay_margin_s: smallest delay that reaches a crossing.
    """

    channel: str
    gain_crossings_hz: FloatArray
    phase_margins_deg: FloatArray
    phase_crossings_hz: FloatArray
    gain_margins_db: FloatArray
    phase_margin_deg: float
    gain_margin_db: float
    gain_reduction_db: float
    delay_margin_s: float


@dataclass(frozen=True, eq=False)
class Margins:
    """stable: the closed loop; loops: one per channel, the others closed; disk; peaks of S = (I + L)^-1 and T = L (I + L)^-1."""

    stable: bool
    loops: tuple[LoopMargins, ...]
    disk: DiskMargin
    sensitivity_peak: HinfNorm
    complementary_peak: HinfNorm

    @property
    def gain_margin_db(self) -> float:
        """Smallest gain margin of all loops, dB."""
        return min(loop.gain_margin_db for loop in self.loops)

    @property
    def phase_margin_deg(self) -> float:
        """Phase margin smallest in size of all loops, degrees."""
        return min((loop.phase_margin_deg for loop in self.loops), key=abs)

    @property
    def delay_margin_s(self) -> float:
        """Smallest delay margin of all loops, seconds."""
        return min(loop.delay_margin_s for loop in self.loops)


@one_thread
def margins(loop_gain: StateSpace | ModalPlant) -> Margins:
    """Margins of the loop gain L under negative feedback u = r - L u, as many inputs as outputs, paired in order.

    Crossings come from eigenvalues and are refined by root finding to 1e-12 relative; none is missed between grid points.
    Raises InputError for a loop gain that is not square, or for which I + L is singular at infinite frequency.
    """
    L = state_space(loop_gain)
    if len(L.inputs) != len(L.outputs) or not L.inputs:
        raise InputError(f"margins: the loop gain has {len(L.outputs)} outputs and {len(L.inputs)} inputs; give a square one")
    S, T = sensitivity(L), complementary_sensitivity(L)
    loops = tuple(_loop_margins(_broken(L, k), name) for k, name in enumerate(L.outputs))
    return Margins(_is_stable(S), loops, _disk_margin(S), hinf_norm(S), hinf_norm(T))


def sensitivity(loop_gain: StateSpace | ModalPlant) -> StateSpace:
    """S = (I + L)^-1, from r to r - y; InputError where the loop is not well posed."""
    L = state_space(loop_gain)
    A, B, C, inverse = _closed(L)
    return StateSpace(A, B, -C, inverse, dt=L.dt, **channels_of(L))


def complementary_sensitivity(loop_gain: StateSpace | ModalPlant) -> StateSpace:
    """T = L (I + L)^-1, from r to y; InputError where the loop is not well posed."""
    L = state_space(loop_gain)
    A, B, C, inverse = _closed(L)
    return StateSpace(A, B, C, L.D @ inverse, dt=L.dt, **channels_of(L))


def _closed(L: StateSpace) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    if len(L.inputs) != len(L.outputs):
        raise InputError(f"the loop gain has {len(L.outputs)} outputs and {len(L.inputs)} inputs; feedback needs a square one")
    direct = np.eye(len(L.inputs)) + L.D
    if np.linalg.cond(direct) > 1e14:
        raise InputError("I + L is singular at infinite frequency: the loop is not well posed; add the delay or lag it has")
    inverse: FloatArray = scipy.linalg.inv(direct)
    return L.A - L.B @ inverse @ L.C, L.B @ inverse, inverse @ L.C, inverse


def _broken(L: StateSpace, k: int) -> StateSpace:
    """Loop k open, the others closed: from u_k to y_k."""
    others = [i for i in range(len(L.inputs)) if i != k]
    if not others:
        return L
    direct = np.eye(len(others)) + L.D[np.ix_(others, others)]
    feedback = -np.linalg.solve(direct, np.hstack([L.C[others], L.D[others][:, [k]]]))
    Fx, Fu = feedback[:, :-1], feedback[:, -1:]
    B = L.B[:, others]
    return StateSpace(
        L.A + B @ Fx,
        L.B[:, [k]] + B @ Fu,
        L.C[[k]] + L.D[[k]][:, others] @ Fx,
        L.D[[k]][:, [k]] + L.D[[k]][:, others] @ Fu,
        [L.inputs[k]],
        [L.outputs[k]],
        dt=L.dt,
        name=L.name,
    )


def _is_stable(system: StateSpace) -> bool:
    poles = np.linalg.eigvals(system.A) if system.n_states else np.zeros(0)
    return bool((poles.real < 0).all() if system.dt is None else (abs(poles) < 1).all())


def _loop_margins(L: StateSpace, channel: str) -> LoopMargins:
    gain = Gain(L)
    unit = gain.crossings(1.0)
    phase = _phase_crossings(gain)
    ends, at_ends = _ends(gain)
    phase_hz, at_phase = np.r_[ends[ends == 0], gain.hz(phase), ends[ends > 0]], _values(gain, phase)
    at_phase = np.r_[at_ends[ends == 0], at_phase, at_ends[ends > 0]]
    return loop_margins_at(channel, gain.hz(unit), _values(gain, unit), phase_hz, at_phase)


def _ends(gain: Gain) -> tuple[FloatArray, ComplexArray]:
    """Hz and values where L is real and negative at an end of the axis: 0 Hz, and the Nyquist frequency in discrete time."""
    g, sizes, A = gain.continuous, abs(gain.transfer.poles), gain.system.A
    found = []
    if g.n_states and np.linalg.cond(A if gain.system.dt is None else A - np.eye(len(A))) < REGULAR:
        still = g.D - g.C @ np.linalg.solve(g.A, g.B)
        found.append((0.0, still[0, 0], _values(gain, np.array([END * sizes.min()]))[0]))
    if gain.system.dt is not None:
        beside = _values(gain, np.array([sizes.max() / END]))[0] if sizes.size else 0.0
        found.append((0.5 / gain.system.dt, g.D[0, 0], beside))
    kept = [(hz, value) for hz, value, beside in found if is_crossing(value, beside)]
    return np.array([hz for hz, _ in kept]), np.array([value for _, value in kept], dtype=complex)


def is_crossing(value: complex, beside: complex) -> bool:
    """True for a loop gain that is negative at an end of the axis, and no round-off of the one beside the end."""
    return bool(value.real < -ROUND_OFF * abs(beside))


def loop_margins_at(
    channel: str, unit_hz: FloatArray, at_unit: ComplexArray, phase_hz: FloatArray, at_phase: ComplexArray
) -> LoopMargins:
    """The margins of one loop from its gain crossings and its crossings of the negative real axis, and its values there."""
    phase_margins = np.degrees(np.angle(-at_unit))
    gains = -20 * np.log10(abs(at_phase))
    with np.errstate(divide="ignore"):
        delays = np.radians(np.where(phase_margins > 0, phase_margins, phase_margins + 360)) / (2 * np.pi * unit_hz)
    up, down = gains[gains > 0], -gains[gains < 0]
    return LoopMargins(
        channel=channel,
        gain_crossings_hz=unit_hz,
        phase_margins_deg=phase_margins,
        phase_crossings_hz=phase_hz,
        gain_margins_db=gains,
        phase_margin_deg=float(min(phase_margins, key=abs, default=np.inf)),
        gain_margin_db=float(min(up, default=np.inf)),
        gain_reduction_db=float(min(down, default=np.inf)),
        delay_margin_s=float(min(delays, default=np.inf)),
    )


def _values(gain: Gain, omega: FloatArray) -> ComplexArray:
    return gain.transfer(np.asarray(1j * omega, dtype=np.complex128))[0, 0] if omega.size else np.zeros(0, dtype=complex)


def _phase_crossings(gain: Gain) -> FloatArray:
    """omega where L is real and negative: imaginary zeros of L(s) - L(-s), a system of twice the size, refined on Im L."""
    g = gain.continuous
    if not g.n_states:
        return np.zeros(0)
    n = 2 * g.n_states
    pencil = np.zeros((n + 1, n + 1))
    pencil[:n, :n] = scipy.linalg.block_diag(g.A, -g.A)
    pencil[:n, n], pencil[n, :n] = np.r_[g.B[:, 0], g.B[:, 0]], np.r_[g.C[0], g.C[0]]
    mass = np.eye(n + 1)
    mass[n, n] = 0.0
    candidates = on_axis(scipy.linalg.eigvals(pencil, mass))
    size = float(abs(gain.transfer.poles).max())
    found = sign_changes(lambda w: float(_values(gain, np.array([w]))[0].imag), candidates[candidates > 1e-9 * size])
    return found[_values(gain, found).real < 0] if found.size else found


def _disk_margin(S: StateSpace) -> DiskMargin:
    return disk_margin_of(hinf_norm(replace(S, D=S.D - 0.5 * np.eye(len(S.inputs)))))


def disk_margin_of(peak: HinfNorm) -> DiskMargin:
    """From the norm of S - I/2 = (S - T)/2; no margin where the closed loop is unstable, whose norm is infinite."""
    alpha = 0.0 if not np.isfinite(peak.value) else 1 / peak.value
    low, high = (2 - alpha) / (2 + alpha), ((2 + alpha) / (2 - alpha) if alpha < 2 else np.inf)
    return DiskMargin(alpha, low, high, float(np.degrees(2 * np.arctan(alpha / 2))), peak.frequency_hz)


@one_thread
def crossing_hz(plant: StateSpace | ModalPlant, level_db: float) -> FloatArray:
    """Ascending frequencies (Hz) where the gain (largest singular value) passes through level_db, every one of them."""
    if not (is_finite(level_db) and abs(level_db) <= MAX_DB):
        raise InputError(f"crossing_hz: level_db must be finite, within +-{MAX_DB}, got {level_db!r:.60}")
    gain = Gain(state_space(plant))
    return gain.hz(gain.crossings(10 ** (level_db / 20)))


@one_thread
def bandwidth_hz(plant: StateSpace | ModalPlant, level_db: float = HALF_POWER_DB) -> float:
    """First frequency (Hz) where the gain has fallen by level_db (half power) below its value at 0 Hz; inf if it never does.

    Raises InputError for a level that is not negative, and for a plant without a finite, nonzero gain at 0 Hz.
    """
    if not (is_finite(level_db) and -MAX_DB <= level_db < 0):
        raise InputError(f"bandwidth_hz: level_db must be negative and finite, got {level_db!r:.60}")
    gain = Gain(state_space(plant))
    static = float(gain(0.0)[0])
    if static <= 1e-12 * gain(abs(gain.transfer.poles)).max(initial=0.0):
        raise InputError("bandwidth_hz: the gain at 0 Hz is zero; use crossing_hz with a level")
    level = static * 10 ** (level_db / 20)
    crossings = gain.crossings(level)
    return float(gain.hz(crossings[0])) if crossings.size else np.inf
