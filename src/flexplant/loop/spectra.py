"""Input power spectra: constants, values on the frequencies of the answer, tables with lines of their own, cross-spectra."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from flexplant.errors import InputError, expect_choice, nearest
from flexplant.model.arrays import FloatArray, real_values

ComplexArray = npt.NDArray[np.complex128]
Interpolation = Literal["linear", "log"]


@dataclass(frozen=True, eq=False)
class Spectra:
    """One-sided input spectra S of a band.

    at_hz: (nu, nf) of uncorrelated inputs or (nu, nu, nf) cross-spectra at the frequencies hz (nf,). tables: input -> (hz,
    values) of those inputs that came with lines of their own. log: tables are straight on double logarithmic paper.
    """

    hz: FloatArray
    at_hz: FloatArray | ComplexArray
    tables: Mapping[int, tuple[FloatArray, FloatArray]]
    log: bool

    def edges(self) -> FloatArray:
        """Frequencies between which every spectrum is one line: hz, and the tables' lines within the band."""
        lines = np.concatenate([self.hz, *(table[0] for table in self.tables.values())])
        return np.unique(lines[(lines >= self.hz[0]) & (lines <= self.hz[-1])])

    def between(self, at: FloatArray) -> FloatArray | ComplexArray:
        """S at frequencies strictly between the edges, in the shape of at_hz."""
        flat = self.at_hz.reshape(math.prod(self.at_hz.shape[:-1]), self.hz.size)
        out: Any = np.array([np.interp(at, self.hz, row) for row in flat]).reshape(len(flat), at.size)
        for row, table in self.tables.items():
            out[row] = table_values(table, at, log=self.log)
        return np.asarray(out.reshape(*self.at_hz.shape[:-1], at.size))

    def ends(self, edges: FloatArray) -> tuple[FloatArray | ComplexArray, FloatArray | ComplexArray]:
        """S at both ends of each interval of the edges, seen from within: a table may jump to zero at its first and last line."""
        middle = 0.5 * (edges[:-1] + edges[1:])
        start, end = self.between(edges[:-1]), self.between(edges[1:])
        for row, (lines, _) in self.tables.items():
            outside = (middle < lines[0]) | (middle > lines[-1])
            start[row, outside], end[row, outside] = 0.0, 0.0
        return start, end


def table_values(table: tuple[FloatArray, FloatArray], at: FloatArray, *, log: bool) -> FloatArray:
    """The table at given frequencies, zero outside its lines."""
    lines, values = table
    if not log:
        return np.asarray(np.interp(at, lines, values, left=0.0, right=0.0))
    inside = (at >= lines[0]) & (at <= lines[-1])
    out = np.zeros(at.shape)
    out[inside] = np.exp(np.interp(np.log(at[inside]), np.log(lines), np.log(values)))
    return out


def checked_spectra(psd: Any, names: list[str], hz: FloatArray, interpolation: Interpolation) -> Spectra:
    """Spectra of the named inputs as `random_response` takes them, or InputError."""
    expect_choice(interpolation, ("linear", "log"), "random_response: interpolation")
    log = interpolation == "log"
    if not isinstance(psd, Mapping):
        return Spectra(hz, _cross(psd, names, hz), {}, log)
    values, tables = np.zeros((len(names), hz.size)), {}
    for name, given in psd.items():
        if name not in names:
            raise InputError(f"random_response: no input {name!r:.60}." + nearest(name, names))
        row = names.index(name)
        if isinstance(given, tuple):
            tables[row] = _table(given, str(name), log=log)
            values[row] = table_values(tables[row], hz, log=log)
        else:
            values[row] = _values(given, str(name), hz)
    return Spectra(hz, values, tables, log)


def _table(given: tuple[Any, ...], name: str, *, log: bool) -> tuple[FloatArray, FloatArray]:
    columns: list[FloatArray] = [real_values(part, f"input {name!r}: table") for part in given]
    if len(columns) != 2 or columns[0].ndim != 1 or columns[0].shape != columns[1].shape or (np.diff(columns[0]) <= 0).any():
        raise InputError(f"input {name!r}: a table is a pair (hz, values) of equal length, hz ascending")
    lines, values = columns
    if lines.size < 2:
        raise InputError(f"input {name!r}: a table needs at least two lines, got {lines.size}")
    if not np.isfinite(columns).all() or (values < 0).any() or lines[0] < 0:
        raise InputError(f"input {name!r}: a PSD must be finite and not negative")
    if log and (lines[0] <= 0 or (values <= 0).any()):
        raise InputError(f"input {name!r}: a table with interpolation='log' needs frequencies and values above zero")
    return lines, values


def _values(given: Any, name: str, hz: FloatArray) -> FloatArray:
    values = real_values(given, f"input {name!r}: PSD")
    if values.shape not in ((), hz.shape):
        raise InputError(f"input {name!r}: PSD of shape {values.shape}; one number, {hz.shape} values, or a pair (hz, values)")
    if not np.isfinite(values).all() or (values < 0).any():
        raise InputError(f"input {name!r}: a PSD must be finite and not negative")
    return np.broadcast_to(values, hz.shape)


def _cross(psd: Any, names: list[str], hz: FloatArray) -> ComplexArray:
    """(nu, nu, nf) cross-spectra, checked: Hermitian and not negative at every frequency."""
    try:
        given = np.asarray(psd, dtype=complex)
    except (TypeError, ValueError, OverflowError):
        raise InputError("random_response: psd is neither a mapping of inputs nor an array of cross-spectra") from None
    nu = len(names)
    if given.shape != (nu, nu, hz.size):
        raise InputError(f"random_response: cross-spectra of shape {given.shape}, but {(nu, nu, hz.size)} is needed")
    matrices = given.transpose(2, 0, 1)
    size = abs(matrices).max(initial=0.0)
    if not np.isfinite(matrices).all() or (abs(matrices - matrices.conj().transpose(0, 2, 1)) > 1e-10 * size).any():
        raise InputError("random_response: the cross-spectra must be finite and Hermitian at every frequency")
    smallest = np.linalg.eigvalsh(matrices).min(axis=1, initial=0.0)
    if (smallest < -1e-10 * size).any():
        k = int(np.argmin(smallest))
        raise InputError(f"random_response: the cross-spectra are not positive at {hz[k]:.6g} Hz (coherence above one)")
    return given
