"""Which recursion a linear system takes, and the one of a loop in its own modes."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from flexplant.loop.cascade import Cascade
from flexplant.loop.fused import FusedRecursion, is_fused, kept_samples, march_kernel
from flexplant.loop.loop_modes import ComplexArray, LoopModes, loop_modes
from flexplant.loop.recursion import Recursion, Standing
from flexplant.loop.tiled import MOST_REST, Rows, TileSteps, blocks_driven
from flexplant.model.arrays import FloatArray

LinearRecursion = FusedRecursion | Recursion


class LoopRecursion(FusedRecursion):
    """x[k+1] = F x[k] + G w[k] of a cascade in its `LoopModes`, resumable; equal to the lifted recursion to round-off."""

    def __init__(self, cascade: Cascade, modes: LoopModes, dt: float, state: FloatArray, hold: str, every: int = 1) -> None:
        Standing.__init__(self, cascade, state, dt)
        self.every, self._modes = every, modes
        transition, held, ramp = modes.steps(dt, hold)
        causal, rows = held - ramp + transition @ ramp, np.hstack([cascade.C_modes, cascade.C]) @ modes.outward
        self._ramp = ramp.transpose(2, 1, 0).reshape(ramp.shape[2], -1)
        D = cascade.D + rows @ self._ramp.T
        if not D.shape[1]:  # the compiled steps need an input: one that is always zero
            causal, D = np.zeros((*causal.shape[:2], 1)), np.zeros((len(D), 1))
        nothing = (np.zeros((0, 0)), np.zeros((0, D.shape[1])))
        steps = TileSteps(blocks_driven(transition, causal), Rows(rows), nothing, (np.zeros((len(D), 0)), D))
        self._steps = EachKept(steps, every)

    def _inward(self, state: FloatArray) -> FloatArray:
        return np.asarray(self._modes.inward @ state)

    def _outward(self, state: FloatArray) -> FloatArray:
        return np.asarray(self._modes.outward @ state)


class EachKept:
    """Steps that make every output, of which each `every`-th is kept, counted from the first."""

    def __init__(self, steps: TileSteps, every: int) -> None:
        self._steps, self._every, self._position = steps, every, 0

    def advance(self, state: FloatArray, w: FloatArray, first: int, count: int, out: FloatArray, place: int) -> FloatArray:
        """As `TileSteps.advance`."""
        w = w if len(w) else np.zeros((1, w.shape[1]))
        if self._every == 1:
            return self._steps.advance(state, w, first, count, out, place)
        whole = np.empty((len(out), count))
        after = self._steps.advance(state, w, first, count, whole, 0)
        kept = kept_samples(self._position, self._every, count)
        out[:, place : place + kept] = whole[:, -self._position % self._every :: self._every]
        self._position += count
        return after


def recursion_of(cascade: Cascade, dt: float, state: FloatArray, hold: str, every: int = 1) -> LinearRecursion:
    """The recursion that is the fastest one for this cascade."""
    modes = own_modes(cascade)
    if isinstance(modes, LoopModes):
        made: LinearRecursion = LoopRecursion(cascade, modes, dt, state, hold, every)
        made.stepping = f"modes of the loop (condition {modes.condition:.1e})"
    else:
        made = (FusedRecursion if is_fused(cascade) else Recursion)(cascade, dt, state, hold, every)
        block = f"dense block of {cascade.A.shape[0]} states" + (f": {modes}" if modes else "")
        made.stepping = block if cascade.A.shape[0] > MOST_REST else "modes of the structure"
    return made


def loop_poles(cascade: Cascade) -> ComplexArray:
    """The poles of what is closed on itself, among which a growing one can be."""
    modes = own_modes(cascade)
    return modes.poles.ravel() if isinstance(modes, LoopModes) else scipy.linalg.eigvals(cascade.A)


def own_modes(cascade: Cascade) -> LoopModes | str:
    """The modes of a loop of more states than are stepped singly, or why it is not stepped in them."""
    if cascade.dt is not None or cascade.A.shape[0] <= MOST_REST or march_kernel() is None:
        return ""
    if "loop modes" not in cascade.derived:
        cascade.derived["loop modes"] = loop_modes(cascade)
    found: LoopModes | str = cascade.derived["loop modes"]
    return found
