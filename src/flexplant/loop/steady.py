"""The harmonic steady state of a `Cascade` under tones."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from flexplant.blocks.tones import Tones
from flexplant.errors import InputError, nearest
from flexplant.loop.cascade import Cascade
from flexplant.model.arrays import FloatArray

ComplexArray = npt.NDArray[np.complex128]


def input_amplitudes(tones: Tones, inputs: list[str], frequency_hz: FloatArray | None = None) -> ComplexArray:
    """(nw, nk) amplitudes in the order of `inputs`; inputs without a tone are zero. InputError for a tone on an unknown input."""
    out = np.zeros((len(inputs), tones.frequency_hz.size if frequency_hz is None else frequency_hz.size), dtype=complex)
    for name, row in zip(tones.inputs, tones.amplitude, strict=True):
        if name not in inputs:
            raise InputError(f"tones: no input {name!r}." + nearest(name, inputs))
        out[inputs.index(name)] += row
    return out


def steady_states(cascade: Cascade, frequency_hz: FloatArray, amplitude: ComplexArray) -> ComplexArray:
    """(2n + m, nk) complex states [eta, eta', l] that go on for ever under the tones.

    Raises InputError where there is none: a tone on an undamped resonance, a constant force on a rigid-body mode.
    """
    w = 2 * np.pi * frequency_hz
    modes = cascade.omega[:, None]
    stiffness = modes**2 - w**2 + 2j * cascade.zeta[:, None] * modes * w
    if (stiffness == 0).any():
        mode, tone = np.argwhere(stiffness == 0)[0]
        raise InputError(
            f"no steady state: the tone at {frequency_hz[tone]:.6g} Hz meets the undamped mode {mode} at the same frequency; "
            "give it damping, or leave it out (without_rigid_body for a constant force on a free body)"
        )
    eta = (cascade.shape_in @ amplitude) / stiffness
    modal = np.vstack([eta, 1j * w * eta])
    force = cascade.from_modes @ modal + cascade.B @ amplitude
    s = 1j * w if cascade.dt is None else np.exp(1j * w * cascade.dt)
    matrix = s[:, None, None] * np.eye(cascade.A.shape[0]) - cascade.A
    try:
        rest = np.linalg.solve(matrix, force.T[:, :, None])[:, :, 0].T
    except np.linalg.LinAlgError:
        raise InputError(
            "no steady state: a tone meets an undamped pole of the loop; start from rest or give it damping"
        ) from None
    return np.vstack([modal, rest])


def output_amplitudes(cascade: Cascade, states: ComplexArray, amplitude: ComplexArray) -> ComplexArray:
    """(nz, nk) complex outputs of the steady state."""
    return np.asarray(np.hstack([cascade.C_modes, cascade.C]) @ states + cascade.D @ amplitude)
