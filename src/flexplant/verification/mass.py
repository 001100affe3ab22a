"""Mass properties from mass matrices and geometric rigid-body motion."""

from __future__ import annotations

from functools import singledispatch
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flexplant.assembly import System, component_rigid_body, system_rigid_body
from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.geometry import Placement, cross_matrix, rigid_body_vectors


class MassProperties(NamedTuple):
    """mass; center_of_gravity (3,); inertia (3, 3) about the centre of gravity (tensor: off-diagonals are -products).

    Axes: the component's basic frame, or the system frame. `anisotropy`: largest relative difference between the mass
    seen in x, y and z and of the off-diagonal mass; 0 for a consistent three-dimensional model.
    """

    mass: float
    center_of_gravity: FloatArray
    inertia: FloatArray
    anisotropy: float


def from_rigid_mass(rigid: FloatArray) -> MassProperties:
    """Mass properties from the (6, 6) rigid-body mass R^T M R; the centre of gravity is relative to its reference point.

    M_RR = [[m I, -m [c]x], [m [c]x, J_0]], J_cg = J_0 + m [c]x [c]x.
    """
    translation = rigid[:3, :3]
    mass = float(np.trace(translation)) / 3
    if not mass > 0:
        raise InputError(f"mass properties: the rigid-body mass is {mass:.4g}; the model carries no translational mass")
    first = 0.5 * (rigid[3:, :3] - rigid[3:, :3].T) / mass
    center = np.array([first[2, 1], first[0, 2], first[1, 0]])
    arm = cross_matrix(center)
    inertia = rigid[3:, 3:] + mass * arm @ arm
    anisotropy = float(abs(translation - mass * np.eye(3)).max() / mass)
    return MassProperties(mass, center, 0.5 * (inertia + inertia.T), anisotropy)


@singledispatch
def rigid_mass(model: object, about: npt.ArrayLike = (0.0, 0.0, 0.0)) -> FloatArray:  # noqa: ARG001
    """(6, 6) rigid-body mass R^T M R about a point of the basic (or system) frame."""
    raise InputError(f"mass properties need a Component, System or FiniteElementModel, got {type(model).__name__}")


@rigid_mass.register
def _(model: Component, about: npt.ArrayLike = (0.0, 0.0, 0.0)) -> FloatArray:
    motion = component_rigid_body(model, about=about)
    return np.asarray(motion.T @ (model.mass @ motion))


@rigid_mass.register
def _(model: System, about: npt.ArrayLike = (0.0, 0.0, 0.0)) -> FloatArray:
    motion = system_rigid_body(model, about)
    return np.asarray(motion.T @ (model.uncoupled_mass @ motion))


@rigid_mass.register
def _(model: FiniteElementModel, about: npt.ArrayLike = (0.0, 0.0, 0.0)) -> FloatArray:
    if model.nodes is None:
        raise InputError(f"model {model.name!r} has no node positions, so its mass properties are unknown")
    motion = rigid_body_vectors(model.nodes, model.dofs, about=about)
    return np.asarray(motion.T @ (model.mass @ motion))


def mass_properties(model: Component | System | FiniteElementModel) -> MassProperties:
    """Mass, centre of gravity and inertia about it, from R^T M R.

    Raises InputError where node positions are unknown or the model has no mass. Nastran prints inertia products I(S)
    with the opposite sign to the tensor's off-diagonals. The inertia is taken about the centre itself, so that a model far
    from its origin loses no digits.
    """
    near = from_rigid_mass(rigid_mass(model)).center_of_gravity
    there = from_rigid_mass(rigid_mass(model, near))
    return there._replace(center_of_gravity=near + there.center_of_gravity)


def combined(parts: list[tuple[MassProperties, Placement]]) -> MassProperties:
    """Sum rule: mass properties of placed parts by the parallel-axis theorem."""
    mass = sum(p.mass for p, _ in parts)
    centers = [place.apply(p.center_of_gravity) for p, place in parts]
    center = sum((p.mass * c for (p, _), c in zip(parts, centers, strict=True)), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for (p, place), c in zip(parts, centers, strict=True):
        arm = cross_matrix(c - center)
        inertia += place.rotation @ p.inertia @ place.rotation.T - p.mass * arm @ arm
    return MassProperties(mass, center, inertia, max(p.anisotropy for p, _ in parts))
