"""Refusing unstable systems where a steady state is asked for, by the pole that grows."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from flexplant.errors import InputError
from flexplant.loop.bordered import bordered
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.frequency import Linear
from flexplant.loop.norms import has_bordered_form, loop_axes
from flexplant.loop.stability import stability
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace

ROUND_OFF = 1e-7  # real part relative to the largest pole, up to which a pole counts as on the axis (rigid-body modes do)


def refuse_unstable(system: Linear, what: str) -> None:
    """InputError with the pole (rad/s) for an unstable block or diagram; poles on the axis pass, and descriptors unseen."""
    if isinstance(system, Descriptor | ModalPlant):
        return
    if isinstance(system, Diagram) and has_bordered_form(system):
        explanation = stability(loop_axes(bordered(system))).explanation
        if "unstable" in explanation:
            raise InputError(f"{what}: {explanation}; there is no steady state")
        return
    _refuse_dense(close(system) if isinstance(system, Diagram) else system, what)


def _refuse_dense(system: StateSpace, what: str) -> None:
    poles = np.linalg.eigvals(system.A) if system.n_states else np.zeros(0)
    refuse_growing(np.asarray(poles, dtype=complex), system.dt, system.name, what)


def refuse_growing(poles: npt.NDArray[np.complex128], dt: float | None, name: str, what: str) -> None:
    """InputError with the pole that grows, of a system known by its poles (rad/s; z of a discrete one)."""
    if not poles.size:
        return
    growth = poles.real / max(float(abs(poles).max()), 1e-300) if dt is None else abs(poles) - 1
    if growth.max() > ROUND_OFF:
        worst = complex(poles[int(growth.argmax())])
        where = f"{worst:.6g} rad/s" if dt is None else f"z = {worst:.6g}"
        raise InputError(f"{what}: {name!r} is unstable, with a pole at {where}; there is no steady state")
