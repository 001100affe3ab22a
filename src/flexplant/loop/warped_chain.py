"""A sampled `Chain` over the warped frequency: a modal plant, and small systems ahead of it and behind it."""

from __future__ import annotations

from collections.abc import Container
from typing import NamedTuple

import numpy as np
import scipy.linalg

from flexplant.loop.chain import Chain
from flexplant.loop.chain_step import ChainStep
from flexplant.loop.ports import Block
from flexplant.loop.warped_modes import warped_modes, warped_plant, warped_space
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.plant.discretize import mode_steps
from flexplant.plant.state_space import StateSpace


class Pieces(NamedTuple):
    """Blocks and the wires between them; the ports that each input of the chain drives, and the port behind each output."""

    blocks: dict[str, Block]
    wires: list[tuple[str, str]]
    entries: list[list[str]]
    exits: list[str]


def free_name(wanted: str, taken: Container[str]) -> str:
    """The name, with underscores behind it until it is not taken."""
    while wanted in taken:
        wanted += "_"
    return wanted


def warped_chain(chain: Chain, step: ChainStep, dt: float, taken: Container[str], *, minimal: bool) -> Pieces:
    """The chain after one step of held inputs, as blocks over w whose names are not taken yet; minimal: see `_modal`."""
    plant = free_name("modes", taken)
    ma, mb, nw, nz = len(chain.ahead), len(chain.behind), chain.B_ahead.shape[1], len(chain.D)
    if not ma and not mb and nz and chain.force.size and chain.force.any(axis=0).all():
        held = mode_steps(chain.omega, chain.zeta, dt, "zero").hold
        whole = warped_plant(warped_modes(chain.omega, chain.zeta, dt), chain.C_modes, held, chain.force, chain.D)
        return Pieces({plant: whole}, [], [[f"{plant}.u{k}"] for k in range(nw)], [f"{plant}.y{k}" for k in range(nz)])
    rows = np.concatenate([chain.C_modes, step.from_modes])
    seen, driving = np.flatnonzero(rows.any(axis=(1, 2))), np.flatnonzero(step.modes_from.any(axis=(0, 1)))
    modal: dict[str, Block] = {}
    if seen.size and driving.size:
        modal = {free_name(name, taken): block for name, block in _modal(chain, step, dt, rows[seen], driving, minimal).items()}
    behind, direct = free_name("behind", taken), np.hstack([chain.C_ahead, chain.D])
    through = np.flatnonzero(step.behind_from.any(axis=0) | direct.any(axis=0))
    blocks = modal | {behind: _behind(chain, step, list(modal), seen, through, dt)}
    wires = [(f"{name}.y{k}", f"{behind}.{name} y{k}") for name in modal for k in range(seen.size)]
    drives = [[f"{name}.u{j}" for name in modal for j in np.flatnonzero(driving == k)] for k in range(ma + nw)]
    for k in through:
        drives[k].append(f"{behind}.g{k}")
    if ma:
        ahead, entering = free_name("ahead", taken), np.flatnonzero(step.ahead[:, ma:].any(axis=0))
        names = [f"g{k}" for k in range(ma)], [f"w{k}" for k in entering]
        system = StateSpace(
            step.ahead[:, :ma], step.ahead[:, ma + entering], np.eye(ma), np.zeros((ma, entering.size)), names[1], names[0], dt=dt
        )
        blocks[ahead] = warped_space(system, dt)
        wires += [(f"{ahead}.g{k}", port) for k in range(ma) for port in drives[k]]
        for k in entering:
            drives[ma + k].append(f"{ahead}.w{k}")
    return Pieces(blocks, wires, drives[ma:], [f"{behind}.z{k}" for k in range(nz)])


def _modal(chain: Chain, step: ChainStep, dt: float, rows: FloatArray, driving: IntArray, minimal: bool) -> dict[str, Block]:
    """The modes, from g[driving] to the given rows.

    A mode that is driven by other states, too, receives in its displacement and its velocity what has no fixed ratio: it then
    stands for two modes of one input each. minimal: modes without damping, of which a second one would be a pole on the axis
    that no loop moves, become a state space.
    """
    given = step.modes_from[:, :, driving]
    nothing = np.zeros((len(rows), driving.size))
    if not len(chain.ahead):
        held = mode_steps(chain.omega, chain.zeta, dt, "zero").hold
        modes = warped_modes(chain.omega, chain.zeta, dt)
        return {"modes": warped_plant(modes, rows, held, chain.force[:, driving], nothing)}
    damped = (chain.zeta * chain.omega > 0) | (not minimal)
    out: dict[str, Block] = {}
    if damped.any():
        held = np.repeat(np.eye(2), int(damped.sum()), axis=0)
        modes = warped_modes(np.tile(chain.omega[damped], 2), np.tile(chain.zeta[damped], 2), dt)
        force = np.concatenate([given[damped, 0], given[damped, 1]])
        out["modes"] = warped_plant(modes, np.tile(rows[:, :, damped], 2), held, force, nothing)
    if not damped.all():
        system = StateSpace(
            scipy.linalg.block_diag(*step.modes[~damped]),
            given[~damped].reshape(-1, driving.size),
            np.moveaxis(rows[:, :, ~damped], 1, 2).reshape(len(rows), -1),
            nothing,
            [f"u{k}" for k in range(driving.size)],
            [f"y{k}" for k in range(len(rows))],
            dt=dt,
            name="undamped modes",
        )
        out["undamped"] = warped_space(system, dt)
    return out


def _behind(chain: Chain, step: ChainStep, modal: list[str], seen: IntArray, through: IntArray, dt: float) -> StateSpace:
    """b, driven by the rows that see the modes and by g[through], and the outputs."""
    nz, mb = len(chain.D), len(chain.behind)
    unit = np.tile(np.eye(nz + mb)[:, seen], len(modal))
    direct = np.hstack([chain.C_ahead, chain.D])[:, through]
    system = StateSpace(
        chain.behind[:0, :0] if not mb else step.behind,
        np.hstack([unit[nz:], step.behind_from[:, through]]),
        chain.C_behind,
        np.hstack([unit[:nz], direct]),
        [f"{name} y{k}" for name in modal for k in range(seen.size)] + [f"g{k}" for k in through],
        [f"z{k}" for k in range(nz)],
        dt=dt,
        name="continuous part",
    )
    return warped_space(system, dt)
