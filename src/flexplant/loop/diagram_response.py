"""The response of a linear diagram, stage by stage as signals flow, solved on its loops' own channels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from flexplant.errors import InputError
from flexplant.loop.bordered import bordered
from flexplant.loop.close import linear_only
from flexplant.loop.diagram import Diagram
from flexplant.loop.loop_bound import LoopAxis
from flexplant.loop.wiring import NONE
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.plant.modal import ModalPlant
from flexplant.response import frequency as plant_frequency
from flexplant.response.lasting import refuse_lasting

ComplexArray = npt.NDArray[np.complex128]
SINGULAR = 1e13  # condition of an equilibrated matrix, above which it counts as singular


class _Stage(NamedTuple):
    """The blocks of a stage: its output and input ports, and each block's response and places among them."""

    outputs: IntArray
    inputs: IntArray
    blocks: list[tuple[Callable[[FloatArray, None], ComplexArray], Any]]


class DiagramResponse:
    """hz (nf,) ascending -> (nz, nw, nf) response of a diagram; what does not depend on the frequency is made once."""

    def __init__(self, diagram: Diagram) -> None:
        linear_only(diagram)
        self.diagram, names = diagram, list(diagram.blocks)
        prepared = {k: plant_frequency.evaluator(cast(Any, block)) for k, block in enumerate(diagram.blocks.values())}
        wiring, self._stages = diagram.wiring, list[_Stage]()
        for stage in diagram.stages:
            members = [names.index(name) for name in stage]
            outputs, inputs = (np.flatnonzero(np.isin(b, members)) for b in (wiring.output_block, wiring.input_block))
            inside = [np.ix_(wiring.output_block[outputs] == k, wiring.input_block[inputs] == k) for k in members]
            self._stages.append(_Stage(outputs, inputs, [(prepared[k], at) for k, at in zip(members, inside, strict=True)]))

    def __call__(self, hz: FloatArray) -> ComplexArray:
        """(nz, nw, nf); InputError on an undamped pole, of a block or of the closed loop."""
        if hz.size and hz[0] == 0:
            try:
                self._grown(hz[:1])
            except InputError as error:
                zeros = int(np.count_nonzero(hz == 0))
                still = np.repeat(self._at_zero(error), zeros, axis=2)
                return np.concatenate([still, self(hz[zeros:])], axis=2) if hz.size > zeros else still
        values, growth = self._grown(hz)
        refuse_lasting(lambda near: self._grown(near)[0], hz, values, growth, f"diagram {self.diagram.name!r}")
        return values

    def _at_zero(self, error: InputError) -> ComplexArray:
        """(nz, nw, 1) at 0 Hz, where a block's own response is infinite but the loop around it may hold it: an integrator does.

        Solved for all ports and states together; raises the block's error where that is singular too.
        """
        blocks = self.diagram.blocks.values()
        if self.diagram.dt is not None or any(isinstance(b, ModalPlant) and b.damping is not None for b in blocks):
            raise error
        axis, at = LoopAxis(bordered(self.diagram), 1.0, high=False), np.zeros(1)
        M = axis.matrix(at, axis.outputs(at))[0]
        for along in (1, 0, 1, 0):
            M = M / np.maximum(abs(M).max(axis=along, keepdims=True), 1e-300)
        if np.linalg.cond(M) > SINGULAR:
            raise error
        return axis.responses(at)

    def _grown(self, hz: FloatArray) -> tuple[ComplexArray, FloatArray]:
        """The response, and how much larger what goes round in the loops is than what comes into them."""
        y = np.zeros((hz.size, len(self.diagram.wiring.output_ports), self.diagram.wiring.n_external), dtype=complex)
        growth = np.zeros(hz.size)
        for stage in self._stages:
            G = np.zeros((hz.size, stage.outputs.size, stage.inputs.size), dtype=complex)
            for evaluate, inside in stage.blocks:
                G[:, inside[0], inside[1]] = np.moveaxis(evaluate(hz, None), -1, 0)
            u, grown = _stage_inputs(self.diagram, y, G, stage, hz)
            y[:, stage.outputs], growth = G @ u, np.maximum(growth, grown)
        return np.moveaxis(y[:, self.diagram.wiring.readout], 0, -1), growth

    def at(self, hz: FloatArray) -> ComplexArray:
        """The response at frequencies in any order."""
        if (hz[1:] >= hz[:-1]).all():
            return self(hz)
        ascending, index = np.unique(hz, return_inverse=True)
        return self(ascending)[:, :, index]


def _stage_inputs(
    diagram: Diagram, y: ComplexArray, G: ComplexArray, stage: _Stage, hz: FloatArray
) -> tuple[ComplexArray, FloatArray | float]:
    """(nf, nu of the stage, nw) what comes from outside and earlier stages, with the stage's own feedback solved; its growth."""
    source = diagram.wiring.source[stage.inputs]
    u = np.where((source != NONE)[:, None], y[:, source], diagram.wiring.entry[stage.inputs])
    fed_back = np.flatnonzero(np.isin(source, stage.outputs))
    if not fed_back.size:
        return u, 0.0
    behind = np.searchsorted(stage.outputs, source[fed_back])
    through = G[:, behind]
    loop = np.eye(fed_back.size) - through[:, :, fed_back]
    # y of this stage is still zero, so u holds only what comes from outside it
    given = through @ u
    try:
        solved = np.linalg.solve(loop, given)
    except np.linalg.LinAlgError:
        k = int(np.flatnonzero(np.linalg.slogdet(loop)[0] == 0)[0])
        where = f"has a pole of its closed loop at {hz[k]:.9g} Hz"
        raise InputError(f"diagram {diagram.name!r} {where}, where its response is asked for; move the frequency") from None
    u[:, fed_back] = solved
    sizes = [abs(array).max(axis=(1, 2), initial=0.0) for array in (solved, through[:, :, fed_back], given)]
    return u, np.asarray(sizes[0] * (1 + sizes[1]) / np.maximum(sizes[2], 1e-300))
