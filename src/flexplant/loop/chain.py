"""A linear continuous diagram as a chain: small systems that drive modes, the modes, and small systems that they drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexplant.blocks.sampled import SampledBlock
from flexplant.loop.close import linear_only, solved_wires
from flexplant.loop.diagram import Diagram, block_diagonal
from flexplant.loop.wiring import NONE
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, output_rows, state_space

BoolArray = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


@dataclass(frozen=True, eq=False, kw_only=True)
class Chain:
    """With x = [a; eta; eta'; b], the inputs w and the outputs z:

        a' = ahead a + B_ahead w
        eta'' + 2 zeta omega eta' + omega^2 eta = force [a; w]
        b' = behind b + from_ahead a + from_modes [eta; eta'] + B_behind w
        z = C_ahead a + C_modes [eta; eta'] + C_behind b + D w

    n modes, ma and mb other states. from_modes: (mb, 2, n), C_modes: (nz, 2, n). places: where a, [eta; eta'] and b stand among
    the states of `close`.
    """

    omega: FloatArray
    zeta: FloatArray
    ahead: FloatArray
    behind: FloatArray
    force: FloatArray
    from_ahead: FloatArray
    from_modes: FloatArray
    B_ahead: FloatArray
    B_behind: FloatArray
    C_ahead: FloatArray
    C_modes: FloatArray
    C_behind: FloatArray
    D: FloatArray
    places: tuple[IntArray, IntArray, IntArray]

    @property
    def n_states(self) -> int:
        """ma + 2 n + mb."""
        return sum(place.size for place in self.places)


def chain_of(diagram: Diagram) -> Chain:
    """The chain of a diagram of continuous blocks; exact, only rows and columns are sorted.

    Modal plants inside a feedback of continuous blocks, and those that drive other modal plants, count as small systems: their
    modes are not those of the loop.
    """
    linear_only(diagram)
    blocks = [block for block in diagram.blocks.values() if not isinstance(block, SampledBlock)]
    reach = _reached(diagram)
    kept = _kept(blocks, reach)
    ahead = [k for k in range(len(blocks)) if k not in kept and reach[k, kept].any()]
    behind = [k for k in range(len(blocks)) if k not in kept and k not in ahead]
    spaces = [None if k in kept else state_space(block) for k, block in enumerate(blocks)]
    plants = {k: block for k, block in enumerate(blocks) if k in kept and isinstance(block, ModalPlant)}
    sizes = [2 * plants[k].n_modes if space is None else space.n_states for k, space in enumerate(spaces)]
    first = np.cumsum([0, *sizes])
    C, D = _outputs(spaces, plants)
    S, E = diagram.wiring.internal, diagram.wiring.entry
    u = solved_wires(diagram, S @ D, np.hstack([S @ C, E]))
    y = D @ u
    y[:, : first[-1]] += C
    z = y[diagram.wiring.readout]
    a, b = (_states(first, which) for which in (ahead, behind))
    modes = _modal_states(first, plants)
    w = np.arange(first[-1], u.shape[1])
    A = _driven(spaces, diagram.wiring.input_block, u, first)
    shapes = block_diagonal([plants[k].shape_in for k in kept])
    pushed = shapes @ u[np.concatenate([np.flatnonzero(diagram.wiring.input_block == k) for k in kept] or [w[:0]])]
    n = len(shapes)
    return Chain(
        omega=np.concatenate([np.zeros(0), *(plants[k].omega for k in kept)]),
        zeta=np.concatenate([np.zeros(0), *(plants[k].zeta for k in kept)]),
        ahead=A[np.ix_(a, a)],
        behind=A[np.ix_(b, b)],
        force=pushed[:, np.r_[a, w]],
        from_ahead=A[np.ix_(b, a)],
        from_modes=A[np.ix_(b, modes)].reshape(b.size, 2, n),
        B_ahead=A[np.ix_(a, w)],
        B_behind=A[np.ix_(b, w)],
        C_ahead=z[:, a],
        C_modes=z[:, modes].reshape(len(z), 2, n),
        C_behind=z[:, b],
        D=z[:, w],
        places=(a, modes, b),
    )


def _reached(diagram: Diagram) -> BoolArray:
    """(blocks, blocks) True where a signal gets from one block to another, or back to itself."""
    wiring, n = diagram.wiring, len(diagram.blocks)
    reach = np.zeros((n, n), dtype=bool)
    driven = np.flatnonzero(wiring.source != NONE)
    reach[wiring.output_block[wiring.source[driven]], wiring.input_block[driven]] = True
    for k in range(n):
        reach |= reach[:, [k]] & reach[[k], :]
    return reach


def _kept(blocks: list[StateSpace | ModalPlant], reach: BoolArray) -> list[int]:
    """The modal plants that stay modal, the largest first, in the order of the diagram.

    None where one exponential of everything costs less than one a mode, of the mode and all small systems.
    """
    plants = {k: b.n_modes for k, b in enumerate(blocks) if isinstance(b, ModalPlant) and b.damping is None and b.n_modes}
    kept: list[int] = []
    for k in sorted(plants, key=lambda k: -plants[k]):
        if not reach[k, k] and not reach[k, kept].any() and not reach[kept, k].any():
            kept.append(k)
    n = sum(plants[k] for k in kept)
    small = sum(2 * b.n_modes if isinstance(b, ModalPlant) else b.n_states for b in blocks) - 2 * n
    return sorted(kept) if n * (small + 2) ** 3 <= (2 * n + small) ** 3 else []


def _outputs(spaces: list[StateSpace | None], plants: dict[int, ModalPlant]) -> tuple[FloatArray, FloatArray]:
    """Block-diagonal C and D, with [eta; eta'] as the states of a modal plant."""
    rows = [(space.C, space.D) if space is not None else _modal_rows(plants[k]) for k, space in enumerate(spaces)]
    return block_diagonal([C for C, _ in rows]), block_diagonal([D for _, D in rows])


def _modal_rows(plant: ModalPlant) -> tuple[FloatArray, FloatArray]:
    position, velocity, D = output_rows(plant)
    return np.hstack([position, velocity]), D


def _states(first: IntArray, which: list[int]) -> IntArray:
    return np.concatenate([np.zeros(0, dtype=np.int64), *(np.arange(first[k], first[k + 1]) for k in which)])


def _modal_states(first: IntArray, plants: dict[int, ModalPlant]) -> IntArray:
    """All displacements, then all velocities."""
    none = np.zeros(0, dtype=np.int64)
    halves = [np.split(np.arange(first[k], first[k + 1]), 2) for k in plants]
    return np.concatenate([none, *(half[0] for half in halves), *(half[1] for half in halves)])


def _driven(spaces: list[StateSpace | None], input_block: IntArray, u: FloatArray, first: IntArray) -> FloatArray:
    """(states, states + nw) rows A x + B u of the small systems; zero for the modes."""
    out = np.zeros((int(first[-1]), u.shape[1]))
    for k, space in enumerate(spaces):
        if space is not None and space.n_states:
            mine = slice(int(first[k]), int(first[k + 1]))
            out[mine] = space.B @ u[input_block == k]
            out[mine, mine] += space.A
    return out
