"""Loops broken at signals, ready for many evaluations: continuous ones over frequency, digital ones over the warped frequency."""

from __future__ import annotations

from functools import cache, cached_property

import numpy as np

from flexplant.errors import InputError
from flexplant.loop.bordered import bordered
from flexplant.loop.breaking import cut_open, disturbed
from flexplant.loop.close import close, solved_wires
from flexplant.loop.diagram import Diagram
from flexplant.loop.diagram_response import ComplexArray, DiagramResponse
from flexplant.loop.discretize import discretize
from flexplant.loop.modal_split import with_modes_apart
from flexplant.loop.norms import has_bordered_form, loop_axes
from flexplant.loop.rates import expect_sampled, rates_of
from flexplant.loop.stability import stability
from flexplant.loop.warped import true_hz, warped, warped_hz
from flexplant.loop.warped_modes import AT_NYQUIST, warped_space
from flexplant.model.arrays import FloatArray
from flexplant.plant.modal import ModalPlant

ON_POLE = 1e-14  # relative distance from a mode without damping that counts as on it


class BrokenLoops:
    """A diagram broken at signals: `opened`, and `closed` with disturbances at the signals.

    dt: None, or the sample time in seconds of a loop with digital blocks. Its frequencies are then warped ones (see `warped`):
    `seen` and `asked` turn them into true ones and back.
    """

    def __init__(self, diagram: Diagram, signals: list[str]) -> None:
        """InputError for signals at which a loop with digital blocks has no transfer function."""
        self.signals, self.dt, self.about = signals, None, ""
        rates = rates_of(diagram)
        if rates is None:
            self.opened, self._closed = cut_open(diagram, signals), disturbed(diagram, signals).__getitem__
        else:
            expect_sampled(diagram, signals, rates)
            dt = self.dt = rates.period
            self.about = f"pulse transfer function of the loop sampled every {dt:.6g} s"
            if rates.steps > 1:
                self.about += f", all of its rates ({diagram.rates}) lifted over this common period"
                lifted, names = _of_one_rate(cut_open(diagram, signals), dt)
                self.opened, self._closed = cut_open(lifted, names), disturbed(lifted, names).__getitem__
            else:
                self.opened = warped(cut_open(diagram, signals), dt, minimal=False)
                closed = disturbed(diagram, signals)
                self._closed = cache(lambda kind: warped(closed[kind], dt))
        self._response = DiagramResponse(self.opened)
        self._refuse_pole_at_nyquist()

    def closed(self, kind: str) -> Diagram:
        """The diagram of S, T or half = (S - T) / 2."""
        return self._closed(kind)

    def seen(self, hz: FloatArray) -> FloatArray:
        """True frequencies of those that the loops are evaluated at."""
        return hz if self.dt is None else true_hz(hz, self.dt)

    def asked(self, hz: FloatArray) -> FloatArray:
        """The inverse of `seen`."""
        return hz if self.dt is None else warped_hz(hz, self.dt)

    def gain(self, hz: FloatArray) -> ComplexArray:
        """(r, r, nf) L, at frequencies in any order."""
        return np.asarray(-self._response.at(hz), dtype=complex)

    def loops(self, hz: FloatArray) -> ComplexArray:
        """(r, nf) each loop with the others closed; beside a mode without damping where a search comes upon it."""
        return one_at_a_time(self.gain(self._beside_poles(hz)))

    def both(self, hz: FloatArray) -> ComplexArray:
        """(r + r r, nf) each loop with the others closed, then the entries of L; as `loops`."""
        L = self.gain(self._beside_poles(hz))
        return np.concatenate([one_at_a_time(L), L.reshape(-1, hz.size)])

    def _beside_poles(self, hz: FloatArray) -> FloatArray:
        if not self._lasting.size:
            return hz
        k = np.searchsorted(self._lasting, hz)
        for pole in (self._lasting[np.maximum(k - 1, 0)], self._lasting[np.minimum(k, self._lasting.size - 1)]):
            hz = np.where(abs(hz - pole) <= ON_POLE * pole, pole * (1 + 2 * ON_POLE), hz)
        return hz

    @cached_property
    def _lasting(self) -> FloatArray:
        """Hz of the modes without damping, ascending."""
        plants = [block for block in self.opened.blocks.values() if isinstance(block, ModalPlant)]
        every = np.concatenate([np.zeros(0), *(plant.frequency_hz[(plant.zeta == 0) & (plant.omega > 0)] for plant in plants)])
        return np.unique(every)

    @cached_property
    def at_ends(self) -> ComplexArray:
        """(2, r) each loop, the others closed, at 0 Hz (zero where it is infinite) and at infinity, the Nyquist frequency."""
        last = one_at_a_time(self._at_infinity[:, :, None].astype(complex))[:, 0]
        try:
            first = self.loops(np.zeros(1))[:, 0]
        except InputError:  # a pole at 0 Hz
            first = np.zeros_like(last)
        return np.stack([first, last])

    @cached_property
    def _at_infinity(self) -> FloatArray:
        D, wiring = self.opened.feedthrough, self.opened.wiring
        through = D @ solved_wires(self.opened, wiring.internal @ D, wiring.entry)
        return np.asarray(-through[wiring.readout])

    def _refuse_pole_at_nyquist(self) -> None:
        """InputError for a digital loop whose closed form is singular over w: it has a pole at z = -1."""
        returned = np.eye(len(self.signals)) + self._at_infinity
        if self.dt is not None and np.linalg.cond(returned) > AT_NYQUIST:
            raise InputError(
                f"the loop closed at {', '.join(self.signals)} has a pole at z = -1 (the Nyquist frequency,"
                f" {0.5 / self.dt:.6g} Hz), on the edge of stability, where nothing can be told of it; change a gain a little"
            )

    def instability(self) -> str:
        """What grows in a digital loop, in words."""
        assert self.dt is not None
        system, beyond = self.closed("S"), ""
        if has_bordered_form(system):
            pole = stability(loop_axes(bordered(system))).pole
        else:
            poles = np.linalg.eigvals(close(system).A)
            pole = complex(poles[int(np.argmax(poles.real))])
        if pole is not None:
            z = (1 + pole * self.dt / 2) / (1 - pole * self.dt / 2)
            beyond = f", one of them at z = {z.real:.6g} {abs(z.imag):+.6g}i ({abs(np.angle(z)) / (2 * np.pi * self.dt):.6g} Hz)"
        return f"the closed loop is unstable: poles on or outside the unit circle{beyond}"


def _of_one_rate(opened: Diagram, period: float) -> tuple[Diagram, list[str]]:
    """The open loops of several rates as one block over w that is sampled once a period, closed on itself, and its signals."""
    block = warped_space(discretize(opened, period), period)
    signals = [f"loop.{name}" for name in block.outputs]
    wires = [(signal, f"loop.{name}") for signal, name in zip(signals, block.inputs, strict=True)]
    whole = Diagram(blocks={"loop": block}, connections=wires, allow_algebraic_loops=True, name=opened.name)
    return with_modes_apart(whole), signals


def one_at_a_time(L: ComplexArray) -> ComplexArray:
    """(r, nf) gain of each loop of L (r, r, nf) with the others closed: L_kk - L_ko (I + L_oo)^-1 L_ok."""
    stack = np.moveaxis(L, -1, 0)
    out = np.array(np.diagonal(stack, axis1=1, axis2=2).T)
    for k in range(L.shape[0] if L.shape[0] > 1 else 0):
        others = np.delete(np.arange(L.shape[0]), k)
        inner = np.eye(others.size) + stack[:, others[:, None], others]
        through = np.linalg.solve(inner, stack[:, others, k][:, :, None])
        out[k] -= (stack[:, k, others][:, None, :] @ through)[:, 0, 0]
    return out
