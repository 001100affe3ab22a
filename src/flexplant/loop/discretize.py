"""Plants, blocks and whole diagrams as one discrete state space, exact for inputs held, or straight, between samples."""

from __future__ import annotations

from flexplant.errors import InputError
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.hybrid import hybrid_of
from flexplant.loop.period_map import period_map
from flexplant.loop.rates import WHOLE, digital_times, rates_of
from flexplant.plant import discretize as plants
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace


def discretize(plant: ModalPlant | StateSpace | Descriptor | Diagram, dt: float, *, hold: str = "zero") -> StateSpace:
    """The plant or diagram sampled every dt seconds, exact for inputs constant ("zero") or linear ("first") in between.

    Plants and blocks: see `flexplant.plant.discretize.discretize`. A diagram becomes one discrete state space from its inputs to
    its outputs: its continuous blocks move exactly under digital blocks that read at their samples and hold in between, as in
    `simulate`. dt is a whole multiple of the time after which the samples of all digital blocks repeat: of their one sample
    time, or of the common period of several (2 and 3 ms repeat every 6 ms; then only the first sample of each period is seen).
    States: the continuous blocks' in the order of `close`, then the digital blocks'; with "first" less G1 u, as for plants.
    Raises InputError for dt <= 0, an unknown hold, a plant that is discrete already, and a dt that is no such multiple, naming
    the rates; DiagramError for nonlinear blocks, and for digital blocks in a loop without a delay.
    """
    if not isinstance(plant, Diagram):
        return plants.discretize(plant, dt, hold=hold)
    dt = plants.checked_dt(dt)
    plants.check_hold(hold)
    steps, base = _steps(plant, dt)
    if plant.dt is not None and steps == 1:
        return close(plant)
    hybrid = hybrid_of(plant)
    found = period_map(hybrid, base, steps, hold)
    F, G, D = found.F, found.held, found.D
    if hold == "first":
        G, D = G + F @ found.ramp - found.ramp, D + found.C @ found.ramp
    return StateSpace(
        F,
        G,
        found.C,
        D,
        list(plant.inputs),
        list(plant.outputs),
        dt=dt,
        name=plant.name,
        input_units=plant.input_units,
        output_units=plant.output_units,
    )


def _steps(diagram: Diagram, dt: float) -> tuple[int, float]:
    """Base steps in dt and their length; InputError for a dt after which the samples do not repeat."""
    rates = rates_of(diagram)
    if rates is None:
        return 1, dt
    periods = round(dt / rates.period)
    if periods >= 1 and abs(periods * rates.period - dt) <= WHOLE * rates.period:
        return periods * rates.steps, rates.base
    several = len(set(digital_times(diagram).values())) > 1
    what = f"the samples of its blocks ({diagram.rates}) repeat every {rates.period:.9g} s"
    reason = "their common period" if several else "that time"
    raise InputError(
        f"discretize: dt = {dt:.9g} s, but {what}: between them the diagram varies in time and has no state space; use a whole"
        f" multiple of {reason}, or simulate it at a finer step"
    )
