"""Loop gain, sensitivities, disk and classical margins of a diagram at named signals, from one evaluation of its blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import xarray as xr

from flexplant.blocks.sampled import SampledBlock
from flexplant.errors import InputError
from flexplant.loop.breaking import checked_signals
from flexplant.loop.broken import BrokenLoops, one_at_a_time
from flexplant.loop.diagram import Diagram
from flexplant.loop.diagram_response import ComplexArray
from flexplant.loop.loop_peaks import sensitivity_peaks
from flexplant.model.arrays import FloatArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace
from flexplant.response.crossings import Crossings, Loops, crossings, refined_grid, widened
from flexplant.response.frequency import checked_frequencies
from flexplant.response.grids import adaptive_grid
from flexplant.response.margins import LoopMargins, Margins, disk_margin_of, is_crossing, loop_margins_at
from flexplant.response.norms import HinfNorm
from flexplant.response.singular import stacked_singular_values

BEYOND = 30.0  # factor by which the search for crossings begins outside the slowest and the fastest pole of the blocks


def loop_response(diagram: Diagram, at: str | Sequence[str], frequency_hz: npt.ArrayLike | None = None) -> xr.Dataset:
    """The loop broken at one or several signals: curves over frequency, and margins that do not depend on the grid.

    at: signals "block.port", all broken at once (r of them). The sign is that of negative feedback: a signal v sent on comes back
    as -L v, and
        S = (I + L)^-1,   T = L (I + L)^-1,   disk margin alpha = 1 / max over frequency of sigma_max((S - T) / 2).
    frequency_hz: Hz, or None for a grid with points about every resonance, refined until every loop bends little between points.

    Returns, over `frequency`: `L`, `S`, `T` (signal, injected, frequency), their singular values `L_singular`, `S_singular`,
    `T_singular` (frequency, index), `loop` (signal, frequency), the gain of each loop with the others closed, and `disk`
    (frequency) = 1 / sigma_max((S - T) / 2). From `loop_margins`, refined beyond the grid: `gain_margin_db`, `gain_reduction_db`,
    `phase_margin_deg`, `delay_margin_s` (signal), and `disk_margin`, `disk_margin_hz`, `disk_gain_low`, `disk_gain_high`,
    `disk_phase_deg`, `S_peak`, `S_peak_hz`, `T_peak`, `T_peak_hz`, `stable`.
    A loop with digital blocks is broken where its signal is sampled: at an input or an output of digital blocks (gains in between
    do not matter). L is then its exact pulse transfer function L(z), plants sampled under held inputs, delays included, up to
    the Nyquist frequency; blocks of several sample times are lifted over their common period, at which the signal must be
    sampled. The attributes `sampling` and `sample_time_s` say so; a delay margin in samples is delay_margin_s / sample_time_s.
    Raises InputError for signals that drive nothing, frequencies that are bad, above the Nyquist frequency or on an undamped
    pole, and signals at which a loop with digital blocks varies in time, naming those at which it does not; DiagramError (with
    the nearest name) for signals that do not exist, and for nonlinear diagrams.
    """
    loops = BrokenLoops(diagram, checked_signals(diagram, at))
    wanted = None if frequency_hz is None else _checked_range(checked_frequencies(frequency_hz), loops.dt)
    found, curves = _margins(loops)
    own, L, S, T, sizes = curves if wanted is None else _curves(asked := loops.asked(wanted), loops.gain(asked))
    hz = loops.seen(own) if wanted is None else wanted
    with np.errstate(divide="ignore"):
        disk = 1 / sizes["half"][:, 0]
    matrix = ("signal", "injected", "frequency")
    data: dict[str, Any] = {"L": (matrix, L), "S": (matrix, S), "T": (matrix, T)}
    data |= {f"{name}_singular": (("frequency", "index"), sizes[name]) for name in ("L", "S", "T")}
    data |= {"loop": (("signal", "frequency"), one_at_a_time(L)), "disk": (("frequency",), disk), **_scalars(found)}
    coords = {
        "signal": loops.signals,
        "injected": loops.signals,
        "frequency": ("frequency", hz, {"units": "Hz"}),
        "index": np.arange(len(loops.signals)),
    }
    about = f"{hz.size} points about the poles of every block, and more until every loop bends little between them"
    attrs: dict[str, Any] = {
        "diagram": diagram.name,
        "explanation": found.sensitivity_peak.explanation,
        "grid": about if wanted is None else "given",
        "certificate": found.sensitivity_peak.certificate,
    }
    if loops.dt is not None:
        attrs |= {"sampling": loops.about, "sample_time_s": loops.dt}
    return xr.Dataset(data, coords=coords, attrs=attrs)


def loop_margins(diagram: Diagram, at: str | Sequence[str]) -> Margins:
    """Margins of the loop broken at `at` (see `loop_response`), one loop at a time with the others closed, and all at once.

    Crossings: found on a grid with points about every pole of the blocks, refined where a loop bends, then to round-off by root
    finding. Disk margin and peaks of S and T: one search that starts from the curves on that grid, certified by interval bounds
    (small diagrams by `hinf_norm`). Raises the errors of `loop_response`.
    """
    return _margins(BrokenLoops(diagram, checked_signals(diagram, at)))[0]


class _Curves(NamedTuple):
    """L, S and T (r, r, nf) on a grid, and the singular values (nf, r) of L, S, T and half = (S - T) / 2 by name."""

    hz: FloatArray
    L: ComplexArray
    S: ComplexArray
    T: ComplexArray
    sizes: dict[str, FloatArray]


def _curves(hz: FloatArray, L: ComplexArray) -> _Curves:
    identity = np.eye(L.shape[0])[:, :, None]
    S: ComplexArray = np.array(np.moveaxis(np.linalg.inv(np.moveaxis(identity + L, -1, 0)), 0, -1), dtype=complex)
    T: ComplexArray = identity - S
    named = {"L": L, "S": S, "T": T, "half": 0.5 * (S - T)}
    return _Curves(hz, L, S, T, {name: stacked_singular_values(values) for name, values in named.items()})


def _margins(loops: BrokenLoops) -> tuple[Margins, _Curves]:
    """The margins, and the curves (over the loops' own frequencies) that showed the crossings and where the peaks are."""
    r = len(loops.signals)
    grid, values = refined_grid(loops.both, search_grid(loops.opened, loops.loops), r)
    curves = _curves(grid, values[r:].reshape(r, r, -1))
    at = np.array([grid[curves.sizes[name][:, 0].argmax()] for name in ("S", "T", "half")])
    peaks = {kind: _seen_peak(loops, peak) for kind, peak in sensitivity_peaks(loops.closed, at).items()}
    found = crossings(loops.loops, grid, values[:r])
    every = tuple(_loop_margins(loops, k, one, values[k, [0, -1]]) for k, one in enumerate(found))
    stable = bool(np.isfinite(peaks["S"].value))
    if not stable and loops.dt is not None:
        peaks = {kind: replace(peak, explanation=loops.instability()) for kind, peak in peaks.items()}
    return Margins(stable, every, disk_margin_of(peaks["half"]), peaks["S"], peaks["T"]), curves


def _seen_peak(loops: BrokenLoops, peak: HinfNorm) -> HinfNorm:
    return replace(peak, frequency_hz=float(loops.seen(np.asarray(peak.frequency_hz))))


def _loop_margins(loops: BrokenLoops, k: int, found: Crossings, beside: ComplexArray) -> LoopMargins:
    """Of loop k from its crossings; beside: its values next to both ends of the axis, where it may cross the real axis, too."""
    phase, at_phase = loops.seen(found.phase_hz), found.at_phase
    first, last = loops.at_ends[:, k]
    if is_crossing(first, beside[0]):
        phase, at_phase = np.append(0.0, phase), np.append(first, at_phase)
    if loops.dt is not None and is_crossing(last, beside[1]):
        phase, at_phase = np.append(phase, 0.5 / loops.dt), np.append(at_phase, last)
    return loop_margins_at(loops.signals[k], loops.seen(found.unit_hz), found.at_unit, phase, at_phase)


def _checked_range(hz: FloatArray, dt: float | None) -> FloatArray:
    """The frequencies; InputError for one above the Nyquist frequency of a digital loop, whose curves repeat there."""
    if dt is not None and hz.max() > 0.5 / dt * (1 + 1e-12):
        raise InputError(
            f"frequency_hz: {hz.max():.9g} Hz lies above the Nyquist frequency {0.5 / dt:.9g} Hz of a loop sampled every"
            f" {dt:.6g} s, where its response repeats itself mirrored; ask for frequencies up to there"
        )
    return hz


def search_grid(diagram: Diagram, loops: Loops) -> FloatArray:
    """Hz: points about the poles of every block by itself, as far out as a loop may still cross one."""
    blocks = [block for block in diagram.blocks.values() if not isinstance(block, SampledBlock)]
    sizes = np.concatenate([_pole_sizes(block) for block in blocks]) / (2 * np.pi)
    sizes = sizes[sizes > 1e-9 * sizes.max(initial=0.0)] if sizes.any() else np.ones(1)
    highest = sizes.max() * BEYOND if diagram.dt is None else 0.5 / diagram.dt
    low, high = widened(loops, min(sizes.min() / BEYOND, 1e-3 * highest), highest, upwards=diagram.dt is None)
    grids = [adaptive_grid(block, low, high) for block in blocks if isinstance(block, ModalPlant) or block.n_states]
    grid = np.unique(np.concatenate([np.geomspace(low, high, 200), *grids]))
    lasting = [block.frequency_hz[block.zeta == 0] for block in blocks if isinstance(block, ModalPlant)]
    on_pole = np.isin(np.round(np.log(grid), 9), np.round(np.log(np.maximum(np.concatenate([[1e-300], *lasting]), 1e-300)), 9))
    return grid[~on_pole]


def _pole_sizes(block: ModalPlant | StateSpace) -> FloatArray:
    if isinstance(block, ModalPlant):
        return block.omega
    poles = np.asarray(np.linalg.eigvals(block.A) if block.n_states else np.zeros(0), dtype=complex)
    return np.asarray(abs(poles) if block.dt is None else abs(np.log(poles[poles != 0])) / block.dt)


def _scalars(found: Margins) -> dict[str, Any]:
    names = ("gain_margin_db", "gain_reduction_db", "phase_margin_deg", "delay_margin_s")
    each: dict[str, Any] = {name: (("signal",), [getattr(loop, name) for loop in found.loops]) for name in names}
    disk, S, T = found.disk, found.sensitivity_peak, found.complementary_peak
    one = {
        "stable": found.stable,
        "disk_margin": disk.alpha,
        "disk_margin_hz": disk.frequency_hz,
        "disk_gain_low": disk.gain_low,
        "disk_gain_high": disk.gain_high,
        "disk_phase_deg": disk.phase_deg,
        "S_peak": S.value,
        "S_peak_hz": S.frequency_hz,
        "T_peak": T.value,
        "T_peak_hz": T.frequency_hz,
    }
    return each | {name: ((), value) for name, value in one.items()}
