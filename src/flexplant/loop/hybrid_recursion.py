"""The time recursion of a `Hybrid`: what comes from outside in matrix products, the sampled loop around the rest step by step."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from flexplant.blocks.sampled import RATE_LIMITER, SampledBlock
from flexplant.errors import InputError
from flexplant.loop.cascade import Cascade
from flexplant.loop.fused import LARGEST_REST
from flexplant.loop.hybrid import Element, Hybrid
from flexplant.loop.loop_recursion import recursion_of
from flexplant.loop.sampled_loop import SampledLoop, TiledLoop, tiled_rows
from flexplant.loop.sampled_steps import FINITE, KINDS, STATE_SPACE, sampled_steps
from flexplant.loop.stepping import Stepper, stepper
from flexplant.loop.user_code import c_functions
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.numerics.compiled import numba
from flexplant.numerics.threads import one_thread

CHUNK = 16384
LONG = 4096  # samples from which compiling a plain function is worth its time


class HybridRecursion:
    """Resumable like `Recursion`. State vector: the linear blocks' states in the order of the diagram, then the sampled blocks'.

    Modes that no sampled block reaches are stepped beforehand, lifted; modes inside the loop step with it. The linear system
    moves exactly under held outputs p of the sampled blocks and under w with its own hold. At the start p is zero.
    """

    def __init__(self, hybrid: Hybrid, dt: float, state: FloatArray, hold: str, every: int = 1) -> None:
        linear = hybrid.linear
        if linear.dt is not None:
            raise InputError(
                "a diagram with sampled blocks is stepped by their own recursions; its linear part must be continuous"
            )
        self.hybrid, self.dt, self.every, self.position = hybrid, dt, every, 0
        self.order = np.r_[linear.modal_states, linear.other_states]
        one = stepper(linear, dt, hold)
        nw, width = hybrid.nw, linear.B.shape[1]
        self._drive = np.vstack([one.drive[:nw], one.drive[width : width + nw]])
        x = state[: linear.n_states][self.order]
        listening = linear.omega.size > 0 and not linear.shape_in[:, nw:].any()
        self.ahead = recursion_of(_modes_alone(linear, one, nw), dt, x[: 2 * linear.omega.size], hold) if listening else None
        self.n_ahead = 2 * linear.omega.size if listening else 0
        self.x, self.s, self.p = x[self.n_ahead :].copy(), state[linear.n_states :].copy(), np.zeros(width - nw)
        self._parts, self._tables = _parts(hybrid, one, self.n_ahead), _tables(hybrid.elements, dt, width - nw)
        users = [e.block.function if isinstance(e.block, SampledBlock) else None for e in hybrid.elements]
        self._functions = users if any(users) else None
        self._one, self._begun = one, False
        self._loop: SampledLoop | TiledLoop | None = None
        self._calls: list[Any] | None = []

    def _begin(self, nt: int) -> None:
        """Choose the compiled loop where every block can be compiled; a short run is not worth compiling a plain function for."""
        self._begun = True
        if numba() is None or self.hybrid.linear.A.shape[0] > LARGEST_REST:
            self._calls = None
            return
        self._calls = c_functions(self.hybrid.elements, plain=nt >= LONG)
        if self._calls is not None:
            addresses = np.array([0 if call is None else call.address for call in self._calls], dtype=np.int64)
            rows, fixed = tiled_rows(self.hybrid, self._one, self.n_ahead), (self._tables, addresses)
            if rows is None:
                self._loop = SampledLoop(self.hybrid, self._one, self.n_ahead, *fixed)
            else:
                self._loop = TiledLoop(self.hybrid, self._one, rows, *fixed)

    @property
    def called_in_python(self) -> list[str]:
        """Names of the blocks whose functions the last run called in Python."""
        users = [e.name for e in self.hybrid.elements if isinstance(e.block, SampledBlock) and e.block.function is not None]
        return [] if self._loop is not None else users

    @property
    def chunk(self) -> int:
        """Samples that `run` takes at once at most; a multiple of `every`."""
        size = CHUNK if self.ahead is None else self.ahead.chunk
        return max(1, size // self.every) * self.every

    @one_thread
    def run(self, w: FloatArray, nt: int) -> FloatArray:
        """(kept, nz) outputs at samples 0, every, ... < nt; the state moves to sample nt. w: (nt + 1, nw)."""
        if not self._begun:
            self._begin(nt)
        linear, m, nz = self.hybrid.linear, self.hybrid.linear.A.shape[0], self.hybrid.nz
        driven, seen = np.zeros((nt, m)), np.zeros((nt, linear.C.shape[0]))
        if self.ahead is not None:
            size = self.ahead.chunk
            moved = np.vstack([self.ahead.run(w[a : min(a + size, nt) + 1], min(size, nt - a)) for a in range(0, nt, size)])
            driven, seen = np.ascontiguousarray(moved[:, :m]), np.ascontiguousarray(moved[:, m:])
        out = np.zeros((len(range(-self.position % self.every, nt, self.every)), nz))
        advance = self._advance_plain if self._loop is None else self._advance_compiled
        with np.errstate(over="ignore", invalid="ignore"):
            failure = advance(w[: nt + 1], driven, seen, out)
        if failure[1] != FINITE:
            self._refuse(*failure)
        if not np.isfinite(self.x).all():
            raise InputError(f"simulate: the linear states overflow before t = {(self.position + nt) * self.dt:.9g} s: unstable")
        self.position += nt
        return out

    def _refuse(self, sample: int, block: int) -> None:
        element, t = self.hybrid.elements[block], (self.position + sample) * self.dt
        if self._loop is not None and isinstance(element.block, SampledBlock) and element.block.function is not None:
            element.block.function(t, self._loop.asked[element.inputs], self.s[element.states])  # says what is wrong with it
        raise InputError(f"simulate: the input of block {element.name!r} is not finite at t = {t:.9g} s: the loop is unstable")

    def _advance_compiled(self, w: FloatArray, driven: FloatArray, seen: FloatArray, out: FloatArray) -> tuple[int, int]:
        assert self._loop is not None
        at = (self.position, self.every, self.dt)
        return self._loop.run((self.x, self.p, self.s), w, driven, seen, out, at)

    def _advance_plain(self, w: FloatArray, driven: FloatArray, seen: FloatArray, out: FloatArray) -> tuple[int, int]:
        nw, moves = self.hybrid.nw, np.hstack([w[:-1], np.diff(w, axis=0)]) @ self._drive[:, self.n_ahead :]
        moves[:, moves.shape[1] - driven.shape[1] :] += driven
        seen = seen + w[:-1] @ self.hybrid.linear.D[:, :nw].T
        out += seen[-self.position % self.every :: self.every, : self.hybrid.nz]
        linear, direct = self._parts
        arrays = (*self._tables, moves, seen, out, self.x, self.p, self.s)
        return sampled_steps(linear, direct, *arrays, self.position, self.every, self.dt, self._functions)

    def last(self, w: FloatArray) -> FloatArray:
        """(nz,) outputs at the sample that the state stands at, for the inputs w (nw,); the state stays."""
        ahead = None if self.ahead is None else self.ahead.state.copy()
        x, s, p, every = self.x.copy(), self.s.copy(), self.p.copy(), self.every
        self.every = 1
        out: FloatArray = self.run(np.vstack([w, w]), 1)[0]
        self.x, self.s, self.p, self.every = x, s, p, every
        self.position -= 1
        if self.ahead is not None and ahead is not None:
            self.ahead.state = ahead
        return out

    @property
    def whole_state(self) -> FloatArray:
        """(N,) the linear blocks' states in the order of the diagram, then those of the sampled blocks."""
        out = np.empty(self.hybrid.linear.n_states + self.s.size)
        out[self.order] = np.r_[np.zeros(0) if self.ahead is None else self.ahead.state, self.x]
        out[self.order.size :] = self.s
        return out


def _modes_alone(linear: Cascade, one: Stepper, nw: int) -> Cascade:
    """The modes under w, with outputs: what they add to the rest over a step, and to z and q."""
    rows = np.vstack([one.from_modes, linear.C_modes])
    n = linear.omega.size
    return replace(
        linear,
        shape_in=linear.shape_in[:, :nw],
        A=np.zeros((0, 0)),
        from_modes=np.zeros((0, 2 * n)),
        B=np.zeros((0, nw)),
        C_modes=rows,
        C=np.zeros((rows.shape[0], 0)),
        D=np.zeros((rows.shape[0], nw)),
        modal_states=np.arange(2 * n),
        other_states=np.zeros(0, dtype=np.int64),
    )


def _parts(hybrid: Hybrid, one: Stepper, n_ahead: int) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
    """What the inner loop needs of the linear system without its first n_ahead states."""
    linear, nw, nz = hybrid.linear, hybrid.nw, hybrid.nz
    width = linear.B.shape[1]
    modes = one.modes[: 0 if n_ahead else None].reshape(-1, 4).T
    rows = np.hstack([linear.C_modes, linear.C])[:, n_ahead:]
    dense = (modes, one.A, one.from_modes[:, n_ahead:], one.drive[nw:width, n_ahead:].T, rows[nz:], rows[:nz])
    direct = (linear.D[nz:, nw:], linear.D[:nz, nw:])
    return tuple(np.array(part, order="C") for part in dense), tuple(np.array(part, order="C") for part in direct)


def _tables(elements: tuple[Element, ...], dt: float, n_outputs: int) -> tuple[IntArray, FloatArray, FloatArray]:
    table = np.zeros((len(elements), 9), dtype=np.int64)
    bounds, flat = np.ones((2, n_outputs)), [np.zeros(0)]
    for row, element in zip(table, elements, strict=True):
        block, period = element.block, element.period(dt)
        kind = block.kind if isinstance(block, SampledBlock) else STATE_SPACE
        spans = (element.inputs, element.outputs, element.states)
        row[:] = [KINDS[kind], *(end for span in spans for end in (span.start, span.stop)), sum(f.size for f in flat), period]
        if isinstance(block, SampledBlock):
            factor = period * dt if kind == RATE_LIMITER else 1.0
            bounds[:, element.outputs] = np.vstack([block.low, block.high]) * factor
        else:
            flat.append(np.block([[block.A, block.B], [block.C, block.D]]).ravel())
    return table, bounds, np.concatenate(flat)
