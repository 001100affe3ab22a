"""First-order plants: StateSpace, Descriptor, and the way from the modal and descriptor forms to state space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from flexplant.errors import InputError, ModelError, expect_text
from flexplant.model.arrays import FloatArray, Matrix, checked_matrix, dense, is_number
from flexplant.model.describe import channels, count, paragraph
from flexplant.plant.fields import check_mapping, checked_dense, checked_names, checked_units
from flexplant.plant.modal import ModalPlant


def _set_channels(system: StateSpace | Descriptor, owner: str) -> None:
    check_mapping(system.source, f"{owner}: source")
    for kind in ("inputs", "outputs"):
        names = checked_names(getattr(system, kind), kind, owner)
        object.__setattr__(system, kind, names)
        units = f"{kind[:-1]}_units"
        object.__setattr__(system, units, checked_units(getattr(system, units), len(names), units, owner))


def _expect_square(shape: tuple[int, ...], what: str) -> None:
    if shape[0] != shape[1]:
        raise ModelError(f"{what} has shape {shape}, but a square matrix is needed")


def _described(system: Any, headline: str) -> str:
    shown = {kind: channels(getattr(system, f"{kind}s"), getattr(system, f"{kind}_units")) for kind in ("input", "output")}
    return paragraph(headline, {f"{kind}s": text for kind, text in shown.items()} | {"from": str(system.source.get("path", ""))})


@dataclass(frozen=True, eq=False)
class StateSpace:
    """x' = A x + B u, y = C x + D u (dt None), or x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k] (dt in seconds).

    A: (n, n), B: (n, nu), C: (ny, n), D: (ny, nu), dense and finite; n = 0 is a static gain.
    inputs, outputs: distinct names, nu and ny of them. source: provenance, as of a `ModalPlant`.
    Raises ModelError with the names and shapes that disagree.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    inputs: Sequence[str]
    outputs: Sequence[str]
    dt: float | None = None
    name: str = "plant"
    input_units: Sequence[str] = ()
    output_units: Sequence[str] = ()
    source: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        expect_text(self.name, "state space: name")
        owner = f"state space {self.name!r}"
        _set_channels(self, owner)
        A = checked_dense(self.A, (None, None), f"{owner}: A")
        n, nu, ny = len(A), len(self.inputs), len(self.outputs)
        sizes = f"{owner} ({n} states, {nu} inputs, {ny} outputs)"
        _expect_square(A.shape, f"{sizes}: A")
        object.__setattr__(self, "A", A)
        for kind, shape in {"B": (n, nu), "C": (ny, n), "D": (ny, nu)}.items():
            object.__setattr__(self, kind, checked_dense(getattr(self, kind), shape, f"{sizes}: {kind}"))
        if self.dt is not None and not (is_number(self.dt) and 0 < self.dt < np.inf):
            raise ModelError(f"{owner}: dt = {self.dt!r:.60}; use None for continuous time or a positive number of seconds")

    def __repr__(self) -> str:
        clock = "continuous" if self.dt is None else f"every {self.dt:g} s"
        return _described(self, f"StateSpace {self.name!r}: {count(self.n_states, 'state')}, {clock}")

    @property
    def n_states(self) -> int:
        """Number of states."""
        return int(self.A.shape[0])


@dataclass(frozen=True, eq=False)
class Descriptor:
    """E x' = A x + B u, y = C x + D u with sparse E and A; E may be singular (equations 12-24).

    E, A: (n, n) CSR. B: (n, nu), C: (ny, n) sparse or dense. D: (ny, nu). inputs, outputs: distinct names.
    source: provenance, as of a `ModalPlant`. Raises ModelError with the names and shapes that disagree.
    """

    E: Matrix
    A: Matrix
    B: Matrix
    C: Matrix
    D: FloatArray
    inputs: Sequence[str]
    outputs: Sequence[str]
    name: str = "plant"
    input_units: Sequence[str] = ()
    output_units: Sequence[str] = ()
    source: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        expect_text(self.name, "descriptor: name")
        owner = f"descriptor {self.name!r}"
        _set_channels(self, owner)
        A = sp.csr_array(checked_matrix(self.A, (None, None), f"{owner}: A"))
        n, nu, ny = A.shape[0], len(self.inputs), len(self.outputs)
        sizes = f"{owner} ({n} states, {nu} inputs, {ny} outputs)"
        _expect_square(A.shape, f"{sizes}: A")
        object.__setattr__(self, "A", A)
        object.__setattr__(self, "E", sp.csr_array(checked_matrix(self.E, (n, n), f"{sizes}: E")))
        for kind, shape in {"B": (n, nu), "C": (ny, n)}.items():
            object.__setattr__(self, kind, checked_matrix(getattr(self, kind), shape, f"{sizes}: {kind}"))
        object.__setattr__(self, "D", checked_dense(self.D, (ny, nu), f"{sizes}: D"))

    def __repr__(self) -> str:
        return _described(self, f"Descriptor {self.name!r}: {count(self.n_states, 'state')}, E and A sparse")

    @property
    def n_states(self) -> int:
        """Number of descriptor states (differential and algebraic)."""
        return int(self.A.shape[0])


def state_space(plant: ModalPlant | Descriptor | StateSpace) -> StateSpace:
    """The plant in state space.

    Modal: x = [eta; eta'], A = [[0, I], [-omega^2, -Z]], B = [0; shape_in], and eta'' = shape_in u - Z eta' - omega^2 eta
    puts acceleration outputs into C and D; static correction goes to D. Descriptor: E^-1 A, E^-1 B where E is regular.
    Raises InputError for a singular E (a bordered system, massless coordinates) or another type.
    """
    if isinstance(plant, StateSpace):
        return plant
    if isinstance(plant, ModalPlant):
        return _from_modal(plant)
    if isinstance(plant, Descriptor):
        return _from_descriptor(plant)
    raise InputError(f"state_space needs a ModalPlant, Descriptor or StateSpace, got {type(plant).__name__}")


def _from_modal(plant: ModalPlant) -> StateSpace:
    n, square, damping = plant.n_modes, plant.omega**2, plant.damping_matrix
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(square), -damping]])
    B = np.vstack([np.zeros_like(plant.shape_in), plant.shape_in])
    position, velocity, D = output_rows(plant)
    return StateSpace(A, B, np.hstack([position, velocity]), D, **channels_of(plant))


def output_rows(plant: ModalPlant) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rows on eta, on eta' and on u, with eta'' eliminated: (ny, n), (ny, n), (ny, nu)."""
    position = plant.shape_out if plant.shape_out is not None else np.zeros((len(plant.outputs), plant.n_modes))
    velocity = plant.shape_out_velocity if plant.shape_out_velocity is not None else np.zeros_like(position)
    acceleration = plant.shape_out_acceleration
    if acceleration is None:
        return position, velocity, plant.direct
    through_damping = acceleration * (2 * plant.zeta * plant.omega) if plant.damping is None else acceleration @ plant.damping
    return position - acceleration * plant.omega**2, velocity - through_damping, plant.direct + acceleration @ plant.shape_in


def channels_of(plant: ModalPlant | Descriptor | StateSpace) -> dict[str, Any]:
    """Names, units and provenance of a plant, to hand on to another form of it."""
    return {k: getattr(plant, k) for k in ("inputs", "outputs", "name", "input_units", "output_units", "source")}


def _from_descriptor(plant: Descriptor) -> StateSpace:
    E = dense(plant.E)
    scale = abs(E).max(axis=1)
    regular = bool(scale.size) and scale.min() > 0
    if regular:
        factor = scipy.linalg.qr(E / scale[:, None], mode="r", pivoting=True)[0]
        diagonal = abs(np.diag(factor))
        regular = diagonal.min() > E.shape[0] * np.finfo(float).eps * diagonal.max()
    if not regular:
        raise InputError(
            f"descriptor {plant.name!r}: E is singular (constraint multipliers, massless coordinates or acceleration outputs), "
            "so it has no state space of this size; use modal_plant, or a system coupled with method='primal'"
        )
    solved: Any = np.linalg.solve(E, np.hstack([dense(plant.A), dense(plant.B)]))
    n = plant.n_states
    return StateSpace(solved[:, :n], solved[:, n:], dense(plant.C), plant.D, **channels_of(plant))
