"""The recursion of a cascade in one compiled pass over short blocks of samples: the fast form, where numba is installed."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np

from flexplant.loop.cascade import Cascade
from flexplant.loop.layout import Layout, aligned, block_length
from flexplant.loop.lifted import stepped
from flexplant.loop.parallel import separated, separation
from flexplant.loop.recursion import Standing
from flexplant.loop.stepping import Stepper, stepper
from flexplant.loop.tiled import MOST_REST, Drive, Rows, TileSteps, modes_driven
from flexplant.model.arrays import FloatArray
from flexplant.numerics.compiled import numba
from flexplant.numerics.threads import one_thread

CHUNK = 16384  # samples taken at once
Pair = tuple[FloatArray, FloatArray]
Tiles = tuple[Drive, Rows, Pair, Pair]
LARGEST_REST = 64  # other states up to which stepping them one sample at a time is the faster way


@cache
def march_kernel() -> Callable[..., None] | None:
    """The compiled steps, or None where numba is not installed."""
    return None if numba() is None else importlib.import_module("flexplant.loop.modal_steps").march


def is_fused(cascade: Cascade) -> bool:
    """True for a cascade that this form steps faster than the lifted one."""
    return march_kernel() is not None and cascade.A.shape[0] <= LARGEST_REST


class Steps(Protocol):
    """How a cascade moves."""

    def advance(self, state: FloatArray, w: FloatArray, first: int, count: int, out: FloatArray, place: int) -> FloatArray:
        """The state after `count` samples of w (nw, .) from `first` on; writes the kept outputs into out[:, place:]."""


class BlockSteps:
    """x[k+1] = F x[k] + G w[k] and z = C x + D w for any number of rows: the modes are written down over short blocks."""

    def __init__(self, cascade: Cascade, one: Stepper, causal: FloatArray, D: FloatArray, every: int) -> None:
        layout = Layout(cascade)
        self.n, self.m, self.every, self.position = layout.n, layout.m, every, 0
        self._modal = layout.modal(one, cascade.shape_in)
        self._other = layout.other(one, causal.T)
        self._reading = layout.reading(cascade.C_modes, cascade.C, D)
        self._work = aligned((block_length(), layout.width))

    def advance(self, state: FloatArray, w: FloatArray, first: int, count: int, out: FloatArray, place: int) -> FloatArray:
        """The state after `count` samples of w (nw, .) from `first` on; writes the kept outputs into out[:, place:]."""
        march, every, n, m = march_kernel(), self.every, self.n, self.m
        assert march is not None
        x, rest = self._modal[2], self._other[3]
        x[0, :n], x[1, :n], rest[:m] = state[:n], state[n : 2 * n], state[2 * n :]
        kept = np.empty((kept_samples(self.position, every, count), len(out)))
        inputs = np.ascontiguousarray(w[:, first : first + count])
        march(self._modal, self._other, self._reading, inputs, self._work, kept, self.position, every, count)
        self.position += count
        out[:, place : place + len(kept)] = kept.T
        return np.concatenate([x[0, :n], x[1, :n], rest[:m]])


def kept_samples(position: int, every: int, count: int) -> int:
    """How many of `count` samples from `position` on are multiples of `every`."""
    return len(range(-position % every, count, every))


def parallel_rows(cascade: Cascade, every: int) -> tuple[Rows | None, FloatArray | None]:
    """The rows of the parallel form, and its T; None where it does not help.

    Of its rows C_modes + C T, the terms apart are often multiples of each other where the sums are not.
    """
    T = separation(cascade) if every == 1 and cascade.A.shape[0] <= MOST_REST else None
    if T is None:
        return None, None
    none, more = np.zeros_like(cascade.from_modes), cascade.C @ T
    sums = Rows(np.vstack([none, cascade.C_modes + more]))
    terms = Rows(np.vstack([none, cascade.C_modes]), np.vstack([none, more]))
    rows = min((sums, terms), key=lambda rows: (not rows.fit, rows.cost))
    return (rows, T) if rows.fit else (None, None)


@dataclass(frozen=True, eq=False)
class Prepared:
    """What the recursion of a cascade needs at one time step, and no run changes.

    own: the cascade, or its parallel form by T. causal: (nw, 2n + m) what w adds to the next state, once the state is shifted by
    ramp (nw, 2n + m). tiles: what `TileSteps` takes, or None for the steps in blocks.
    """

    own: Cascade
    T: FloatArray | None
    one: Stepper
    ramp: FloatArray
    causal: FloatArray
    D: FloatArray
    tiles: Tiles | None

    def steps(self, every: int) -> Steps:
        """Steps with scratch of their own."""
        return BlockSteps(self.own, self.one, self.causal, self.D, every) if self.tiles is None else TileSteps(*self.tiles)


def prepared(cascade: Cascade, dt: float, hold: str, every: int) -> Prepared:
    """Made once for each time step: the cascade of a diagram keeps the last one."""
    key, kept = (dt, hold, every == 1), cascade.derived.get("steps")
    if kept is None or kept[0] != key:
        kept = cascade.derived["steps"] = key, _prepare(cascade, dt, hold, every)
    found: Prepared = kept[1]
    return found


def _prepare(cascade: Cascade, dt: float, hold: str, every: int) -> Prepared:
    """Tiles where each sample is kept and not too many rows read the modes, else blocks."""
    rows, T = parallel_rows(cascade, every)
    own = cascade if T is None else separated(cascade, T)
    one, nw, n = stepper(own, dt, hold), own.B.shape[1], own.omega.size
    ramp = one.drive[nw:]
    causal = one.drive[:nw] - ramp + stepped(one, ramp)
    D, tiles = own.D + np.hstack([own.C_modes, own.C]) @ ramp.T, None
    if every == 1 and n and nw and own.A.shape[0] <= MOST_REST:
        rows = rows or Rows(np.vstack([one.from_modes, own.C_modes]))
        if rows.fit:
            tiles = modes_driven(one, own.shape_in), rows, (one.A, causal[:, 2 * n :].T), (own.C, D)
    return Prepared(own, T, one, ramp, causal, D, tiles)


class FusedRecursion(Standing):
    """x[k+1] = F x[k] + G w[k] of a cascade, resumable; equal to the lifted `Recursion` to round-off.

    With a first-order hold the state is shifted by what the ramp adds, x - R w, which makes the recursion causal: each sample
    then needs its own inputs only. Every sum has a fixed order: the result does not depend on the number of threads.
    """

    def __init__(self, cascade: Cascade, dt: float, state: FloatArray, hold: str, every: int = 1) -> None:
        super().__init__(cascade, state, dt)
        made = prepared(cascade, dt, hold, every)
        self.every, self._T, self._ramp, self._steps = every, made.T, made.ramp, made.steps(every)

    @property
    def chunk(self) -> int:
        """Samples that `run` takes at once at most; a multiple of `every`."""
        return max(1, CHUNK // self.every) * self.every

    def run(self, w: FloatArray, nt: int) -> FloatArray:
        """(kept, nz) outputs at the kept samples of nt; the state moves on by nt. w: (nt + 1, nw)."""
        out = np.empty((self.cascade.D.shape[0], kept_samples(self.position, self.every, nt)))
        self.run_into(np.array(w.T, order="C"), 0, nt, out, 0)
        return out.T

    @one_thread
    def run_into(self, w: FloatArray, first: int, nt: int, out: FloatArray, place: int) -> None:
        """As `run`, from sample `first` of w (nw, .) on, which has sample first + nt, into out[:, place:]; both contiguous."""
        with np.errstate(over="ignore", invalid="ignore"):
            start = self._inward(self.state) - w[:, first] @ self._ramp
            after = self._steps.advance(start, w, first, nt, out, place)
            self.moved(self._outward(after + w[:, first + nt] @ self._ramp), nt)

    def _inward(self, state: FloatArray) -> FloatArray:
        return self._separated(state, -1.0)

    def _outward(self, state: FloatArray) -> FloatArray:
        return self._separated(state, 1.0)

    def _separated(self, state: FloatArray, sign: float) -> FloatArray:
        """The state with sign T [eta, eta'] added to the other states: into the parallel form (-1), or back (1)."""
        if self._T is None:
            return state
        both = self._T.shape[1]
        return np.concatenate([state[:both], state[both:] + sign * (self._T @ state[:both])])
