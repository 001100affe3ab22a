"""One exact step of a `Chain` under inputs that are held between samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from flexplant.loop.chain import Chain
from flexplant.model.arrays import FloatArray
from flexplant.plant.discretize import balanced_expm, mode_steps, mode_transitions, stacked_expm


@dataclass(frozen=True, eq=False, kw_only=True)
class ChainStep:
    """The chain one step later, with g = [a; w].

    a+ = ahead g
    [eta; eta']+ = modes [eta; eta'] + modes_from g                   (n, 2, 2), (n, 2, ng)
    b+ = behind b + from_modes [eta; eta'] + behind_from g            (mb, mb), (mb, 2, n), (mb, ng)
    """

    ahead: FloatArray
    modes: FloatArray
    modes_from: FloatArray
    behind: FloatArray
    from_modes: FloatArray
    behind_from: FloatArray


def chain_step(chain: Chain, dt: float) -> ChainStep:
    """The step of dt seconds: exponentials of [g; one mode; b], one a mode and all at once, and one without modes.

    A mode's share of what b receives over the step is linear in that mode, so the shares of all modes are added.
    """
    ma, nw = chain.B_ahead.shape
    mb, ng = len(chain.behind), ma + nw
    small = np.zeros((ng + mb, ng + mb))
    small[:ma, :ng] = np.hstack([chain.ahead, chain.B_ahead])
    small[ng:, :ng], small[ng:, ng:] = np.hstack([chain.from_ahead, chain.B_behind]), chain.behind
    e = balanced_expm(small * dt)
    modes_from, from_modes, behind_from = _through(chain, small[:ng, :ng], dt) if ma else _by_force(chain, dt)
    return ChainStep(
        ahead=e[:ma, :ng],
        modes=mode_transitions(chain.omega, chain.zeta, dt),
        modes_from=modes_from,
        behind=e[ng:, ng:],
        from_modes=from_modes,
        behind_from=e[ng:, :ng] + behind_from,
    )


def _by_force(chain: Chain, dt: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Without a: a mode moves by one number, its force."""
    n, mb = chain.omega.size, len(chain.behind)
    held = mode_steps(chain.omega, chain.zeta, dt, "zero").hold
    modes_from = held[:, :, None] * chain.force[:, None, :]
    if not mb or not n:
        return modes_from, np.zeros((mb, 2, n)), np.zeros((mb, chain.force.shape[1]))
    _, from_modes, each = _exponentials(chain, np.zeros((1, 1)), np.ones((n, 1)), dt)
    return modes_from, from_modes, each[:, :, 0].T @ chain.force


def _through(chain: Chain, source: FloatArray, dt: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    modes_from, from_modes, each = _exponentials(chain, source, chain.force, dt)
    return modes_from, from_modes, each.sum(axis=0)


def _exponentials(chain: Chain, source: FloatArray, force: FloatArray, dt: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(n, 2, ng), (mb, 2, n), (n, mb, ng) of g' = source g, a mode under the force [n, ng] g, and b behind it.

    States of the exponential: g and b balanced, s eta and dt eta' with s = max(1, omega dt): its norm stays near omega dt.
    A mode's force and what it gives to b are divided by their sizes first (the result is linear in them).
    """
    n, ng, mb = chain.omega.size, len(source), len(chain.behind)
    g, of_g = _balanced(source * dt)
    b, of_b = _balanced(chain.behind * dt)
    x = chain.omega * dt
    s = np.maximum(1.0, x)
    unit = np.stack([1 / s, np.full(n, 1 / dt)])
    into, out = force * of_g, chain.from_modes * unit * dt / of_b[:, None, None]
    sizes = [np.maximum(abs(part).max(axis=along, initial=0.0), 1e-300) for part, along in ((into, 1), (out, (0, 1)))]
    matrix = np.zeros((n, ng + 2 + mb, ng + 2 + mb))
    matrix[:, :ng, :ng], matrix[:, ng + 2 :, ng + 2 :] = g, b
    matrix[:, ng, ng + 1], matrix[:, ng + 1, ng], matrix[:, ng + 1, ng + 1] = s, -(x**2) / s, -2 * chain.zeta * x
    matrix[:, ng + 1, :ng] = into / sizes[0][:, None]
    matrix[:, ng + 2 :, ng : ng + 2] = np.moveaxis(out / sizes[1], 2, 0)
    e = stacked_expm(matrix)
    entered = sizes[0] * dt**2
    modes_from = e[:, ng : ng + 2, :ng] * (entered * unit).T[:, :, None] / of_g
    from_modes = np.moveaxis(e[:, ng + 2 :, ng : ng + 2], 0, 2) * (sizes[1] / unit) * of_b[:, None, None]
    each = e[:, ng + 2 :, :ng] * (entered * sizes[1])[:, None, None] * of_b[:, None] / of_g
    return modes_from, from_modes, each


def _balanced(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The matrix in states x / scale, and the scale; states that nothing drives are scaled to drive others by one at most."""
    if not matrix.size:
        return matrix, np.ones(len(matrix))
    balanced, (scale, _) = scipy.linalg.matrix_balance(matrix, permute=False, separate=True)
    constant = ~balanced.any(axis=1)
    largest = abs(balanced).max(axis=0)
    scale = np.where(constant & (largest > 0), scale / np.where(largest > 0, largest, 1.0), scale)
    return matrix * scale / scale[:, None], scale
