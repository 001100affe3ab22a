"""Large state spaces in a diagram as their own modes, on which sums, bounds and winding numbers run fast, and a small rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg

from flexplant.loop.diagram import Diagram
from flexplant.loop.diagram_response import ComplexArray
from flexplant.loop.ports import Block
from flexplant.loop.warped_chain import free_name
from flexplant.model.arrays import FloatArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace

LARGE = 100  # states from which a block is split
MOST_REST = 40  # states that are not modes, up to which splitting pays
DAMPED = 1e-9  # least damping ratio of a mode
WELL_CONDITIONED = 1e5  # eigenvectors up to which the sums of modes keep about eleven digits


def with_modes_apart(diagram: Diagram) -> Diagram:
    """The same continuous diagram; each large state space now adds the outputs of a modal plant, driven as it is, to its own."""
    parts = {name: modes_and_rest(block) for name, block in diagram.blocks.items() if isinstance(block, StateSpace)}
    found = {name: part for name, part in parts.items() if part is not None}
    if not found:
        return diagram
    blocks: dict[str, Block] = dict(diagram.blocks)
    wires, inputs = list(diagram.connections), {name: list(ports) for name, ports in diagram.inputs.items()}
    for name, (plant, rest) in found.items():
        modes = free_name(f"{name} modes", blocks)
        blocks |= {name: rest, modes: plant}
        also = {f"{name}.{port}": f"{modes}.{port}" for port in plant.inputs}
        wires += [(start, also[end]) for start, end in wires if end in also]
        wires += [(f"{modes}.{port}", f"{name}.{port} of the modes") for port in plant.outputs]
        inputs = {key: [*ports, *(also[port] for port in ports if port in also)] for key, ports in inputs.items()}
    return replace(diagram, blocks=blocks, connections=wires, inputs=inputs, allow_algebraic_loops=True)


def modes_and_rest(system: StateSpace) -> tuple[ModalPlant, StateSpace] | None:
    """Conjugate damped poles as modes, the others as a state space that adds the modes' outputs (further inputs) to its own.

    A real Schur form with these poles first, decoupled by a Sylvester equation; then eigenvectors of the first part. None for
    small systems, many other poles (real, undamped or unstable ones), and eigenvectors that are badly conditioned.
    """
    if system.n_states <= LARGE:
        return None
    A, (scale, _) = scipy.linalg.matrix_balance(system.A, permute=False, separate=True)
    B, C = system.B / scale[:, None], system.C * scale
    T, Q, n = scipy.linalg.schur(A, output="real", sort=_is_mode)
    if system.n_states - n > MOST_REST:
        return None
    X = scipy.linalg.solve_sylvester(T[:n, :n], -T[n:, n:], -T[:n, n:])
    poles, V = np.linalg.eig(T[:n, :n])
    W = np.linalg.inv(V)
    if np.linalg.norm(V) * np.linalg.norm(W) > n * WELL_CONDITIONED or abs(X).max(initial=0.0) > WELL_CONDITIONED:
        return None
    b, c = W @ (Q[:, :n].T - X @ Q[:, n:].T) @ B, C @ Q[:, :n] @ V
    rest, ports = Q[:, :n] @ X + Q[:, n:], [f"{port} of the modes" for port in system.outputs]
    ny, m = len(system.outputs), system.n_states - n
    other = StateSpace(
        T[n:, n:],
        np.hstack([Q[:, n:].T @ B, np.zeros((m, ny))]),
        C @ rest,
        np.hstack([system.D, np.eye(ny)]),
        [*system.inputs, *ports],
        system.outputs,
        name=system.name,
    )
    return _plant(system, poles, b, c), other


def _is_mode(real: float, imaginary: float) -> bool:
    return imaginary != 0 and real < -DAMPED * abs(complex(real, imaginary))


def _plant(system: StateSpace, poles: ComplexArray, b: ComplexArray, c: ComplexArray) -> ModalPlant:
    """2 Re(c b (s - conj p)) / (s^2 - 2 Re p s + |p|^2): one mode for the real and one for the imaginary part of b.

    With one input b is brought to one, and one mode does.
    """
    upper = poles.imag > 0
    p, b, c = poles[upper], b[upper], c[:, upper]
    if b.shape[1] == 1:
        c, b = c * b[:, 0], np.ones_like(b)
    else:
        p, c, b = np.tile(p, 2), np.hstack([c, 1j * c]), np.vstack([b.real, b.imag]).astype(complex)
    force: FloatArray = np.asarray(b.real, dtype=float)
    omega = np.hypot(p.real, p.imag)
    return ModalPlant(
        omega=omega,
        zeta=-p.real / omega,
        shape_in=force,
        shape_out=-2 * (c * p.conj()).real,
        shape_out_velocity=2 * c.real,
        inputs=system.inputs,
        outputs=system.outputs,
        name=system.name,
    )
