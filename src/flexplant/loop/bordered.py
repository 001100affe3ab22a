"""A linear diagram as one small matrix over s: unknown are ports, block states and undamped modes; damped modes are a response.

With static blocks eliminated, u the inputs of the others, x the states of state-space blocks and q the modes without damping:

    u - S y = E w,   (s I - A) x = B u,   (s^2 + omega^2) q = b u,
    y = [C x + D u;  P(s) u + (c0 + s c1 + s^2 c2) q],   z = R y + F w

so M(s) v = [E; 0; 0] w with v = [u; x; q]. P(s) is the sum over the damped modes, the only part that grows with the plant. M has
no poles but those of P, also at s = 0, where integrators and rigid-body modes make the transfer functions of blocks infinite.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.linalg

from flexplant.loop.diagram import Diagram, block_diagonal
from flexplant.model.arrays import FloatArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace, output_rows
from flexplant.plant.subset import with_modes

ComplexArray: TypeAlias = npt.NDArray[np.complex128]


@dataclass(frozen=True, eq=False, kw_only=True)
class Bordered:
    """The matrices of the module's equations; y holds the outputs of the state-space blocks, then those of the modal plants.

    S (nu, ny), E (nu, nw), R (nz, ny), F (nz, nw). A, B, C, D: all state-space blocks, block-diagonal, B and D over all of u.
    plants: the damped modes of each modal plant, with its direct terms; ports: (rows in y, columns in u) of each.
    omega: of the modes without damping; b (nq, nu); c0, c1, c2 (ny, nq).
    """

    S: FloatArray
    E: FloatArray
    R: FloatArray
    F: FloatArray
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    plants: tuple[ModalPlant, ...]
    ports: tuple[tuple[slice, slice], ...]
    omega: FloatArray
    b: FloatArray
    c0: FloatArray
    c1: FloatArray
    c2: FloatArray

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.S.shape[0] + self.A.shape[0] + self.omega.size)

    @property
    def order(self) -> int:
        """Degree of det M(s) that the unknowns x and q bring."""
        return int(self.A.shape[0] + 2 * self.omega.size)


def bordered(diagram: Diagram) -> Bordered:
    """The bordered form of a continuous linear diagram of state spaces and plants with modal damping."""
    wiring = diagram.wiring
    blocks = list(diagram.blocks.values())
    static = np.array([isinstance(block, StateSpace) and not block.n_states for block in blocks])
    modal = np.array([isinstance(block, ModalPlant) for block in blocks])
    order = [*np.flatnonzero(~static & ~modal), *np.flatnonzero(modal)]
    u = np.concatenate([np.zeros(0, int), *(np.flatnonzero(wiring.input_block == k) for k in order)])
    y = np.concatenate([np.zeros(0, int), *(np.flatnonzero(wiring.output_block == k) for k in order)])
    S, E, R, F = _without_static(diagram, static, u, y)
    spaces = [blocks[k] for k in order if not modal[k]]
    A, B, C, D = (block_diagonal([getattr(space, letter) for space in spaces]) for letter in "ABCD")
    plants = [blocks[k] for k in order if modal[k]]
    damped, loose, ports, at = [], [], [], (C.shape[0], B.shape[1])
    for plant in plants:
        assert isinstance(plant, ModalPlant)
        ports.append((slice(at[0], at[0] + len(plant.outputs)), slice(at[1], at[1] + len(plant.inputs))))
        at = ports[-1][0].stop, ports[-1][1].stop
        lasting = plant.zeta * plant.omega == 0
        damped.append(with_modes(plant, ~lasting))
        loose.append(replace(with_modes(plant, lasting), feedthrough=None, static_correction=None))
    wide = ((0, 0), (0, u.size - B.shape[1]))
    tall = ((0, y.size - C.shape[0]), (0, 0))
    rows = [_rows(plant) for plant in loose]
    return Bordered(
        S=S, E=E, R=R, F=F, A=A, B=np.pad(B, wide), C=np.pad(C, tall), D=np.pad(D, (tall[0], wide[1])),
        plants=tuple(damped), ports=tuple(ports),
        omega=np.concatenate([np.zeros(0), *(plant.omega for plant in loose)]),
        b=_stacked([plant.shape_in for plant in loose], (0, B.shape[1])),
        c0=_stacked([r[0] for r in rows], (C.shape[0], 0)),
        c1=_stacked([r[1] for r in rows], (C.shape[0], 0)),
        c2=_stacked([r[2] for r in rows], (C.shape[0], 0)),
    )  # fmt: skip


def _without_static(
    diagram: Diagram, static: npt.NDArray[np.bool_], u: npt.NDArray[np.int64], y: npt.NDArray[np.int64]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """S, E, R, F over the inputs u and outputs y of the blocks that are not static: what static blocks pass on is put in."""
    wiring = diagram.wiring
    through = np.where(static[wiring.output_block][:, None], diagram.feedthrough, 0.0)
    all_inputs = np.linalg.solve(np.eye(len(wiring.input_ports)) - wiring.internal @ through, np.eye(len(wiring.input_ports)))
    S, E = all_inputs @ wiring.internal[:, y], all_inputs @ wiring.entry
    read = np.eye(len(wiring.output_ports))[wiring.readout]
    return S[u], E[u], read[:, y] + read @ through @ S, read @ through @ E


def _rows(plant: ModalPlant) -> tuple[FloatArray, FloatArray, FloatArray]:
    zero = np.zeros((len(plant.outputs), plant.n_modes))
    kinds = (plant.shape_out, plant.shape_out_velocity, plant.shape_out_acceleration)
    c0, c1, c2 = (zero if shapes is None else shapes for shapes in kinds)
    return c0, c1, c2


def _stacked(matrices: list[FloatArray], before: tuple[int, int]) -> FloatArray:
    """Block diagonal, after an empty block of the given shape."""
    return np.asarray(scipy.linalg.block_diag(np.zeros(before), *matrices), dtype=float)


def direct_of(plant: ModalPlant) -> FloatArray:
    """(ny, nu) response at infinite frequency."""
    return output_rows(plant)[2]
