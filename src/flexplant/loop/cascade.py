"""A linear system split for fast stepping: modes that only listen to the outside, feeding a small dense rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

from flexplant.blocks.sampled import SampledBlock
from flexplant.errors import InputError
from flexplant.loop.close import linear_only, solved_wires
from flexplant.loop.diagram import Diagram, block_diagonal
from flexplant.loop.wiring import NONE
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace, output_rows, state_space

Simulated = Diagram | StateSpace | ModalPlant | Descriptor


@dataclass(frozen=True, eq=False, kw_only=True)
class Inner:
    """A modal plant among the other states, eta then eta' from the state `first` on. fed_back: (n, .) shapes of driven inputs."""

    first: int
    omega: FloatArray
    zeta: FloatArray
    fed_back: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Cascade:
    """eta'' + 2 zeta omega eta' + omega^2 eta = shape_in w;  l' = A l + P eta + V eta' + B w;  z = Cp eta + Cv eta' + C l + D w.

    n modes, m other states, nw inputs, nz outputs. from_modes = [P, V] (m, 2n), C_modes = [Cp, Cv] (nz, 2n).
    modal_states (2n,), other_states (m,): where eta, eta' and l stand in the state vector of `close` or `state_space`.
    dt: seconds for a discrete system, which has no modes here (l[k+1] = A l[k] + B w[k]); None in continuous time.
    inner: the modal plants that other blocks drive; their states are other states.
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
    inner: tuple[Inner, ...] = ()

    @property
    def n_states(self) -> int:
        """2 n + m."""
        return self.modal_states.size + self.other_states.size

    @cached_property
    def derived(self) -> dict[str, Any]:
        """What simulations made of this cascade, by names."""
        return {}


def cascade_of(system: Simulated) -> Cascade:
    """The split of a plant, block or diagram; what cannot be split (feedback into a plant, full modal damping) goes to the rest.

    Exact: only rows and columns are sorted. Raises InputError for a type that cannot be simulated.
    """
    if isinstance(system, ModalPlant) and system.damping is None:
        return _of_modal(system)
    if isinstance(system, Diagram):
        if "cascade" not in system.derived:
            system.derived["cascade"] = _of_diagram(system)
        return cast(Cascade, system.derived["cascade"])
    return _undivided(state_space(simulated(system)))


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


def _of_diagram(diagram: Diagram) -> Cascade:
    """Modal plants whose every input comes straight from outside are the modes; only the other blocks are closed.

    With their outputs y1 = P [eta, eta'] + D1 w, the others have u = S y + S1 y1 + E w (see `close`).
    """
    linear_only(diagram)
    wiring, blocks = diagram.wiring, list(diagram.blocks.values())
    listening = [k for k, block in enumerate(blocks) if _listens(diagram, block, k)]
    mine_in, mine_out = np.isin(wiring.input_block, listening), np.isin(wiring.output_block, listening)
    plants = [block for k, block in enumerate(blocks) if k in listening and isinstance(block, ModalPlant)]
    others = [state_space(b) for k, b in enumerate(blocks) if k not in listening and not isinstance(b, SampledBlock)]
    A, B, C, D = (block_diagonal([getattr(s, letter) for s in others]) for letter in "ABCD")
    rows = [output_rows(plant) for plant in plants]
    seen = np.hstack([block_diagonal([r[k] for r in rows]) for k in (0, 1)])
    outside, E = wiring.entry[mine_in], wiring.entry[~mine_in]
    direct = block_diagonal([r[2] for r in rows]) @ outside
    S, S1 = (wiring.internal[np.ix_(~mine_in, which)] for which in (~mine_out, mine_out))
    u = solved_wires(diagram, S @ D, np.hstack([S @ C, S1 @ seen, E + S1 @ direct]))
    y_of = np.zeros((wiring.output_block.size, u.shape[1]))
    y_of[~mine_out] = D @ u
    m, n = A.shape[0], seen.shape[1]
    y_of[~mine_out, :m] += C
    y_of[mine_out, m : m + n], y_of[mine_out, m + n :] = seen, direct
    driven, z = B @ u, y_of[wiring.readout]
    return Cascade(
        omega=np.concatenate([np.zeros(0), *(p.omega for p in plants)]),
        zeta=np.concatenate([np.zeros(0), *(p.zeta for p in plants)]),
        shape_in=block_diagonal([p.shape_in for p in plants]) @ outside,
        A=A + driven[:, :m],
        from_modes=driven[:, m : m + n],
        B=driven[:, m + n :],
        C_modes=z[:, m : m + n],
        C=z[:, :m],
        D=z[:, m + n :],
        **_places(diagram, listening),
        dt=diagram.dt,
        inner=_inner(diagram, listening),
    )


def _inner(diagram: Diagram, listening: list[int]) -> tuple[Inner, ...]:
    wiring, out, first = diagram.wiring, [], 0
    for k, block in enumerate(diagram.blocks.values()):
        if k in listening or isinstance(block, SampledBlock):
            continue
        if isinstance(block, ModalPlant):
            driven = wiring.source[wiring.input_block == k] != NONE
            if block.damping is None:
                out.append(Inner(first=first, omega=block.omega, zeta=block.zeta, fed_back=block.shape_in[:, driven]))
            first += 2 * block.n_modes
        else:
            first += block.n_states
    return tuple(out)


def _listens(diagram: Diagram, block: Any, k: int) -> bool:
    """True for a modal plant that no other block drives."""
    wiring = diagram.wiring
    uncoupled = isinstance(block, ModalPlant) and block.damping is None
    return uncoupled and bool((wiring.source[wiring.input_block == k] == NONE).all())


def closed_states(diagram: Diagram) -> int:
    """The states of a linear diagram that become the dense rest of its cascade."""
    linear_only(diagram)
    rest = [block for k, block in enumerate(diagram.blocks.values()) if not _listens(diagram, block, k)]
    return sum(2 * b.n_modes if isinstance(b, ModalPlant) else b.n_states for b in rest if not isinstance(b, SampledBlock))


def _places(diagram: Diagram, listening: list[int]) -> dict[str, IntArray]:
    """Where the states of the listening plants, displacements before velocities, and the other states stand."""
    position, velocity, other, first = [], [], [], 0
    for k, block in enumerate(diagram.blocks.values()):
        n = 2 * block.n_modes if isinstance(block, ModalPlant) else block.n_states
        states = np.arange(first, first + n)
        if k in listening:
            position.append(states[: n // 2])
            velocity.append(states[n // 2 :])
        else:
            other.append(states)
        first += n
    none = np.zeros(0, dtype=np.int64)
    return {"modal_states": np.concatenate([none, *position, *velocity]), "other_states": np.concatenate([none, *other])}


def _undivided(system: StateSpace) -> Cascade:
    """Without modes."""
    nw, nz, m = system.B.shape[1], system.C.shape[0], system.n_states
    none = np.zeros(0)
    return Cascade(
        omega=none,
        zeta=none,
        shape_in=np.zeros((0, nw)),
        A=system.A,
        from_modes=np.zeros((m, 0)),
        B=system.B,
        C_modes=np.zeros((nz, 0)),
        C=system.C,
        D=system.D,
        modal_states=none.astype(np.int64),
        other_states=np.arange(m),
        dt=system.dt,
    )
