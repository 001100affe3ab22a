"""The receptance of single modes, 1 / (wn^2 - w^2 + 2 i zeta wn w), for many modes and frequencies in real arithmetic."""

from __future__ import annotations

import numpy as np

from flexplant.model.arrays import FloatArray
from flexplant.numerics.compiled import Kernel


def _loops(modal_omega, zeta, omega, out):  # type: ignore[no-untyped-def]
    """out[i, 2k], out[i, 2k + 1] = real and imaginary part of mode i at omega[k]; (wn - w)(wn + w) keeps its digits near wn."""
    for i in range(modal_omega.size):
        wn = modal_omega[i]
        damping = 2 * zeta[i] * wn
        for k in range(omega.size):
            real = (wn - omega[k]) * (wn + omega[k])
            imaginary = damping * omega[k]
            scale = 1 / (real * real + imaginary * imaginary)
            out[i, 2 * k] = real * scale
            out[i, 2 * k + 1] = -imaginary * scale


def _numpy(modal_omega: FloatArray, zeta: FloatArray, omega: FloatArray, out: FloatArray) -> None:
    real = modal_omega[:, None] - omega
    work = modal_omega[:, None] + omega
    real *= work
    imaginary = np.multiply((2 * zeta * modal_omega)[:, None], omega)
    np.multiply(real, real, out=work)
    work += imaginary * imaginary
    np.divide(1, work, out=work)
    np.multiply(real, work, out=out[:, ::2])
    np.negative(imaginary, out=imaginary)
    np.multiply(imaginary, work, out=out[:, 1::2])


receptance = Kernel(_loops, _numpy)
