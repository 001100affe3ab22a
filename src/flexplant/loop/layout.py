"""How a cascade's matrices lie in memory for the compiled steps: padded with zeros to whole lanes, on whole cache lines."""

from __future__ import annotations

import importlib

import numpy as np

from flexplant.loop.cascade import Cascade
from flexplant.loop.stepping import Stepper
from flexplant.model.arrays import FloatArray, IntArray


def block_length() -> int:
    """Samples in a block of the compiled steps."""
    return int(importlib.import_module("flexplant.loop.modal_steps").BLOCK)


def aligned(shape: tuple[int, ...]) -> FloatArray:
    """Zeros that begin on a cache line: vectors that straddle two lines take twice as long."""
    size = int(np.prod(shape))
    raw = np.zeros(size + 8)
    first = (-raw.ctypes.data % 64) // 8
    return raw[first : first + size].reshape(shape)


def padded(matrix: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """The matrix with zeros behind its rows and columns."""
    out = aligned(shape)
    out[tuple(slice(size) for size in matrix.shape)] = matrix
    return out


def _up(size: int, unit: int) -> int:
    return -(-size // unit) * unit


class Layout:
    """How a cascade's matrices are laid out for the kernel: [eta | eta' | inputs | other states], each padded to whole lanes."""

    def __init__(self, cascade: Cascade) -> None:
        self.n, self.m, self.nw = cascade.omega.size, cascade.A.shape[0], cascade.B.shape[1]
        self.modes, self.inputs, self.rest = _up(self.n, 16), _up(self.nw, 8), _up(self.m, 8)
        self.width = 2 * self.modes + self.inputs + self.rest

    def _spread(self, rows: FloatArray) -> FloatArray:
        """(k, 2n) rows on [eta, eta'] -> an even number of rows on the padded modes."""
        out = aligned((_up(len(rows), 2), 2 * self.modes))
        out[: len(rows), : self.n], out[: len(rows), self.modes : self.modes + self.n] = rows[:, : self.n], rows[:, self.n :]
        return out

    def modal(self, one: Stepper, shape_in: FloatArray) -> tuple[FloatArray, ...]:
        """F, b = hold - ramp + F ramp and hold of each mode; the modal forces of unit inputs; the state."""
        hold, ramp = one.forced
        b = hold - ramp + np.einsum("nij,nj->ni", one.modes, ramp)
        modes = np.vstack([one.modes.reshape(-1, 4).T, b.T, hold.T])
        return padded(modes, (8, self.modes)), padded(shape_in.T, (self.nw, self.modes)), aligned((2, self.modes))

    def other(self, one: Stepper, causal: FloatArray) -> tuple[FloatArray, ...]:
        """A transposed, what the modes and the inputs add to the other states, scratch, the other states."""
        into = aligned((_up(self.m, 2), self.width - self.rest))
        into[:, : 2 * self.modes] = self._spread(one.from_modes)
        into[: self.m, 2 * self.modes : 2 * self.modes + self.nw] = causal[2 * self.n :]
        scratch = aligned((block_length() + 3, self.rest))
        return padded(one.A.T, (self.m, self.rest)), into, scratch, aligned((self.rest,))

    def reading(self, C_modes: FloatArray, C: FloatArray, D: FloatArray) -> tuple[FloatArray | IntArray, ...]:
        """The distinct rows on the modes, all rows on [inputs | other states], scratch, and how outputs share distinct rows."""
        share, row, chosen = shared_rows(C_modes)
        on_modes, _ = self.rows(C_modes[chosen], C[:0], D[:0])
        tail = self.rows(C_modes, C, D)[1]
        seen, direct = (aligned((block_length() + 3, max(2, len(rows)))) for rows in (on_modes, tail))
        return on_modes, seen, tail, direct, share, row

    def rows(self, C_modes: FloatArray, C: FloatArray, D: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rows on the modes (on displacements alone where they read no velocity) and on [inputs | other states]."""
        on_modes = self._spread(C_modes)
        if not on_modes[:, self.modes :].any():
            on_modes = padded(on_modes[:, : self.modes], (len(on_modes), self.modes))
        tail = aligned((_up(len(D), 2), self.inputs + self.rest))
        tail[: len(D), : self.nw], tail[: len(D), self.inputs : self.inputs + self.m] = D, C
        return on_modes, tail


def shared_rows(rows: FloatArray) -> tuple[FloatArray, IntArray, list[int]]:
    """share (k,), row (k,), chosen: rows[i] = share[i] rows[chosen[row[i]]] to the last digits; zero rows have share 0."""
    share, row, chosen = np.zeros(len(rows)), np.zeros(len(rows), dtype=np.int64), list[int]()
    for i, line in enumerate(rows):
        if not line.any():
            continue
        peak = int(np.argmax(abs(line)))
        for place, j in enumerate(chosen):
            factor = line[peak] / rows[j, peak] if rows[j, peak] else 0.0
            if abs(line - factor * rows[j]).max() <= 4 * np.finfo(float).eps * abs(line[peak]):
                share[i], row[i] = factor, place
                break
        else:
            share[i], row[i] = 1.0, len(chosen)
            chosen.append(i)
    return share, row, chosen
