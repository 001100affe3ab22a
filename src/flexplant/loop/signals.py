"""Sampled input signals, checked against the time axis and the input names."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import xarray as xr

from flexplant.errors import InputError, nearest
from flexplant.model.arrays import FloatArray, real_values

Signals = npt.ArrayLike | Mapping[str, npt.ArrayLike] | xr.DataArray | None


def checked_time(time: npt.ArrayLike) -> tuple[FloatArray, float]:
    """(nt,) instants in seconds and their step; InputError unless they are at least two, increasing and uniform.

    Uniform to the rounding of their own type: instants in single precision are replaced by the even ones they stand for.
    """
    t = real_values(time, "time")
    if t.ndim != 1 or t.size < 2 or not np.isfinite(t).all():
        raise InputError(f"time must be a list of at least two finite instants in seconds, got shape {t.shape}")
    dt = float((t[-1] - t[0]) / (t.size - 1))
    off = np.diff(t)
    np.abs(np.subtract(off, dt, out=off), out=off)
    kind = getattr(time, "dtype", t.dtype)
    single = kind in (np.float16, np.float32)
    allowed = 1e-6 * dt + 8 * float(np.finfo(kind if single else float).eps) * max(abs(t[0]), abs(t[-1]))
    if dt <= 0 or off.max() > min(allowed, dt / 2):
        hint = f"; {kind} is too coarse for them: use float64" if single and off.max() <= allowed else ""
        raise InputError(
            f"time is not uniform and increasing (worst at step {int(off.argmax())}); use numpy.arange(n) * dt{hint}"
        )
    return (np.linspace(t[0], t[-1], t.size) if single else t), dt


def sampled(inputs: Signals, names: list[str], nt: int) -> FloatArray:
    """(nw, nt) samples in the order of `names`; names left out are zero. InputError names the signal that does not fit."""
    if isinstance(inputs, xr.DataArray):
        if set(inputs.dims) != {"input", "time"}:
            raise InputError(f"inputs: a DataArray needs the dims input and time, got {inputs.dims}")
        labels = [str(k) for k in inputs["input"].values] if "input" in inputs.coords else names
        inputs = dict(zip(labels, inputs.transpose("input", "time").values, strict=True))
    if inputs is None or isinstance(inputs, Mapping):
        w = _from_mapping(inputs or {}, names, nt)
    else:
        w = real_values(inputs, "inputs")
        w = w[None, :] if w.ndim == 1 and len(names) == 1 else w
        if w.shape != (len(names), nt):
            raise InputError(f"inputs have shape {w.shape}, but ({len(names)} inputs, {nt} instants) is needed")
    with np.errstate(over="ignore", invalid="ignore"):
        total = w.sum()  # faster to look at than each value
    if not np.isfinite(total) and not np.isfinite(w).all():
        raise InputError(f"input {names[int(np.argwhere(~np.isfinite(w))[0, 0])]!r} has values that are not finite")
    return w


def _from_mapping(inputs: Mapping[str, npt.ArrayLike], names: list[str], nt: int) -> FloatArray:
    w = np.zeros((len(names), nt))
    for name, values in inputs.items():
        if name not in names:
            raise InputError(f"inputs: no input {name!r:.60}." + nearest(name, names))
        signal = real_values(values, f"input {name!r}")
        if signal.shape not in ((), (nt,)):
            raise InputError(f"input {name!r} has shape {signal.shape}, but one number or ({nt},) values are needed")
        w[names.index(name)] = signal
    return w
