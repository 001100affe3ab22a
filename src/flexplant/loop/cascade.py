"""A linear system split for fast stepping: modes that only listen to the outside, feeding a small dense rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexplant.errors import InputError
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.wiring import NONE
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace, output_rows, state_space

Simulated = Diagram | StateSpace | ModalPlant | Descriptor


@dataclass(frozen=True, eq=False, kw_only=True)
class Cascade:
    """eta'' + 2 zeta omega eta' + omega^2 eta = shape_in w;  l' = A l + P eta + V eta' + B w;  z = Cp eta + Cv eta' + C l + D w.

    n modes, m other states, nw inputs, nz outputs. from_modes = [P, V] (m, 2n), C_modes = [Cp, Cv] (nz, 2n).
    modal_states (2n,), other_states (m,): where eta, eta' and l stand in the state vector of `close` or `state_space`.
    dt: seconds for a discrete system, which has no modes here (l[k+1] = A l[k] + B w[k]); None in continuous time.
    """

    omega: FloatArray
    zeta: FloatArray
    shape_in: FloatArray
    A: FloatArray
    from_modes: FloatArray
    B: FloatArray
    C_modes: FloatArray
    C: FloatArray
    D: FloatArray
    modal_states: IntArray
    other_states: IntArray
    dt: float | None = None

    @property
    def n_states(self) -> int:
        """2 n + m."""
        return self.modal_states.size + self.other_states.size


def cascade_of(system: Simulated) -> Cascade:
    """The split of a plant, block or diagram; what cannot be split (feedback into a plant, full modal damping) goes to the rest.

    Exact: only rows and columns are sorted. Raises InputError for a type that cannot be simulated.
    """
    if isinstance(system, ModalPlant) and system.damping is None:
        return _of_modal(system)
    if isinstance(system, Diagram):
        return _split(close(system), _listening_plants(system))
    return _split(state_space(simulated(system)), [])


def simulated(system: Any) -> Any:
    """The system itself; InputError for a type that cannot be simulated."""
    if not isinstance(system, Diagram | ModalPlant | StateSpace | Descriptor):
        raise InputError(
            f"cannot simulate a {type(system).__name__}; use a Diagram, a ModalPlant or a StateSpace (see state_space)"
        )
    return system


def _of_modal(plant: ModalPlant) -> Cascade:
    position, velocity, D = output_rows(plant)
    n, nw = plant.shape_in.shape
    return Cascade(
        omega=plant.omega,
        zeta=plant.zeta,
        shape_in=plant.shape_in,
        A=np.zeros((0, 0)),
        from_modes=np.zeros((0, 2 * n)),
        B=np.zeros((0, nw)),
        C_modes=np.hstack([position, velocity]),
        C=np.zeros((D.shape[0], 0)),
        D=D,
        modal_states=np.arange(2 * n),
        other_states=np.zeros(0, dtype=np.int64),
    )


def _listening_plants(diagram: Diagram) -> list[tuple[ModalPlant, int]]:
    """Modal plants whose every input comes straight from outside, with the place of their first state."""
    found, first = [], 0
    for k, block in enumerate(diagram.blocks.values()):
        if not isinstance(block, ModalPlant):
            first += block.n_states
            continue
        outside = (diagram.wiring.source[diagram.wiring.input_block == k] == NONE).all()
        if outside and block.damping is None:
            found.append((block, first))
        first += 2 * block.n_modes
    return found


def _split(system: StateSpace, plants: list[tuple[ModalPlant, int]]) -> Cascade:
    none = np.zeros(0, dtype=np.int64)
    position = np.concatenate([none, *(first + np.arange(p.n_modes) for p, first in plants)])
    velocity = np.concatenate([none, *(first + p.n_modes + np.arange(p.n_modes) for p, first in plants)])
    modal = np.r_[position, velocity]
    other = np.setdiff1d(np.arange(system.n_states), modal)
    return Cascade(
        omega=np.concatenate([np.zeros(0), *(p.omega for p, _ in plants)]),
        zeta=np.concatenate([np.zeros(0), *(p.zeta for p, _ in plants)]),
        shape_in=system.B[velocity],
        A=system.A[np.ix_(other, other)],
        from_modes=system.A[np.ix_(other, modal)],
        B=system.B[other],
        C_modes=system.C[:, modal],
        C=system.C[:, other],
        D=system.D,
        modal_states=modal,
        other_states=other,
        dt=system.dt,
    )
