"""The harmonic disturbance of a reaction wheel (equation 34)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from flexplant.blocks.tones import Tones, tone_signal
from flexplant.errors import InputError, expect
from flexplant.model.arrays import FloatArray, frozen, is_number, real_values
from flexplant.plant.fields import checked_names

WHEEL_CHANNELS = ("fx", "fy", "fz", "mx", "my", "mz")


@dataclass(frozen=True, eq=False, kw_only=True)
class Wheel:
    """Forces and moments of a wheel at speed Omega in Hz, in its own axes (equation 34):

        m_j(t) = sum_k amplitude[j, k] Omega^2 sin(2 pi harmonics[j, k] Omega t + phase_rad[j, k]),   j = fx, fy, fz, mx, my, mz

    amplitude: N/Hz^2 (rows 1-3) and N m/Hz^2 (rows 4-6): one value, (6,) one a component, or (6, nk).
    harmonics: (nk,) for all components, or (6, nk), all positive. phase_rad: one value, (6,) or (6, nk).
    rotation: (3, 3) proper rotation, plant vector = rotation @ wheel vector: its columns are the wheel's axes in the plant frame.
    inputs: names of the six channels, in the order above.
    Raises InputError for shapes that do not fit and a matrix that is no rotation. Source: Masterson, Miller and Grogan 2002.
    """

    amplitude: FloatArray
    harmonics: FloatArray
    phase_rad: FloatArray = field(default_factory=lambda: np.zeros(6))
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    inputs: Sequence[str] = WHEEL_CHANNELS

    def __post_init__(self) -> None:
        h = np.atleast_1d(real_values(self.harmonics, "wheel: harmonics"))
        if h.ndim not in (1, 2) or (h.ndim == 2 and h.shape[0] != 6) or not h.size or not (np.isfinite(h) & (h > 0)).all():
            raise InputError(f"wheel: harmonics of shape {h.shape}; use (nk,) or (6, nk) positive numbers")
        shape = (6, h.shape[-1])
        object.__setattr__(self, "harmonics", frozen(np.broadcast_to(h, shape)))
        for kind in ("amplitude", "phase_rad"):
            object.__setattr__(self, kind, _component_table(getattr(self, kind), shape, kind))
        object.__setattr__(self, "rotation", _checked_rotation(self.rotation))
        object.__setattr__(self, "inputs", checked_names(self.inputs, "inputs", "wheel"))
        if len(self.inputs) != 6:
            raise InputError(f"wheel: {len(self.inputs)} input names; three forces and three moments need 6")


def _component_table(values: npt.ArrayLike, shape: tuple[int, int], kind: str) -> FloatArray:
    given = real_values(values, f"wheel: {kind}")
    if given.shape not in ((), (6,), shape) or not np.isfinite(given).all():
        raise InputError(f"wheel: {kind} of shape {given.shape}; use one finite value, (6,) or {shape}")
    return np.asarray(frozen(np.broadcast_to(given[:, None] if given.ndim == 1 else given, shape)))


def _checked_rotation(rotation: npt.ArrayLike) -> FloatArray:
    R: FloatArray = frozen(rotation, what="wheel: rotation")
    if R.shape != (3, 3) or not np.allclose(R @ R.T, np.eye(3), atol=1e-9) or np.linalg.det(R) < 0:
        raise InputError(f"wheel: rotation of shape {R.shape} is not a proper 3 x 3 rotation (orthonormal, determinant +1)")
    return R


def harmonic_amplitudes(wheel: Wheel) -> tuple[FloatArray, npt.NDArray[np.complex128]]:
    """Distinct harmonics (nk,) and complex amplitudes per Hz^2 (6, nk) in the plant frame; sin x = Re(-i exp(i x))."""
    harmonics, index = np.unique(wheel.harmonics, return_inverse=True)
    table = np.zeros((6, harmonics.size), dtype=complex)
    rows = np.broadcast_to(np.arange(6)[:, None], wheel.harmonics.shape)
    np.add.at(table, (rows, index.reshape(wheel.harmonics.shape)), -1j * wheel.amplitude * np.exp(1j * wheel.phase_rad))
    return harmonics, np.vstack([wheel.rotation @ table[:3], wheel.rotation @ table[3:]])


def wheel_tones(wheel: Wheel, omega_hz: float) -> Tones:
    """The tones at wheel speed omega_hz (Hz): frequencies h Omega, complex amplitudes (6, nk) in N and N m, plant frame.

    Raises InputError unless omega_hz is finite and positive.
    """
    expect(wheel, Wheel, "wheel_tones", "Wheel(amplitude=, harmonics=) makes one")
    if not (is_number(omega_hz) and 0 < omega_hz < np.inf):
        raise InputError(f"wheel speed {omega_hz!r:.60} Hz; use a finite positive speed")
    harmonics, amplitudes = harmonic_amplitudes(wheel)
    return Tones(frequency_hz=harmonics * omega_hz, amplitude=amplitudes * omega_hz**2, inputs=wheel.inputs)


def wheel_disturbance(wheel: Wheel, omega_hz: float, time: npt.ArrayLike, *, sampling: str = "point") -> FloatArray:
    """(6, nt) forces (N) and moments (N m) in the plant frame at `time`; `sampling` as in `tone_signal`."""
    return tone_signal(wheel_tones(wheel, omega_hz), time, sampling=sampling)
