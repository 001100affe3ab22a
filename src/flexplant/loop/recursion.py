"""The time recursion of a `Cascade`: exact steps, lifted over blocks of samples, in chunks of bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from flexplant.errors import InputError
from flexplant.loop.cascade import Cascade
from flexplant.loop.lifted import Lifted, block_starts, lifted, stepped
from flexplant.loop.stepping import Stepper, stepper
from flexplant.model.arrays import FloatArray
from flexplant.numerics.threads import one_thread

Progress = Callable[[int, int], None] | None
CHUNK = 256  # blocks whose inputs and starting states are held at once; they stay in cache


@dataclass(frozen=True, eq=False)
class Trajectory:
    """outputs: (nz, kept samples), D w included. final_state: at the last sample, in the order of the whole system's states."""

    outputs: FloatArray
    final_state: FloatArray


class Standing:
    """The state that a cascade stands at between runs: `state` (N,) is [eta, eta', l]. stepping: in words, how it moves."""

    stepping = ""

    def __init__(self, cascade: Cascade, state: FloatArray, dt: float) -> None:
        self.cascade, self.order = cascade, np.r_[cascade.modal_states, cascade.other_states]
        self.state, self.dt, self.position = state[self.order].copy(), dt, 0

    def moved(self, state: FloatArray, samples: int) -> None:
        """Take the state `samples` later; InputError where it has left the range of numbers: the outputs would be none either."""
        self.position += samples
        if not np.isfinite(state).all():
            end = self.position * self.dt
            raise InputError(f"simulate: the states overflow within {end:.6g} s: the system is unstable; simulate a shorter time")
        self.state = state

    def last(self, w: FloatArray) -> FloatArray:
        """(nz,) outputs at the sample that the state stands at, for the inputs w (nw,)."""
        rows = np.hstack([self.cascade.C_modes, self.cascade.C])
        return np.asarray(rows @ self.state + self.cascade.D @ w)

    @property
    def whole_state(self) -> FloatArray:
        """(N,) the state in the order of `close` or `state_space`."""
        out = np.empty(self.state.size)
        out[self.order] = self.state
        return out


class Recursion(Standing):
    """x[k+1] = F x[k] + G w of a cascade, resumable: each `run` goes on from the state that the last one left.

    state: (N,) [eta, eta', l]. Over L steps the recursion is x[k+L] = F^L x[k] + R [w[k] ... w[k+L]] and the outputs in between
    are one product with x[k] and one with the inputs. The arithmetic is that of stepping one by one, in another order.
    """

    def __init__(self, cascade: Cascade, dt: float, state: FloatArray, hold: str, every: int = 1) -> None:
        super().__init__(cascade, state, dt)
        self.one: Stepper = stepper(cascade, dt, hold)
        self.lifted: Lifted = lifted(cascade, self.one, dt, every)
        transposed = (self.lifted.long.A.T, self.lifted.long.from_modes.T)
        self._driven = self._starts = np.zeros((0, self.state.size))
        self._long = (self.lifted.long.modes, *(np.ascontiguousarray(part) for part in transposed))

    @property
    def chunk(self) -> int:
        """Samples that `run` takes at once at most; a multiple of both the block length and `every`."""
        blocks = max(CHUNK, -(-self.lifted.every // self.lifted.length))
        unit = int(np.lcm(self.lifted.length, self.lifted.every))
        return max(1, blocks * self.lifted.length // unit) * unit

    @one_thread
    def run(self, w: FloatArray, nt: int) -> FloatArray:
        """(kept, nz) outputs at samples 0, every, ... < nt; `state` moves to sample nt. w: (nt + 1, nw), nt at most a chunk."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self._run(w, nt)

    def _run(self, w: FloatArray, nt: int) -> FloatArray:
        block, every, nw = self.lifted.length, self.lifted.every, w.shape[1]
        nb = -(-nt // block)
        padded = np.zeros((nb * block + 1, nw))
        padded[: nt + 1] = w
        rows = np.ascontiguousarray(np.lib.stride_tricks.sliding_window_view(padded.ravel(), (block + 1) * nw)[:: block * nw])
        if len(self._driven) != nb:
            self._driven, self._starts = np.empty((2, nb, self.state.size))
        driven, starts = self._driven, self._starts
        x, whole = self.state.copy(), nt // block
        np.matmul(rows, self.lifted.received, out=driven)
        block_starts(*self._long, driven, x, starts)
        values = starts @ self.lifted.seen
        values += rows @ self.lifted.direct
        self.moved(x if whole == nb else self._stepped_singly(starts[whole], w[whole * block :]), nt)
        first = slice(None, None, max(1, every // block))
        return np.asarray(values[first].reshape(-1, self.cascade.D.shape[0])[: -(-nt // every)])

    def _stepped_singly(self, x: FloatArray, w: FloatArray) -> FloatArray:
        for now, change in zip(w[:-1], np.diff(w, axis=0), strict=True):
            x = stepped(self.one, x[None])[0] + np.r_[now, change] @ self.one.drive
        return x


def chunks(total: int, size: int) -> Iterator[tuple[int, int]]:
    """(start, stop) of pieces of at most `size` that cover `total`."""
    for start in range(0, total, size):
        yield start, min(start + size, total)


class Runner(Protocol):
    """A resumable recursion: `Recursion`, or one with sampled blocks."""

    @property
    def chunk(self) -> int:
        """Samples that `run` takes at once at most."""

    @property
    def whole_state(self) -> FloatArray:
        """The state it stands at."""

    def run(self, w: FloatArray, nt: int) -> FloatArray:
        """Advance nt samples under w (nt + 1, nw); returns the kept outputs (kept, nz)."""

    def last(self, w: FloatArray) -> FloatArray:
        """The outputs (nz,) where it stands."""


@runtime_checkable
class InPlace(Protocol):
    """A recursion that reads its inputs and writes its outputs where they are, without copies."""

    def run_into(self, w: FloatArray, first: int, nt: int, out: FloatArray, place: int) -> None:
        """Advance nt samples under w (nw, .) from `first` on; the kept outputs go to out[:, place:]."""


def march(
    runner: Runner, w: FloatArray | None, nt: int, sizes: tuple[int, int], every: int = 1, progress: Progress = None
) -> Trajectory:
    """Outputs of samples 0, every, ... of nt under the inputs w (nw, nt), or None for free motion; sizes: (nw, nz)."""
    nw, nz = sizes
    outputs = np.empty((nz, -(-nt // every)))
    given = None if w is None else np.require(w, np.float64, ["C", "W"])
    in_place = runner if isinstance(runner, InPlace) else None
    for start, stop in chunks(nt - 1, runner.chunk):
        source, at = (np.zeros((nw, stop - start + 1)), 0) if given is None else (given, start)
        first, last = -(-start // every), -(-stop // every)
        if in_place is not None:
            in_place.run_into(source, at, stop - start, outputs, first)
        else:
            outputs[:, first:last] = runner.run(source[:, at : at + stop - start + 1].T, stop - start).T
        if progress is not None:
            progress(stop + 1, nt)
    if (nt - 1) % every == 0:
        outputs[:, -1] = runner.last(np.zeros(nw) if w is None else w[:, -1])
    return Trajectory(outputs, runner.whole_state)
