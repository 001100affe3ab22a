"""Modes and residual vectors chosen by a bound of the error: the smallest basis that keeps a promise, the best of a size."""

from __future__ import annotations

import numpy as np

from flexplant.errors import InputError, SolverError
from flexplant.model.arrays import FloatArray
from flexplant.numerics.lanczos import Progress
from flexplant.reduction.bound import Basis, round_off
from flexplant.reduction.budget import KEPT, LOAD_MOMENTS, Draw, draws
from flexplant.reduction.interior import Interior, fixed_interface
from flexplant.reduction.partition import Partition

CUTS = (1.5, 2.0, 3.0)  # modes up to these multiples of the frequency asked
MAX_BLOCKS = 8
SPARE = 0.25  # of the accuracy asked: what a large basis may lack, from which a small one is drawn
NEGLIGIBLE = 0.1  # of the drawn basis' bound: what the large basis may lack before another block is tried
SAMPLES, VERIFIED = 12, 48  # frequencies at which the bound is evaluated while choosing, and of the choice


def chosen_for(
    part: Partition, accuracy: float, max_frequency_hz: float, loads: FloatArray, progress: Progress | None
) -> tuple[Interior, float]:
    """The smallest basis found whose error bound meets `accuracy`, and the bound; SolverError with the best one reached."""
    best = np.inf
    for cut in CUTS:
        large = fixed_interface(part, max_frequency_hz=cut * max_frequency_hz, n_modes=None, loads=loads, progress=progress)
        if loads.shape[1]:
            large = large.extended().extended()
        for _ in range(MAX_BLOCKS):
            bound, directions = _assessed(large, max_frequency_hz, SPARE * accuracy)
            best = min(best, bound)
            if bound <= SPARE * accuracy:
                return _smallest(large, accuracy, max_frequency_hz)
            large = large.extended(directions)
    rounding = round_off(large, max_frequency_hz, SAMPLES)
    cause = "rounding to double precision" if rounding > accuracy else f"the best basis, with {MAX_BLOCKS} blocks,"
    raise SolverError(out_of_reach(accuracy, max(best / SPARE, rounding), cause))


def out_of_reach(accuracy: float, reached: float, cause: str) -> str:
    """The message that names the accuracy to ask for instead: two digits, and some room for another choice."""
    unit = 10.0 ** (np.floor(np.log10(reached)) - 1)
    possible = float(np.ceil(1.1 * reached / unit) * unit)
    return (
        f"craig_bampton: accuracy {accuracy:g} is out of reach: {cause} allows frequency errors up to {reached:.1e}; ask for "
        f"accuracy={possible:.2g} or more, or add the DOF that move most as boundary"
    )


def _assessed(interior: Interior, max_frequency_hz: float, accuracy: float) -> tuple[float, FloatArray]:
    """The bound, and combinations (m, k) of the pending vectors that motions beyond `accuracy` need at the worst frequency."""
    worst, directions = 0.0, np.zeros((interior.drive.shape[0], 0))
    if not interior.error_rows.size:
        return worst, directions
    basis = Basis.of(interior)
    for hz in np.linspace(max_frequency_hz / SAMPLES, max_frequency_hz, SAMPLES):
        errors, motions = basis.errors(hz)
        if errors.size and errors[-1] > worst:
            worst, directions = float(errors[-1]), interior.drive @ motions[:, errors > accuracy]
    return worst, directions


def _smallest(large: Interior, accuracy: float, max_frequency_hz: float) -> tuple[Interior, float]:
    """The smallest basis drawn from `large` that meets the accuracy at all frequencies; `large` itself where none does."""
    found = [(size, draw) for draw in draws(large, max_frequency_hz) if (size := _size_for(draw, accuracy, max_frequency_hz))]
    n_q = large.raw.shape[1]
    for size, draw in sorted(found, key=lambda pair: pair[0]):
        for wider in range(size, n_q):
            bound = draw.drawn(wider)[0].worst(max_frequency_hz, VERIFIED)
            if bound <= accuracy:
                return draw.interior(large, wider), bound
    return large, Basis.of(large).worst(max_frequency_hz, VERIFIED)


def _size_for(draw: Draw, accuracy: float, max_frequency_hz: float) -> int | None:
    """The size from which a draw meets the accuracy, by bisection; None where it takes the whole basis."""
    low, high = draw.smallest - 1, draw.basis.diagonal.size
    while high - low > 1:
        middle = (low + high) // 2
        met = draw.drawn(middle)[0].worst(max_frequency_hz, SAMPLES) <= accuracy
        low, high = (low, middle) if met else (middle, high)
    return high if high < draw.basis.diagonal.size else None


def best_of_size(
    part: Partition, size: int, max_frequency_hz: float, loads: FloatArray, progress: Progress | None
) -> tuple[Interior, float]:
    """The basis of at most `size` vectors with the lowest error bound found, and the bound; InputError names what must fit."""
    large = fixed_interface(part, max_frequency_hz=CUTS[0] * max_frequency_hz, n_modes=None, loads=loads, progress=progress)
    _refuse_too_few(large, size, max_frequency_hz)
    best: tuple[float, Draw | None] = (np.inf, None)
    for block in range(MAX_BLOCKS):
        grown = large.extended()
        if grown.raw.shape[1] == large.raw.shape[1]:
            break
        large = grown
        if large.raw.shape[1] <= size or (loads.shape[1] and block < 1):
            continue
        best = _best_draw(large, size, max_frequency_hz)
        if Basis.of(large).worst(max_frequency_hz, SAMPLES) <= NEGLIGIBLE * best[0]:
            break
    if best[1] is None:
        return large, Basis.of(large).worst(max_frequency_hz, VERIFIED)
    chosen = best[1].interior(large, size)
    return chosen, Basis.of(chosen).worst(max_frequency_hz, VERIFIED)


def _best_draw(large: Interior, size: int, max_frequency_hz: float) -> tuple[float, Draw | None]:
    able = [draw for draw in draws(large, max_frequency_hz) if draw.smallest <= size]
    judged = [(draw.drawn(size)[0].worst(max_frequency_hz, SAMPLES), draw) for draw in able]
    return min(judged, key=lambda pair: pair[0], default=(np.inf, None))


def _refuse_too_few(large: Interior, size: int, max_frequency_hz: float) -> None:
    exact = int(np.count_nonzero(large.omega2 <= (2 * np.pi * KEPT[0] * max_frequency_hz) ** 2))
    least = exact + LOAD_MOMENTS * large.loads.shape[1]
    if size < least:
        raise InputError(
            f"craig_bampton: size {size} is too small: {exact} fixed-interface modes up to {KEPT[0] * max_frequency_hz:g} Hz "
            f"and {least - exact} answers to loads must fit; give size={least} or more, or a lower max_frequency_hz"
        )
