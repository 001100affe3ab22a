"""Harmonic steady state under tones, and over wheel speeds: what a long simulation settles to, without simulating."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from flexplant.blocks.tones import Tones
from flexplant.blocks.wheel import Wheel, harmonic_amplitudes
from flexplant.errors import InputError, expect, nearest
from flexplant.loop.cascade import closed_states, simulated
from flexplant.loop.diagram import Diagram
from flexplant.loop.diagram_response import ComplexArray
from flexplant.loop.frequency import Linear, frequency_response
from flexplant.loop.labels import coordinates
from flexplant.loop.steady import input_amplitudes
from flexplant.loop.tone_sweep import ToneSweep, tone_sweep_of
from flexplant.loop.unstable import refuse_unstable
from flexplant.model.arrays import FloatArray, real_values
from flexplant.numerics.threads import one_thread
from flexplant.plant.state_space import Descriptor

WHOLE = 300  # states closed on themselves, up to which they are decomposed


@one_thread
def harmonic_response(system: Linear, tones: Tones) -> xr.DataArray:
    """Complex output amplitudes, dims (output, frequency): y(t) = sum_k Re(Y_k exp(i 2 pi f_k t)), Y = G(i 2 pi f) a.

    Inputs without a tone are zero. RMS of an output: sqrt(sum |Y_k|^2 / 2) (see `tones.rms`). InputError for an unknown input,
    a tone on an undamped pole, and an unstable system, naming its pole.
    """
    expect(tones, Tones, "harmonic_response", "wheel_tones(wheel, omega_hz) makes them")
    amplitude = input_amplitudes(tones, list(simulated(system).inputs))
    _sweep_of(system, "harmonic_response")
    hz, where = np.unique(tones.frequency_hz, return_inverse=True)
    G = frequency_response(system, hz).values[:, :, where]
    return xr.DataArray(
        np.einsum("oif,if->of", G, amplitude),
        dims=("output", "frequency"),
        coords={
            "output": list(system.outputs),
            "frequency": ("frequency", tones.frequency_hz, {"units": "Hz"}),
            "output_units": ("output", list(system.output_units)),
        },
        name="harmonic_response",
    )


@one_thread
def wheel_speed_sweep(systems: Linear | Mapping[str, Linear], wheel: Wheel, omega_hz: npt.ArrayLike) -> xr.Dataset:
    """Exact steady state at each wheel speed: `rms` (case, output, omega_hz), `amplitude` (case, output, harmonic, omega_hz).

    systems: one system, or a mapping case -> system with the same outputs (say open and closed loop); without a mapping there is
    no `case` dimension. wheel.inputs names the six inputs it drives. amplitude: complex; rms: sqrt(sum |amplitude|^2 / 2).
    Raises InputError for speeds that are not finite and positive, cases whose outputs differ, unknown inputs, a tone on an
    undamped pole, and an unstable system, naming its pole.
    """
    expect(wheel, Wheel, "wheel_speed_sweep", "Wheel(amplitude=, harmonics=) makes one")
    for system in systems.values() if isinstance(systems, Mapping) else [systems]:
        simulated(system)
    speeds = np.atleast_1d(real_values(omega_hz, "omega_hz"))
    if speeds.ndim != 1 or not speeds.size or not (np.isfinite(speeds) & (speeds > 0)).all():
        raise InputError("wheel_speed_sweep: omega_hz must be a list of finite positive speeds, Hz")
    cases = list(systems.values()) if isinstance(systems, Mapping) else [systems]
    outputs = [list(system.outputs) for system in cases]
    if any(names != outputs[0] for names in outputs) or not outputs:
        raise InputError(f"wheel_speed_sweep: the cases need the same outputs, got {outputs}")
    units = ["" if len(set(texts)) > 1 else texts[0] for texts in zip(*(system.output_units for system in cases), strict=True)]
    harmonics, amplitudes = harmonic_amplitudes(wheel)
    swept = [_amplitudes(system, wheel, harmonics, amplitudes, speeds) for system in cases]
    labels: dict[str, Any] = {"output": outputs[0], "omega_hz": speeds, "harmonic": harmonics}
    Y = swept[0]
    dims: tuple[str, ...] = ("output", "harmonic", "omega_hz")
    if isinstance(systems, Mapping):
        Y, dims, labels = np.stack(swept), ("case", *dims), {"case": list(systems), **labels}
    rms = np.sqrt((Y.real**2 + Y.imag**2).sum(axis=-2) / 2)
    seen = tuple(name for name in dims if name != "harmonic")
    return xr.Dataset({"rms": (seen, rms), "amplitude": (dims, Y)}, coords=coordinates(units, **labels))


def _amplitudes(
    system: Linear, wheel: Wheel, harmonics: FloatArray, amplitudes: ComplexArray, speeds: FloatArray
) -> ComplexArray:
    """(nz, harmonics, speeds) of one system."""
    columns = _columns(list(system.inputs), wheel)
    sweep = _sweep_of(system, "wheel_speed_sweep")
    if sweep is None or not sweep.pays:
        return _by_response(system, harmonics, amplitudes, columns, speeds)
    whole = np.zeros((len(system.inputs), harmonics.size), dtype=complex)
    np.add.at(whole, columns, amplitudes)
    ascending, place = (speeds, None) if (speeds[1:] > speeds[:-1]).all() else np.unique(speeds, return_inverse=True)
    Y = sweep(whole, 2 * np.pi * np.outer(harmonics, ascending))
    Y *= ascending**2
    return Y if place is None else np.asarray(Y[:, :, place])


def _sweep_of(system: Linear, what: str) -> ToneSweep | None:
    """The prepared sweep of a system that is stable, or None where a large part is closed on itself, or has no state space."""
    if isinstance(system, Descriptor) or (isinstance(system, Diagram) and closed_states(system) > WHOLE):
        refuse_unstable(system, what)
        return None
    sweep = tone_sweep_of(system)
    sweep.refuse_growing(system.name, what)
    return sweep


def _by_response(
    system: Linear, harmonics: FloatArray, amplitudes: ComplexArray, columns: list[int], speeds: FloatArray
) -> ComplexArray:
    """(nz, harmonics, speeds) from one frequency response, contracted one harmonic at a time to keep the memory small."""
    hz, index = np.unique(np.outer(harmonics, speeds), return_inverse=True)
    G = frequency_response(system, hz).values[:, columns]
    where = index.reshape(harmonics.size, speeds.size)
    parts = [np.einsum("oif,i->of", G[:, :, f], a) for f, a in zip(where, amplitudes.T, strict=True)]
    return np.asarray(np.stack(parts, axis=1) * speeds**2)


def _columns(inputs: list[str], wheel: Wheel) -> list[int]:
    for name in wheel.inputs:
        if name not in inputs:
            raise InputError(f"wheel: no input {name!r} in the system." + nearest(name, inputs))
    return [inputs.index(name) for name in wheel.inputs]
