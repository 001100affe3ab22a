"""A loop at many gains: the plant's response is evaluated once, each gain costs one small update a frequency."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flexplant.errors import InputError
from flexplant.model.arrays import is_finite
from flexplant.response.frequency import checked_memory

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
WELL_CONDITIONED = 1e6


@dataclass(frozen=True, eq=False)
class GainSweep:
    """z = G_zw w + G_zu u, y = G_yw w + G_yu u, closed by u = gain * y:  T = G_zw + gain G_zu (I - gain G_yu)^-1 G_yw.

    G_zw (nz, nw, nf), G_zu (nz, r, nf), G_yw (r, nw, nf), G_yu (r, r, nf): responses at the same frequencies, for example those
    of a plant times a controller of gain one. Negative feedback: put the sign into G_yu and G_yw, or give a negative gain. The
    eigenvalues of G_yu are found once a frequency, so that a gain needs no solution. Raises InputError for shapes that disagree.
    """

    G_zw: ComplexArray
    G_zu: ComplexArray
    G_yw: ComplexArray
    G_yu: ComplexArray
    _products: ComplexArray = field(init=False, repr=False)
    _values: ComplexArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("G_zw", "G_zu", "G_yw", "G_yu"):
            object.__setattr__(self, name, _response(getattr(self, name), name))
        (nz, nw, nf), r = self.G_zw.shape, self.G_yu.shape[0]
        wanted = {"G_zu": (nz, r, nf), "G_yw": (r, nw, nf), "G_yu": (r, r, nf)}
        for name, shape in wanted.items():
            if getattr(self, name).shape != shape:
                raise InputError(f"gain sweep: {name} has shape {getattr(self, name).shape}, but {shape} is needed")
        values, left, right = self.G_yu[0], self.G_zu, self.G_yw
        if r > 1:
            eigenvalues, vectors = np.linalg.eig(self.G_yu.transpose(2, 0, 1))
            if np.linalg.cond(vectors).max(initial=1.0) > WELL_CONDITIONED:
                raise InputError("gain sweep: G_yu cannot be diagonalised at some frequency; close these loops one by one")
            left = np.asarray((self.G_zu.transpose(2, 0, 1) @ vectors).transpose(1, 2, 0), dtype=np.complex128)
            solved = np.linalg.solve(vectors, self.G_yw.transpose(2, 0, 1))
            right = np.asarray(solved.transpose(1, 2, 0), dtype=np.complex128)
            values = np.array(eigenvalues.T, dtype=np.complex128)
        # residues of the loop channels: T = G_zw + sum_r products[r] / (1 / gain - values[r])
        object.__setattr__(self, "_products", np.ascontiguousarray(np.einsum("zrf,rwf->rzwf", left, right)))
        object.__setattr__(self, "_values", np.ascontiguousarray(values.reshape(r, nf)))

    def __call__(self, gain: float, out: ComplexArray | None = None) -> ComplexArray:
        """(nz, nw, nf) closed-loop response at one gain, written into `out` where it is given.

        Raises InputError for a gain that is not a finite number or puts a pole on the axis at one of the frequencies.
        """
        if not is_finite(gain):
            raise InputError(f"gain sweep: the gain must be a finite number, got {gain!r:.60}")
        memory = checked_memory(out, self.G_zw.shape, "gain sweep")
        out = np.empty_like(self.G_zw) if memory is None else memory
        out[:] = self.G_zw
        if gain:
            for product, value in zip(self._products, self._values, strict=True):
                rest = 1 - gain * value
                if not rest.all():
                    k = int(np.flatnonzero(rest == 0)[0])
                    raise InputError(f"gain sweep: at gain {gain:.6g} the closed loop has a pole exactly at frequency number {k}")
                out += product * (gain / rest)
        return out


def _response(values: npt.ArrayLike, name: str) -> ComplexArray:
    try:
        out = np.asarray(values, dtype=np.complex128)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"gain sweep: {name} is not an array of numbers") from None
    if out.ndim != 3 or not np.isfinite(out).all():
        raise InputError(f"gain sweep: {name} of shape {out.shape}; a finite response (outputs, inputs, frequencies) is needed")
    return out
