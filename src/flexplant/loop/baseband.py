"""Frequency response of loops with digital blocks: what of the output has the frequency of the input.

Under w = e^{i omega t} the digital blocks read q(t_k) = H_qw e^{i omega t_k} and what their own held outputs p add. The part of
p at omega and those at omega + 2 pi k / T drive the continuous blocks; with the hold h = (1 - e^{-i omega T}) / (i omega T)

    P = (I - K H_d)^-1 K H_qw w,   z at omega = H_zw w + H_zp h P

where H is the response of the continuous blocks, H_d that of their samples under held inputs, K that of the digital blocks. With
several rates P is the sequence of N base samples within the common period, each of which repeats times e^{i omega N dt}.
Source: Franklin, Powell and Workman, Digital Control of Dynamic Systems, section 5.3; Chen and Francis, Optimal Sampled-Data
Control Systems, chapter 3.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from flexplant.errors import InputError
from flexplant.loop.breaking import alone
from flexplant.loop.diagram import Diagram
from flexplant.loop.diagram_response import ComplexArray, DiagramResponse
from flexplant.loop.hybrid import Split, hybrid_of, split
from flexplant.loop.rates import rates_of
from flexplant.loop.warped import warped, warped_hz
from flexplant.model.arrays import FloatArray
from flexplant.response.frequency import evaluator

MOST = 600  # held outputs times base samples in a period: unknowns at each frequency
CHUNK = 2**21  # entries of the matrices of one part of the frequencies


class SampledResponse:
    """hz (nf,) ascending -> (nz, nw, nf) of a diagram with digital blocks; what does not depend on the frequency is made once."""

    def __init__(self, diagram: Diagram) -> None:
        rates = rates_of(diagram)
        assert rates is not None
        self._rates, self._hybrid, parts = rates, hybrid_of(diagram), split(diagram)
        self._shape = (self._hybrid.nz + parts.q_ports.size, self._hybrid.nw + parts.p_ports.size)
        self._places = np.ix_(parts.rows, parts.columns)
        self._direct = self._hybrid.linear.D.copy()
        self._direct.setflags(write=True)
        self._direct[parts.rows] = 0.0  # left is what goes through no continuous block
        size = parts.p_ports.size * rates.steps
        if size > MOST:
            raise InputError(
                f"diagram {diagram.name!r}: {parts.p_ports.size} digital outputs at {rates.steps} base samples in a period"
                f" ({diagram.rates}) make {size} unknowns, more than {MOST}; choose sample times with a shorter common period"
            )
        self._continuous = DiagramResponse(parts.inner)
        self._sampled = _SampledPart(parts, self._hybrid.nz, self._hybrid.nw, rates.base)
        self._digital = [evaluator(cast(Any, element.block)) for element in self._hybrid.elements]

    def __call__(self, hz: FloatArray) -> ComplexArray:
        """(nz, nw, nf); InputError on an undamped pole."""
        size = max(CHUNK // (self._shape[1] * self._rates.steps) ** 2, 1)
        parts = [self._part(hz[start : start + size]) for start in range(0, hz.size, size)]
        return np.concatenate([np.zeros((self._hybrid.nz, self._hybrid.nw, 0), dtype=complex), *parts], axis=2)

    def at(self, hz: FloatArray) -> ComplexArray:
        """The response at frequencies in any order."""
        return self(hz)

    def _part(self, hz: FloatArray) -> ComplexArray:
        nz, nw, (rates, N) = self._hybrid.nz, self._hybrid.nw, (self._rates, self._rates.steps)
        H = np.repeat(self._direct[None].astype(complex), hz.size, axis=0)
        H[:, self._places[0], self._places[1]] += np.moveaxis(self._continuous.at(hz), -1, 0)
        turn = np.exp(2j * np.pi * np.outer(hz, np.arange(N)) * rates.base)  # over base samples, (nf, N)
        given = turn[:, :, None, None] * H[:, None, nz:, :nw]
        through, K = self._through(hz), self._controllers(hz)
        np_, nq = K.shape[2], K.shape[4]
        K = K.reshape(hz.size, N * np_, N * nq)
        loop = np.eye(N * np_) - K @ through.reshape(hz.size, N * nq, N * np_)
        try:
            P = np.linalg.solve(loop, K @ given.reshape(hz.size, N * nq, nw)).reshape(hz.size, N, np_, nw)
        except np.linalg.LinAlgError:
            raise InputError("a pole of the sampled loop lies at a frequency of its response; move the frequency") from None
        hold = np.exp(-1j * np.pi * hz * rates.base) * np.sinc(hz * rates.base)
        at_tone = np.einsum("fj,fjpw->fpw", turn.conj(), P) / N * hold[:, None, None]
        return np.moveaxis(H[:, :nz, :nw] + H[:, :nz, nw:] @ at_tone, 0, -1)

    def _through(self, hz: FloatArray) -> ComplexArray:
        """(nf, N, nq, N, np) what held outputs of base sample i give at sample j, through the continuous blocks."""
        nz, nw, N = self._hybrid.nz, self._hybrid.nw, self._rates.steps
        H = np.stack([self._sampled(hz + k / self._rates.period) for k in range(N)], axis=1)  # (nf, N, nq, np)
        return _between_samples(H + self._direct[nz:, nw:], hz, self._rates.base)

    def _controllers(self, hz: FloatArray) -> ComplexArray:
        """(nf, N, np, N, nq) what inputs of base sample i give in the held outputs of sample j, through the digital blocks."""
        N, base, elements = self._rates.steps, self._rates.base, self._hybrid.elements
        K = np.zeros((hz.size, N, self._shape[1] - self._hybrid.nw, N, self._shape[0] - self._hybrid.nz), dtype=complex)
        for element, evaluate in zip(elements, self._digital, strict=True):
            own = element.period(base)
            values = [np.moveaxis(evaluate(hz + k / self._rates.period, None), -1, 0) for k in range(N // own)]
            each = _between_samples(np.stack(values, axis=1), hz, own * base)
            K[:, :, element.outputs, ::own, element.inputs] = np.repeat(each, own, axis=1)
        return K


def _between_samples(H: ComplexArray, hz: FloatArray, dt: float) -> ComplexArray:
    """(nf, M, ny, M, nu) from the responses H (nf, M, ny, nu) at hz + l / (M dt): (1 / M) sum_l H_l z_l^(j - i)."""
    M = H.shape[1]
    if M == 1:
        return H[:, :, :, None, :]
    lag = np.subtract.outer(np.arange(M), np.arange(M))
    turns = np.exp(2j * np.pi * lag[None] * np.arange(M)[:, None, None] / M) / M
    tone = np.exp(2j * np.pi * hz[:, None, None] * lag * dt)
    return np.asarray(np.einsum("flyu,lji,fji->fjyiu", H, turns, tone, optimize=True))


class _SampledPart:
    """hz (nf,) -> (nf, nq, np) of the samples of the continuous blocks under held outputs of the digital ones."""

    def __init__(self, parts: Split, nz: int, nw: int, dt: float) -> None:
        inner, self._dt, self._shape = parts.inner, dt, (parts.q_ports.size, parts.p_ports.size)
        inputs = {name: ports for name, ports in inner.inputs.items() if int(name) >= nw}
        outputs = {name: port for name, port in inner.outputs.items() if int(name) >= nz}
        self._places = np.ix_([int(name) - nz for name in outputs], [int(name) - nw for name in inputs])
        driven = alone(inner, connections=inner.connections, inputs=inputs, outputs=outputs)
        self._response = DiagramResponse(warped(driven, dt, minimal=False)) if inputs and outputs else None

    def __call__(self, hz: FloatArray) -> ComplexArray:
        out = np.zeros((hz.size, *self._shape), dtype=complex)
        if self._response is not None:
            w = warped_hz(hz, self._dt)
            values = self._response.at(abs(w))
            out[:, self._places[0], self._places[1]] = np.moveaxis(np.where(w < 0, values.conj(), values), -1, 0)
        return out
