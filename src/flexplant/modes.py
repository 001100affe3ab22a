"""Normal modes of systems, components and models; modal assurance."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import singledispatch
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.linalg as la
import scipy.sparse as sp

from flexplant.assembly import System, component_rigid_body, coupled_stiffness_scale, stiffness_scale
from flexplant.errors import InputError, expect, expect_count
from flexplant.model.arrays import FloatArray, dense, frozen, is_number, is_sparse, items_of, real_or_complex, real_values
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.describe import count, listed, paragraph
from flexplant.model.geometry import rigid_body_vectors
from flexplant.numerics.eigen import Eigenpairs, dense_eigenpairs, sparse_eigenpairs
from flexplant.numerics.factorization import factorize
from flexplant.numerics.rank import split_semidefinite

DENSE_LIMIT = 1500  # coordinates up to which a dense solution is faster than a sparse one or takes about a second
NEARLY_ZERO = 1e-7  # the same, of motions that rounded coordinates may have disturbed
DENSE_MAXIMUM = 12_000  # coordinates up to which all modes fit into some GB
ZERO_ENERGY = 1e-11  # strain energy of a rigid motion relative to the same motion of `stiffness_scale`


@dataclass(frozen=True, eq=False)
class Modes:
    """Normal modes, ascending, mass-normalised: Phi^T M Phi = I, Phi^T K Phi = diag((2 pi f)^2).

    frequency_hz: (k,), exactly 0 for the `n_rigid` leading rigid-body modes and mechanisms. shapes: (n, k) in the object's
    coordinates (a System's uncoupled coordinates p). residuals: (k,) |K phi - w^2 M phi| / (|d phi| + w^2 |m phi|) of the reduced
    problem, m the diagonal of M, d the stiffness scale: the diagonal of K, or of the inertia where that is mere round-off.
    """

    frequency_hz: FloatArray
    shapes: FloatArray
    residuals: FloatArray
    n_rigid: int
    labels: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        for name in ("frequency_hz", "shapes", "residuals"):
            object.__setattr__(self, name, frozen(getattr(self, name), what=f"modes: {name}"))
        hz, shapes = self.frequency_hz, self.shapes
        if hz.ndim != 1 or shapes.ndim != 2 or shapes.shape[1] != hz.size or self.residuals.shape != hz.shape:
            sizes = f"frequency_hz {hz.shape}, shapes {shapes.shape}, residuals {self.residuals.shape}"
            raise InputError(f"modes: {sizes} disagree; (k,), (n, k) and (k,) are needed")
        expect_count(self.n_rigid, "modes: n_rigid", most=hz.size)
        if items_of(self.labels) is None or not all(isinstance(label, str) for label in self.labels):
            raise InputError(f"modes: labels must be a list of names, got {self.labels!r:.60}")

    def __repr__(self) -> str:
        rigid = f", {self.n_rigid} of them rigid-body" if self.n_rigid else ""
        hz = listed(f"{value:.5g}" for value in self.frequency_hz[self.n_rigid :])
        return paragraph(f"{count(len(self), 'mode')}{rigid}", {"Hz": hz})

    @property
    def omega(self) -> FloatArray:
        """(k,) rad/s."""
        return 2 * np.pi * self.frequency_hz

    def __len__(self) -> int:
        return int(self.frequency_hz.size)


def expect_modes_of(modes: object, system: System, what: str) -> None:
    """InputError unless these are modes with shapes over the system's coordinates."""
    if not isinstance(modes, Modes) or modes.shapes.shape[0] != system.n:
        got = f"shapes {modes.shapes.shape}" if isinstance(modes, Modes) else type(modes).__name__
        raise InputError(f"{what}: modes must be those of this system, with shapes over its {system.n} coordinates, got {got}")


@dataclass(frozen=True, eq=False)
class _Problem:
    """K, M in independent coordinates; basis back to the object's coordinates; candidate rigid motions (n, k) or None."""

    stiffness: Any
    mass: Any
    basis: Any
    candidates: FloatArray | None
    labels: list[str]
    scale: FloatArray | None = None  # (n,) diagonal that strain energies compare with; None: the stiffness' own
    sprung: FloatArray | None = None  # (n, k) rigid motions of components that compliant connections are known to resist

    @property
    def diagonal(self) -> FloatArray:
        return np.asarray(abs(self.stiffness.diagonal()) if self.scale is None else self.scale)


Modal: TypeAlias = System | Component | FiniteElementModel


def normal_modes(model: Modal, *, max_frequency_hz: float | None = None, n_modes: int | None = None) -> Modes:
    """Undamped normal modes of a coupled system, a component (boundary free) or a finite-element model.

    Modes up to `max_frequency_hz`, or the first `n_modes` (rigid-body modes counted), or all finite ones of a small
    model. Multipliers carry no mass, so the dual and primal forms share their finite modes; both are solved in the
    eliminated coordinates. Rigid-body modes are those geometric motions (or, without geometry, that null space) whose
    strain energy is round-off; they are deflated and leave as exact zeros. Massless directions follow statically.
    Raises InputError for impossible requests, SolverError for an indefinite mass or a massless mechanism.
    """
    _check_request(max_frequency_hz, n_modes)
    problem = _problem(model)
    n = problem.stiffness.shape[0]
    rigid = _rigid_motions(problem)
    few = n_modes is not None and n_modes <= n // 3
    limit = None if max_frequency_hz is None else (2 * np.pi * max_frequency_hz) ** 2
    if n > DENSE_MAXIMUM and not few and max_frequency_hz is None:
        raise InputError(f"all modes of a model of {n} coordinates do not fit; give n_modes up to {n // 3} or max_frequency_hz")
    if n <= DENSE_LIMIT or (n_modes is None and max_frequency_hz is None) or (n_modes or 0) > n // 3:
        found = dense_eigenpairs(problem.stiffness, problem.mass, rigid, n_modes=n_modes, max_omega2=limit)
    else:
        found = sparse_eigenpairs(problem.stiffness, problem.mass, rigid, n_modes=n_modes, max_omega2=limit)
    return _selected(problem, found, max_frequency_hz, n_modes)


def _check_request(max_frequency_hz: float | None, n_modes: int | None) -> None:
    if max_frequency_hz is not None and not (is_number(max_frequency_hz) and max_frequency_hz > 0):
        raise InputError(f"max_frequency_hz must be positive, got {max_frequency_hz}")
    if n_modes is not None and (not is_number(n_modes) or n_modes < 1 or n_modes % 1 != 0):
        raise InputError(f"n_modes must be a positive whole number, got {n_modes}")


def _selected(problem: _Problem, found: Eigenpairs, max_frequency_hz: float | None, n_modes: int | None) -> Modes:
    hz = np.sqrt(np.maximum(found.omega2, 0)) / (2 * np.pi)
    hz = np.where(found.omega2 < 0, -np.sqrt(-np.minimum(found.omega2, 0)) / (2 * np.pi), hz)
    if n_modes is not None and n_modes > hz.size:
        raise InputError(f"{n_modes} modes were asked for, but the model has only {hz.size} finite modes")
    keep = slice(0, n_modes) if max_frequency_hz is None else np.flatnonzero(hz <= max_frequency_hz)[:n_modes]
    vectors, omega2 = found.vectors[:, keep], found.omega2[keep]
    force = problem.stiffness @ vectors
    own = np.maximum(abs(problem.stiffness.diagonal()), problem.diagonal)
    inertia = abs(omega2) * np.linalg.norm(abs(problem.mass.diagonal())[:, None] * vectors, axis=0)
    scale = np.linalg.norm(own[:, None] * vectors, axis=0) + inertia
    residuals = np.linalg.norm(force - (problem.mass @ vectors) * omega2, axis=0) / np.where(scale > 0, scale, 1.0)
    shapes = vectors if problem.basis is None else problem.basis @ vectors
    return Modes(hz[keep], shapes, residuals, int(np.count_nonzero(hz[keep][: found.zero] == 0)), problem.labels)


@singledispatch
def _problem(model: object) -> _Problem:
    raise InputError(f"normal modes need a System, Component or FiniteElementModel, got {type(model).__name__}")


@_problem.register
def _(model: FiniteElementModel) -> _Problem:
    candidates = (
        None if model.nodes is None else rigid_body_vectors(model.nodes, model.dofs, about=model.nodes.positions.mean(axis=0))
    )
    return _Problem(model.stiffness, model.mass, None, candidates, [f"{n}.{d}" for n, d in model.dofs.pairs])


@_problem.register
def _(model: Component) -> _Problem:
    candidates = None if model.nodes is None else component_rigid_body(model, about=model.nodes.positions.mean(axis=0))
    labels = [f"{n}.{d}" for n, d in model.dofs.pairs]
    return _Problem(model.stiffness, model.mass, None, candidates, labels, stiffness_scale(model))


@_problem.register
def _(model: System) -> _Problem:
    stiffness = sp.csr_array(model.basis.T @ model.uncoupled_stiffness @ model.basis)
    mass = sp.csr_array(model.basis.T @ model.uncoupled_mass @ model.basis)
    free, sprung = (m[model.kept] for m in _free_motions(model)) if model.has_geometry else (None, None)
    scale = coupled_stiffness_scale(model)
    return _Problem(stiffness, mass, model.basis, free, model.labels, scale, sprung)


def _free_motions(system: System) -> tuple[FloatArray, FloatArray]:
    """Rigid motions of the components that the constraints admit: free ones (whole body, floating parts, hinges) (n, k),
    and those that compliant connections resist (n, l), however softly.

    Combinations W c of the components' rigid-body vectors with B W c = 0, found by rank of the small Gram matrix.
    """
    blocks = []
    for c in system.components:
        assert c.nodes is not None
        center = system.placement(c.name).apply(c.nodes.positions.mean(axis=0)) if len(c.nodes) else np.zeros(3)
        vectors = component_rigid_body(c, system.placement(c.name), center)
        size = np.linalg.norm(vectors, axis=0)
        blocks.append(sp.csr_array(vectors / np.where(size > 0, size, 1.0)))
    motions = sp.block_diag(blocks, format="csr")
    admitted = np.asarray(motions @ _kernel(dense(system.constraints @ motions))[0])
    free, resisted = _kernel(system.springs @ admitted)
    return admitted @ free, admitted @ resisted


def _kernel(gap: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Combinations (columns) that the rows (m, k) map to zero, and those that they do not."""
    if not gap.shape[0]:
        return np.eye(gap.shape[1]), np.zeros((gap.shape[1], 0))
    values, vectors = la.eigh(gap.T @ gap)
    free = values <= 1e-12 * max(values.max(initial=0.0), 1.0)
    return vectors[:, free], vectors[:, ~free]


def _rigid_motions(problem: _Problem) -> FloatArray:
    """Basis of the zero-energy motions: geometric candidates of no energy, then whatever else is in the null space of K.

    A vendor's rounding leaves geometric motions a little energy, so they are asked first; the null space is exact to
    round-off and finds mechanisms that geometry does not know (and everything, where positions are unknown).
    """
    geometric = _geometric_motions(problem)
    if problem.stiffness.shape[0] > DENSE_LIMIT:
        return _refined(problem, geometric) if problem.candidates is not None else _lowest_energy(problem.stiffness, problem.mass)
    null = split_semidefinite(dense(problem.stiffness), scale=problem.scale).null
    null = la.orth(null) if null.shape[1] else null
    known = geometric if problem.sprung is None else la.orth(np.hstack([geometric, problem.sprung]))
    rest = null - known @ (known.T @ null)
    return np.hstack([geometric, la.orth(rest, rcond=1e-3) if (np.linalg.norm(rest, axis=0) > 1e-3).any() else rest[:, :0]])


def _geometric_motions(problem: _Problem, limit: float = ZERO_ENERGY) -> FloatArray:
    k, candidates = problem.stiffness, problem.candidates
    if candidates is None or not candidates.shape[1] or not abs(candidates).max() > 0:
        return np.zeros((k.shape[0], 0))
    basis = la.orth(candidates)
    energy = basis.T @ (k @ basis)
    local = basis.T @ (problem.diagonal[:, None] * basis)
    ratio, combination = la.eigh(energy, local + _floor(local))
    rigid = abs(ratio) <= limit
    return np.asarray(la.orth(basis @ combination[:, rigid])) if rigid.any() else basis[:, :0]


def _refined(problem: _Problem, geometric: FloatArray) -> FloatArray:
    """Zero-energy motions of a large model: where coordinates rounded by a file leave the geometric motions a little energy,
    inverse iteration turns them into the model's own, and their energy is judged again."""
    nearly = _geometric_motions(problem, NEARLY_ZERO)
    if nearly.shape[1] == geometric.shape[1]:
        return geometric
    k, m = problem.stiffness, problem.mass
    motion = la.orth(nearly)
    shift = float(np.trace(motion.T @ (k @ motion)) / np.trace(motion.T @ (m @ motion)))
    factor = factorize(sp.csc_array(k + shift * m))
    for _ in range(4):
        motion = la.orth(factor.solve(m @ motion))
    return _geometric_motions(replace(problem, candidates=motion))


def _floor(local: FloatArray) -> FloatArray:
    """Keeps directions that no stiffness touches (their energy is zero as well) from making the ratio undefined."""
    return np.asarray(1e-14 * max(float(np.trace(local)), np.finfo(float).tiny) * np.eye(local.shape[0]))


def _lowest_energy(k: Any, m: Any) -> FloatArray:
    """Zero-energy motions of a large model without geometry: computed modes whose force K x is pure cancellation."""
    found = sparse_eigenpairs(k, m, np.zeros((k.shape[0], 0)), n_modes=12, max_omega2=None).vectors
    cancelled = np.linalg.norm(k @ found, axis=0) / np.linalg.norm(abs(k) @ abs(found), axis=0)
    return np.asarray(found[:, cancelled < 1e-12])


def mac(a: npt.ArrayLike, b: npt.ArrayLike) -> FloatArray:
    """Modal assurance criterion |a_i^T b_j|^2 / (a_i^T a_i b_j^T b_j), (n_a, n_b); shapes (n, n_a) and (n, n_b).

    Raises InputError where the row counts differ. Source: Allemang and Brown 1982.
    """
    a, b = _shapes_of(a, "a"), _shapes_of(b, "b")
    if a.shape[0] != b.shape[0]:
        raise InputError(f"MAC: shapes have {a.shape[0]} and {b.shape[0]} rows; compare the same DOF in the same order")
    cross = abs(a.conj().T @ b) ** 2
    own = np.outer((abs(a) ** 2).sum(axis=0), (abs(b) ** 2).sum(axis=0))
    return np.asarray(np.divide(cross, own, out=np.zeros(cross.shape), where=own > 0))


def _shapes_of(values: npt.ArrayLike, name: str) -> npt.NDArray[Any]:
    shapes: npt.NDArray[Any] = np.atleast_2d(real_or_complex(values, f"MAC: shapes {name}"))
    if shapes.ndim != 2 or not np.isfinite(shapes).all():
        raise InputError(f"MAC: shapes {name} of shape {shapes.shape}; finite numbers (n, modes) are needed")
    return shapes


def effective_mass(modes: Modes, model: Modal, motion: npt.ArrayLike) -> FloatArray:
    """(k, r) modal effective mass (phi^T M R)^2 for rigid-body vectors R (n, r) in the model's coordinates."""
    expect(modes, Modes, "effective_mass", "normal_modes(system) gives them")
    mass = _mass_of(model)
    if mass.shape[0] != modes.shapes.shape[0]:
        raise InputError(f"effective mass: the shapes have {modes.shapes.shape[0]} rows, the model {mass.shape[0]} coordinates")
    motion = real_values(motion, "effective mass: R")
    if motion.shape[:1] != (modes.shapes.shape[0],):
        raise InputError(f"effective mass: R has {motion.shape[:1]} rows, the shapes have {modes.shapes.shape[0]}")
    product = mass @ motion
    return np.asarray((modes.shapes.T @ (dense(product) if is_sparse(product) else product)) ** 2)


def _mass_of(model: object) -> Any:
    if isinstance(model, System):
        return model.uncoupled_mass
    if isinstance(model, Component | FiniteElementModel):
        return model.mass
    raise InputError(f"effective mass needs a System, Component or FiniteElementModel, got {type(model).__name__}")
