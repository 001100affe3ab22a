"""A plant as independent blocks of two states, which makes a step cost n and not n^2: for exports that compute by themselves.

Channels of the state matrix's graph that do not touch are apart already (the modes of a modal plant, discretised or not);
the rest is taken apart by its eigenvectors, complex pairs as real blocks [[s, w], [-w, s]], where these are well conditioned.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace, output_rows, state_space

LARGEST_CONDITION = 1e3  # of the eigenvectors: costs three digits at most, so that 1e-12 is kept
LARGEST_RESIDUAL = 1e-10  # of an eigenvector, relative to its eigenvalue; lightly damped modes have 1e-12 and less


@dataclass(frozen=True, eq=False)
class BlockForm:
    """x_i' = a_i x_i + b_i u (dt None) or x_i[k+1] = a_i x_i[k] + b_i u[k]; y = sum_i c_i x_i + d u.

    a: (n, 2, 2), b: (n, 2, nu), c: (n, 2, ny), d: (ny, nu); condition: of the eigenvectors, 1 where none were needed.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray
    dt: float | None = None
    condition: float = 1.0


@dataclass(frozen=True, eq=False)
class DenseForm:
    """x' = a x + b u, y = c x + d u (dt None), or with x[k+1]; balanced by powers of two. condition: why it is not in blocks."""

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray
    dt: float | None
    condition: float


def export_form(plant: ModalPlant | StateSpace | Descriptor) -> BlockForm | DenseForm:
    """Blocks where the plant can be taken apart within `LARGEST_CONDITION`, else dense.

    Raises InputError for other types, for a plant without inputs or outputs, and for a descriptor with a singular E.
    """
    if not isinstance(plant, ModalPlant | StateSpace | Descriptor):
        raise InputError(f"a ModalPlant, StateSpace or Descriptor can be written as C source, not {type(plant).__name__}")
    if not plant.inputs or not plant.outputs:
        raise InputError(f"plant {plant.name!r}: C source needs at least one input and one output; it has none of one kind")
    if isinstance(plant, ModalPlant):
        return _modes(plant) if plant.damping is None else _coupled(_scaled(plant))
    return _coupled(_balanced(state_space(plant)))


def described(form: BlockForm | DenseForm) -> str:
    """How the plant advances and what that costs, for the head of a C file."""
    n = len(form.a)
    if isinstance(form, BlockForm):
        return f"{n} independent modes or blocks of two states"
    return f"{n} states with a full matrix ({n}^2 multiplications a step): they cannot be taken apart accurately"


def sampled_blocks(form: BlockForm, dt: float, hold: str) -> BlockForm:
    """A continuous form sampled every dt seconds, exact for inputs held ("zero") or linear ("first", as `discretize`).

    From the exponential of [[a dt, I, 0], [0, 0, I], [0, 0, 0]]: its first row has exp(a dt) and its integrals.
    """
    n = len(form.a)
    augmented = np.zeros((n, 6, 6))
    augmented[:, :2, :2] = form.a * dt
    augmented[:, range(4), range(2, 6)] = 1.0
    e = scipy.linalg.expm(augmented) if n else augmented
    f, held, ramp = e[:, :2, :2], dt * e[:, :2, 2:4] @ form.b, dt * e[:, :2, 4:] @ form.b
    if hold == "zero":
        return replace(form, a=f, b=held, dt=dt)
    return replace(form, a=f, b=held + f @ ramp - ramp, d=form.d + np.einsum("nsy,nsu->yu", form.c, ramp), dt=dt)


def _modes(plant: ModalPlant) -> BlockForm:
    """Each mode in (omega eta, eta'), which keeps its block of norm omega; (eta, eta') for a rigid-body mode."""
    position, velocity, direct = output_rows(plant)
    scale = np.where(plant.omega > 0, plant.omega, 1.0)
    a = np.zeros((plant.n_modes, 2, 2))
    a[:, 0, 1], a[:, 1, 0], a[:, 1, 1] = scale, -plant.omega, -2 * plant.zeta * plant.omega
    b = np.stack([np.zeros_like(plant.shape_in), plant.shape_in], axis=1)
    return BlockForm(a, b, np.stack([position.T / scale[:, None], velocity.T], axis=1), direct)


def _scaled(plant: ModalPlant) -> StateSpace:
    """State space in (omega eta, eta')."""
    position, velocity, direct = output_rows(plant)
    scale = np.where(plant.omega > 0, plant.omega, 1.0)
    A = np.block([[np.zeros((scale.size, scale.size)), np.diag(scale)], [-np.diag(plant.omega), -plant.damping_matrix]])
    B = np.vstack([np.zeros_like(plant.shape_in), plant.shape_in])
    return StateSpace(A, B, np.hstack([position / scale, velocity]), direct, plant.inputs, plant.outputs)


def _balanced(system: StateSpace) -> StateSpace:
    if not system.n_states:
        return system
    A, (scale, _) = scipy.linalg.matrix_balance(system.A, permute=False, separate=True)
    return StateSpace(A, system.B / scale[:, None], system.C * scale, system.D, system.inputs, system.outputs, dt=system.dt)


def _coupled(system: StateSpace) -> BlockForm | DenseForm:
    basis, a = _invariant(system.A)
    singular = np.linalg.svd(basis, compute_uv=False) if basis.size else np.ones(1)
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0 else np.inf
    if condition > LARGEST_CONDITION or _residual(system.A, basis, a) > LARGEST_RESIDUAL:
        return DenseForm(system.A, system.B, system.C, system.D, system.dt, condition)
    n, nu, ny = system.n_states, len(system.inputs), len(system.outputs)
    b, c = np.zeros((2 * len(a), nu)), np.zeros((2 * len(a), ny))
    b[:n], c[:n] = np.linalg.solve(basis, system.B), (system.C @ basis).T
    return BlockForm(a, b.reshape(-1, 2, nu), c.reshape(-1, 2, ny), system.D, system.dt, condition)


def _residual(A: FloatArray, basis: FloatArray, blocks: FloatArray) -> float:
    """Largest column of W^-1 (A W - W diag(blocks)), relative to the size of its block; zero eigenvalues are left out."""
    n = A.shape[0]
    size = np.repeat(np.linalg.norm(blocks, axis=(1, 2)), 2)[:n]
    moving = size > 100 * np.finfo(float).eps * size.max(initial=0.0)
    error = A @ basis - basis @ scipy.linalg.block_diag(*blocks)[:n, :n] if n else A
    columns = np.linalg.norm(np.linalg.solve(basis, error), axis=0)
    return float((columns[moving] / size[moving]).max(initial=0.0))


def _invariant(A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """W (n, n) and blocks (m, 2, 2) with A W = W diag(blocks); an odd last state has an empty partner beyond n."""
    n = A.shape[0]
    parts = list(_parts(A))
    pairs = [part for part in parts if len(part[0]) == 2]
    singles = [part for part in parts if len(part[0]) == 1]
    blocks = [block for block, _ in pairs]
    blocks += [
        scipy.linalg.block_diag(one, two)
        for (one, _), (two, _) in itertools.zip_longest(singles[::2], singles[1::2], fillvalue=(np.zeros((1, 1)), None))
    ]
    columns = [columns for _, columns in (*pairs, *singles)]
    return np.hstack([np.zeros((n, 0)), *columns]), np.array(blocks).reshape(-1, 2, 2)


def _parts(A: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Blocks (k, k) of one or two states with their columns (n, k), from each set of states that touch one another."""
    n = A.shape[0]
    count, label = sp.csgraph.connected_components(sp.csr_array(A), directed=False)
    for part in range(count):
        rows = np.flatnonzero(label == part)
        inside = A[np.ix_(rows, rows)]
        for block, vectors in [(inside, np.eye(rows.size))] if rows.size <= 2 else _real_eigenvectors(inside):
            columns = np.zeros((n, len(block)))
            columns[rows] = vectors
            yield block, columns


def _real_eigenvectors(A: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Real eigenvalues alone; complex pairs s +- i w as [[s, w], [-w, s]], two orthogonal columns scaled to unit length."""
    values, vectors = scipy.linalg.eig(A)
    for value, vector in zip(values, vectors.T, strict=True):
        if value.imag == 0:
            yield np.array([[value.real]]), vector.real[:, None]
        elif value.imag > 0:
            turned = vector * np.exp(-0.5j * np.angle(vector @ vector))
            columns = np.stack([turned.real, turned.imag], axis=1)
            size = np.linalg.norm(columns, axis=0)
            block = np.array([[value.real, value.imag], [-value.imag, value.real]])
            yield block * size[:, None] / size, columns / size
