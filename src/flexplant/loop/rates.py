"""Sample times of a diagram: what they have in common, and which signals only matter at samples."""

from __future__ import annotations

import math
from collections.abc import Iterable
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from flexplant.blocks.sampled import SampledBlock
from flexplant.errors import DiagramError, InputError
from flexplant.loop.diagram import Diagram
from flexplant.loop.hybrid import is_sampled
from flexplant.loop.wiring import NONE
from flexplant.plant.state_space import StateSpace

WHOLE = 1e-6  # relative deviation from a whole ratio, that decimal sample times may have
MOST_STEPS = 1000  # base steps in a period


class Rates(NamedTuple):
    """base: the longest step that divides every sample time; period: the shortest time they divide; both in seconds."""

    base: float
    period: float

    @property
    def steps(self) -> int:
        """Base steps in a period."""
        return round(self.period / self.base)


def digital_times(diagram: Diagram) -> dict[str, float]:
    """Sample time in seconds of each digital block; DiagramError for a diagram with nonlinear blocks."""
    nonlinear = [name for name, block in diagram.blocks.items() if isinstance(block, SampledBlock)]
    if nonlinear:
        raise DiagramError(
            f"diagram {diagram.name!r} has nonlinear blocks ({', '.join(nonlinear)}); simulate it, or leave them out"
        )
    return {name: block.dt for name, block in diagram.blocks.items() if isinstance(block, StateSpace) and block.dt is not None}


def rates_of(diagram: Diagram) -> Rates | None:
    """The rates of a diagram's digital blocks, None without any; InputError where they have no common period that is short."""
    times = digital_times(diagram)
    if not times:
        return None
    shortest = min(times.values())
    ratios = [whole_ratio(time / shortest) for time in times.values()]
    known = [ratio for ratio in ratios if ratio is not None]
    if len(known) == len(ratios):
        divisor = math.lcm(*(ratio.denominator for ratio in known))
        steps = math.lcm(*(ratio.numerator * (divisor // ratio.denominator) for ratio in known))
        if steps <= MOST_STEPS:
            return Rates(shortest / divisor, shortest / divisor * steps)
    raise InputError(
        f"diagram {diagram.name!r}: the sample times ({diagram.rates}) have no common period of at most {MOST_STEPS} steps; give"
        " them whole ratios"
    )


def whole_ratio(ratio: float) -> Fraction | None:
    """The ratio of two small whole numbers, or None."""
    found = Fraction(ratio).limit_denominator(MOST_STEPS)
    return found if abs(float(found) - ratio) <= WHOLE * ratio else None


def sampled_every(diagram: Diagram, port: str, period: float) -> bool:
    """True where digital blocks alone send the signal, or read it, every `period` seconds, straight or through gains."""
    times = digital_times(diagram)
    for ends in (_ends(diagram, port, forwards=False), _ends(diagram, port, forwards=True)):
        if ends and all(name in times and abs(times[name] - period) <= WHOLE * period for name in ends):
            return True
    return False


def sampled_signals(diagram: Diagram, period: float) -> list[str]:
    """The signals between blocks at which `sampled_every` holds."""
    return [port for port in dict.fromkeys(start for start, _ in diagram.connections) if sampled_every(diagram, port, period)]


def _ends(diagram: Diagram, port: str, *, forwards: bool) -> set[str]:
    """The blocks with a time of their own that the signal reaches, or comes from, straight or through gains."""
    wiring, names = diagram.wiring, list(diagram.blocks)
    ends, seen, waiting = set[str](), set[int](), [wiring.output_ports.index(port)]
    while waiting:
        y = waiting.pop()
        if y in seen:
            continue
        seen.add(y)
        blocks = [int(wiring.output_block[y])] if not forwards else wiring.input_block[wiring.source == y].tolist()
        for k in blocks:
            block = diagram.blocks[names[k]]
            if not isinstance(block, StateSpace) or block.n_states or is_sampled(block):
                ends.add(names[k])
            elif forwards:
                waiting += np.flatnonzero(wiring.output_block == k).tolist()
            else:
                waiting += [int(source) for source in wiring.source[wiring.input_block == k] if source != NONE]
    return ends


def expect_sampled(diagram: Diagram, signals: Iterable[str], rates: Rates) -> None:
    """InputError for signals at which a loop with digital blocks has no transfer function, naming those at which it has one."""
    for name in signals:
        if sampled_every(diagram, name, rates.period):
            continue
        known = sampled_signals(diagram, rates.period)
        where = f"break it at {', '.join(known)}" if known else "no signal is: give the blocks one sample time, or simulate"
        raise InputError(
            f"signal {name!r} is not sampled every {rates.period:.6g} s, the period of the loop ({diagram.rates}): broken there,"
            f" it varies in time and has no transfer function; {where}"
        )
