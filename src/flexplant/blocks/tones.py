"""Sums of sinusoids on named channels: what a wheel at constant speed, or a shaker, puts in."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flexplant.errors import InputError, expect, expect_choice
from flexplant.model.arrays import FloatArray, frozen, real_values
from flexplant.plant.fields import checked_names


@dataclass(frozen=True, eq=False, kw_only=True)
class Tones:
    """u_i(t) = sum_k Re( amplitude[i, k] exp(i 2 pi frequency_hz[k] t) ).

    frequency_hz: (nt,) distinct, not negative. amplitude: (nu, nt) complex. inputs: nu names.
    Raises InputError with the shapes that disagree, or the frequency that is listed twice.
    """

    frequency_hz: FloatArray
    amplitude: npt.NDArray[np.complex128]
    inputs: Sequence[str]

    def __post_init__(self) -> None:
        hz = np.atleast_1d(frozen(self.frequency_hz, what="tones: frequency_hz"))
        amplitude = frozen(self.amplitude, np.complex128, what="tones: amplitude")
        object.__setattr__(self, "frequency_hz", hz)
        object.__setattr__(self, "amplitude", amplitude)
        object.__setattr__(self, "inputs", checked_names(self.inputs, "inputs", "tones"))
        if hz.ndim != 1 or not np.isfinite(hz).all() or (hz < 0).any():
            raise InputError(f"tones: frequency_hz {hz}; use a list of finite frequencies that are not negative")
        if amplitude.shape != (len(self.inputs), hz.size) or not np.isfinite(amplitude).all():
            raise InputError(
                f"tones: amplitude of shape {amplitude.shape} for {len(self.inputs)} inputs and {hz.size} frequencies; "
                "it must be finite, one row an input and one column a frequency"
            )
        values, count = np.unique(hz, return_counts=True)
        if (count > 1).any():
            raise InputError(f"tones: {values[count > 1][0]} Hz is listed twice; add the amplitudes of equal frequencies first")


def tone_signal(tones: Tones, time: npt.ArrayLike, *, sampling: str = "point") -> FloatArray:
    """(nu, nt) samples of the tones at uniform `time` in seconds.

    sampling "point": the values at the instants; the right samples for a first-order hold. "mean": the mean of each interval
    [t_k, t_k+1], the right samples for a zero-order hold, which then has no half-step lag.
    Warns where a tone lies above half the sampling rate: its samples are those of a slower tone.
    """
    expect(tones, Tones, "tone_signal", "wheel_tones(wheel, omega_hz) makes them")
    t = np.atleast_1d(real_values(time, "time"))
    if t.ndim != 1 or not np.isfinite(t).all():
        raise InputError(f"tone_signal: time must be a list of finite instants in seconds, got shape {t.shape}")
    expect_choice(sampling, ("point", "mean"), "tone_signal: sampling")
    amplitude = tones.amplitude
    if sampling == "mean":
        if t.size < 2:
            raise InputError("tone_signal: sampling='mean' needs at least two instants, to know the step")
        half = np.pi * tones.frequency_hz * (t[1] - t[0])
        amplitude = amplitude * (np.sinc(half / np.pi) * np.exp(1j * half))
    _warn_if_aliased(tones, t)
    return summed(amplitude, tones.frequency_hz, t)


def summed(amplitude: npt.NDArray[np.complex128], frequency_hz: FloatArray, t: FloatArray) -> FloatArray:
    """(n, nt) sum over k of Re(a_k exp(i 2 pi f_k t)), amplitude (n, k)."""
    phase = 2 * np.pi * np.outer(frequency_hz, t)
    return np.asarray(amplitude.real @ np.cos(phase) - amplitude.imag @ np.sin(phase))


def _warn_if_aliased(tones: Tones, t: FloatArray) -> None:
    heard = tones.frequency_hz[(tones.amplitude != 0).any(axis=0)]
    if t.size < 2 or t[1] <= t[0] or not heard.size or heard.max() * (t[1] - t[0]) <= 0.5:
        return
    top, rate = float(heard.max()), 1 / float(t[1] - t[0])
    warnings.warn(
        f"a tone of {top:.6g} Hz is sampled at {rate:.6g} Hz and appears as one of {abs(top - rate * round(top / rate)):.6g} Hz: "
        f"use a step below {0.5 / top:.4g} s; linear systems take Tones without samples",
        UserWarning,
        stacklevel=3,
    )


def rms(tones: Tones) -> FloatArray:
    """(nu,) root mean square over all time: sqrt(|a_0|^2 + sum |a_k|^2 / 2), the constant counted in full (Parseval)."""
    weight = np.where(tones.frequency_hz == 0, 1.0, 0.5)
    amplitude = np.where(tones.frequency_hz == 0, tones.amplitude.real, tones.amplitude)
    return np.asarray(np.sqrt((weight * abs(amplitude) ** 2).sum(axis=1)))
