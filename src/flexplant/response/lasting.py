"""Telling a frequency on an undamped pole, to round-off, where the poles are not known: the response falls beside it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
GROWTH = 1e10  # size of a solution beside its right-hand side, in a matrix with entries of one, that makes a frequency suspect,
BESIDE = 1e3  # where it is as many times larger than at most of the other frequencies
STEP = 1e-6  # relative distance at which the response is looked at again,
FALL = 1e5  # and how many times smaller it is there if there is a pole: within STEP / FALL, nearer than any damping


def refuse_lasting(
    response: Callable[[FloatArray], ComplexArray], hz: FloatArray, values: ComplexArray, growth: FloatArray, what: str
) -> None:
    """InputError for a frequency hz (nf,) > 0 on an undamped pole, from values (ny, nu, nf) and the growth (nf,) of each."""
    suspect = (growth > GROWTH) & (hz > 0) & ((hz.size < 3) | (growth > BESIDE * np.median(growth)))
    for k in np.flatnonzero(suspect):
        beside = abs(response(hz[k] * np.array([1 - STEP, 1 + STEP]))).max(axis=2)
        if (abs(values[:, :, k]) > FALL * np.maximum(beside, np.finfo(float).tiny)).any():
            raise InputError(
                f"{what} has an undamped pole at {hz[k]:.9g} Hz, where its response is asked for; move the frequency"
            )
