"""A proper rational transfer function as a well-scaled controllable state space."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.linalg

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, real_values
from flexplant.plant.state_space import StateSpace


def transfer_function(
    numerator: npt.ArrayLike,
    denominator: npt.ArrayLike,
    *,
    input_name: str = "u",
    output_name: str = "y",
    input_unit: str = "",
    output_unit: str = "",
    dt: float | None = None,
    name: str = "transfer_function",
) -> StateSpace:
    """G(s) = num(s) / den(s), coefficients from the highest power down; with dt in z instead of s.

    Controllable companion form in p = s / s0, with s0 the size of the poles, then balanced by a diagonal scaling, so the
    entries stay near one size whatever the units. Raises InputError for an improper function or a zero denominator.
    """
    num, den = _coefficients(numerator, "numerator", name), _coefficients(denominator, "denominator", name)
    if not den.any():
        raise InputError(f"transfer function {name!r}: the denominator is zero")
    if num.size > den.size:
        raise InputError(
            f"transfer function {name!r} is improper: numerator of degree {num.size - 1} over degree {den.size - 1}; "
            "add poles (a derivative needs a filter, see pid)"
        )
    A, B, C, D = _balanced(*_companion(num, den, 1.0 if dt is not None else _pole_size(den)))
    return StateSpace(
        A, B, C, D, [input_name], [output_name], dt=dt, name=name, input_units=[input_unit], output_units=[output_unit]
    )


def _coefficients(values: npt.ArrayLike, what: str, name: str) -> FloatArray:
    out = np.atleast_1d(real_values(values, f"transfer function {name!r}: {what}"))
    if out.ndim != 1 or not out.size or not np.isfinite(out).all():
        raise InputError(f"transfer function {name!r}: {what} {values!r}; use a list of finite numbers, highest power first")
    return np.trim_zeros(out, "f") if out.any() else out[:1]


def _pole_size(den: FloatArray) -> float:
    """max_k |a_k / a_0|^(1/k): within a factor of two of a bound on the largest pole (Fujiwara 1916)."""
    ratios = abs(den[1:] / den[0]) ** (1 / np.arange(1, den.size))
    return float(ratios.max(initial=0.0)) or 1.0


def _companion(num: FloatArray, den: FloatArray, s0: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    n = den.size - 1
    powers = s0 ** -np.arange(n + 1.0)
    a = den / den[0] * powers
    b = np.r_[np.zeros(den.size - num.size), num] / den[0] * powers
    A = np.eye(n, k=-1)
    A[:1] = -a[1:]
    B = np.eye(n, 1)
    return s0 * A, s0 * B, (b[1:] - b[0] * a[1:])[None, :], np.array([[b[0]]])


def _balanced(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    if not A.size:
        return A, B, C, D
    A, (scale, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    B, C = B / scale[:, None], C * scale
    size_b, size_c = abs(B).max(), abs(C).max()
    ratio = np.exp2(np.round(np.log2(np.sqrt(size_c / size_b)))) if size_c > 0 else 1.0
    return A, B * ratio, C / ratio, D
