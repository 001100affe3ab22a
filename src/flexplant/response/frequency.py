"""Frequency response G(s) = C (E s - A)^-1 B + D at s = 2 pi i f (equations 25-27)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import xarray as xr

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, real_values
from flexplant.numerics.threads import one_thread
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace
from flexplant.response.descriptor import DescriptorResponse
from flexplant.response.first_order import TransferFunction
from flexplant.response.modal_sum import ModalResponse

Plant: TypeAlias = ModalPlant | StateSpace | Descriptor
ComplexArray: TypeAlias = npt.NDArray[np.complex128]
STREAMED = 2**20  # complex numbers of a streamed block, 16 MB


@one_thread
def frequency_response(plant: Plant, frequency_hz: npt.ArrayLike, *, out: ComplexArray | None = None) -> xr.DataArray:
    """Complex response of a plant, dims (output, input, frequency), at ascending frequencies in Hz.

    Modal plants: sum over modes in real arithmetic, or the pole-residue form of the fully damped system. State space: poles
    and residues where the eigenvectors are well conditioned, a Schur form otherwise; discrete plants at z = exp(2 pi i f dt).
    Descriptors: one sparse factorisation a frequency, its symbolic part done once (see `DescriptorResponse`).
    out: C-contiguous complex128 memory (ny, nu, nf) to write into: a large result costs less where its memory is used again.
    Raises InputError for frequencies that are negative, NaN, descending or none, for `out` of another shape, and for a
    frequency that lies exactly on an undamped pole (at 0 Hz: on a rigid-body mode that the outputs see), naming the mode.
    """
    hz, evaluate = checked_frequencies(frequency_hz), evaluator(plant)
    return labelled(plant, hz, evaluate(hz, checked_memory(out, (len(plant.outputs), len(plant.inputs), hz.size))))


def frequency_response_blocks(plant: Plant, frequency_hz: npt.ArrayLike, *, block: int | None = None) -> Iterator[xr.DataArray]:
    """`frequency_response` in blocks of ascending frequencies, for results larger than the memory.

    block: frequencies a block; by default as many as fill 16 MB. What does not depend on the frequency is made once. Raises
    InputError at once for bad frequencies and block sizes, and for a frequency on an undamped pole when its block is reached.
    """
    hz, evaluate = checked_frequencies(frequency_hz), evaluator(plant)
    split = parts(hz, len(plant.outputs) * len(plant.inputs), block)
    return (labelled(plant, part, evaluate(part, None)) for part in split)


def parts(hz: FloatArray, channels: int, block: int | None) -> Iterator[FloatArray]:
    """The frequencies in blocks of `block`, or of as many as fill 16 MB; InputError for a block that is not positive."""
    size = max(STREAMED // max(channels, 1), 1) if block is None else block
    if not isinstance(size, (int, np.integer)) or isinstance(size, bool) or size < 1:
        raise InputError(f"frequency_response_blocks: block is {block!r:.60}; use a positive whole number of frequencies")
    return (hz[start : start + size] for start in range(0, hz.size, size))


def evaluator(plant: Plant) -> Callable[[FloatArray, ComplexArray | None], ComplexArray]:
    """(hz, out or None) -> (ny, nu, nf), with everything prepared that does not depend on the frequency."""
    if isinstance(plant, ModalPlant):
        modal = ModalResponse(plant)
        return lambda hz, out: modal(2 * np.pi * hz, out)
    if isinstance(plant, StateSpace):
        transfer, dt = TransferFunction(plant), plant.dt
        return lambda hz, out: written(transfer(np.asarray(2j * np.pi * hz if dt is None else np.exp(2j * np.pi * hz * dt))), out)
    if isinstance(plant, Descriptor):
        solved = DescriptorResponse(plant)
        return lambda hz, out: written(solved(hz), out)
    raise InputError(f"frequency_response needs a ModalPlant, StateSpace or Descriptor, got {type(plant).__name__}")


def written(values: ComplexArray, out: ComplexArray | None) -> ComplexArray:
    """The values, in `out` where it is given."""
    if out is None:
        return values
    out[:] = values
    return out


def checked_memory(out: ComplexArray | None, shape: tuple[int, ...], owner: str = "frequency_response") -> ComplexArray | None:
    """`out`, if it is memory of this shape that can be written into; InputError otherwise."""
    if out is None:
        return None
    fits = isinstance(out, np.ndarray) and out.shape == shape and out.dtype == np.complex128
    if not fits or not out.flags.c_contiguous or not out.flags.writeable:
        found = f"{out.dtype} {out.shape}" if isinstance(out, np.ndarray) else type(out).__name__
        raise InputError(f"{owner}: out is {found}; it must be a writable C-contiguous complex128 array {shape}")
    return out


def labelled(system: Any, hz: FloatArray, values: ComplexArray) -> xr.DataArray:
    """Responses (output, input, frequency) with the names and units of a plant's or a diagram's channels."""
    return xr.DataArray(
        values,
        dims=("output", "input", "frequency"),
        coords={
            "output": list(system.outputs),
            "input": list(system.inputs),
            "frequency": ("frequency", hz, {"units": "Hz"}),
            "output_units": ("output", list(system.output_units)),
            "input_units": ("input", list(system.input_units)),
        },
        name="frequency_response",
        attrs={"plant": system.name},
    )


def checked_frequencies(frequency_hz: npt.ArrayLike) -> FloatArray:
    """(nf,) finite frequencies that are not negative and do not descend, Hz, repeated ones allowed; InputError otherwise."""
    hz = np.atleast_1d(real_values(frequency_hz, "frequency_hz"))
    if hz.ndim != 1 or not hz.size:
        raise InputError(f"frequency_hz must be a non-empty list of frequencies, got shape {hz.shape}")
    bad = np.flatnonzero(~np.isfinite(hz) | (hz < 0))
    if bad.size:
        raise InputError(f"frequency_hz: entry {bad[0]} is {hz[bad[0]]}; frequencies must be finite and not negative")
    down = np.flatnonzero(hz[1:] < hz[:-1])
    if down.size:
        k = int(down[0]) + 1
        raise InputError(
            f"frequency_hz: entry {k} is {hz[k]:.9g} after {hz[k - 1]:.9g}; frequencies must ascend: use np.sort (or np.unique)"
        )
    return hz
