"""Frequency grids that put points where the modes are, so that no resonance peak falls between two points."""

from __future__ import annotations

import numpy as np

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, is_finite, is_number
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, state_space

MOST = 1_000_000  # points a mode and a decade
SHARPEST = 1e-9  # half bandwidth relative to the frequency, below which a mode counts as undamped and is only bracketed


class FrequencyGrid(np.ndarray[tuple[int], np.dtype[np.float64]]):
    """Ascending frequencies in Hz, an array like any other, that says where its points stand.

    resonance_hz: the resonances within the grid about which points stand. undamped_hz: those without damping, where the response
    is infinite: bracketed by points and never hit. explanation: the same in words, with the numbers of points. What is made
    from the grid (parts, products) says nothing.
    """

    resonance_hz: FloatArray = np.zeros(0)
    undamped_hz: FloatArray = np.zeros(0)
    explanation: str = ""


def explained_grid(hz: FloatArray, resonance_hz: FloatArray, undamped_hz: FloatArray, how: str) -> FrequencyGrid:
    """The grid with what it says; how: the rule for its points, in words."""
    grid, known = hz.view(FrequencyGrid), [at[(at >= hz[0]) & (at <= hz[-1])] for at in (resonance_hz, undamped_hz)]
    grid.resonance_hz, grid.undamped_hz = np.sort(known[0]), np.sort(known[1])
    lasting = ", ".join(f"{at:.6g} Hz" for at in grid.undamped_hz[:8]) + (", ..." if grid.undamped_hz.size > 8 else "")
    grid.explanation = f"{grid.size} points from {hz[0]:.6g} to {hz[-1]:.6g} Hz: {how}; {grid.resonance_hz.size} resonances" + (
        f", those at {lasting} without damping: bracketed, not hit" if grid.undamped_hz.size else ""
    )
    return grid


def adaptive_grid(
    plant: ModalPlant | StateSpace,
    low_hz: float,
    high_hz: float,
    *,
    per_mode: int = 13,
    per_decade: int = 60,
) -> FrequencyGrid:
    """(nf,) ascending frequencies in Hz from low_hz to high_hz: a logarithmic grid, and points about every resonance.

    The grid says where its points stand (see `FrequencyGrid`).

    About a pole p the points are f_r + (|Re p| / 2 pi) tan(theta), theta equally spaced in (-pi/2, pi/2), f_r the resonance
    sqrt(|p|^2 - 2 Re(p)^2) / 2 pi: equal steps of phase, so the peak of a single mode is met at its top, and one that its
    neighbours shift within about 1 - cos(pi / (2 per_mode + 2)) of it (0.6 % at the default 13; per_mode is made odd).
    An undamped mode is bracketed, never hit.
    Raises InputError for bounds that are not 0 < low < high, or fewer than 3 points a mode.
    """
    if not (is_finite(low_hz) and is_finite(high_hz) and 0 < low_hz < high_hz):
        raise InputError(f"adaptive_grid: low_hz = {low_hz!r:.60}, high_hz = {high_hz!r:.60}; give 0 < low < high")
    low_hz, high_hz = float(low_hz), float(high_hz)
    if not (is_number(per_mode) and 3 <= per_mode <= MOST and per_mode % 1 == 0):
        raise InputError(f"adaptive_grid: per_mode = {per_mode!r:.60} must be whole, at least 3 and at most {MOST}")
    if not (is_number(per_decade) and 1 <= per_decade <= MOST):
        raise InputError(f"adaptive_grid: per_decade = {per_decade!r:.60} must be at least 1 and at most {MOST}")
    per_mode = int(per_mode)
    size, decay = _poles(plant)
    resonance = np.sqrt(np.maximum(size**2 - 2 * decay**2, 0.0)) / (2 * np.pi)
    width = np.maximum(decay / (2 * np.pi), SHARPEST * resonance)
    theta = (np.arange(per_mode | 1) - (per_mode | 1) // 2) * (np.pi / ((per_mode | 1) + 1))
    points = resonance[:, None] + width[:, None] * np.tan(theta)
    undamped = decay <= SHARPEST * size
    points[undamped, (per_mode | 1) // 2] = np.nan
    decades = np.log10(high_hz) - np.log10(low_hz)
    count = max(2, int(np.ceil(per_decade * decades)) + 1)
    base = np.geomspace(low_hz, high_hz, count)
    every = np.r_[base, points[np.isfinite(points)].ravel()]
    grid = np.unique(every[(every >= low_hz) & (every <= high_hz)])
    at = resonance[undamped]
    grid = grid[~np.isin(grid, at)] if at.size else grid
    how = f"{per_decade:g} a decade, and {per_mode | 1} about each resonance, at equal steps of phase"
    return explained_grid(grid, resonance[resonance > 0], at, how)


def _poles(plant: ModalPlant | StateSpace) -> tuple[FloatArray, FloatArray]:
    """|p| and |Re p| of each oscillating pole, rad/s."""
    if isinstance(plant, ModalPlant) and plant.damping is None:
        swinging = (plant.omega > 0) & (plant.zeta < 1)
        return plant.omega[swinging], (plant.zeta * plant.omega)[swinging]
    system = state_space(plant)
    poles = np.linalg.eigvals(system.A) if system.n_states else np.zeros(0, dtype=complex)
    if system.dt is not None:
        poles = np.log(poles[poles != 0]) / system.dt
    poles = poles[poles.imag > 1e-9 * abs(poles).max(initial=0.0)]
    return abs(poles), abs(poles.real)
