"""What a mechanism looks like in words: which DOF move, and along which rigid motion."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.linalg as la

from flexplant.model.arrays import FloatArray, IntArray
from flexplant.model.component import FiniteElementModel
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import rigid_body_vectors

MOVES = 1e-3  # of the largest displacement: DOF below it stand still
RIGID_FIT = 1e-2  # largest misfit of a motion that is called rigid
NAMES = ("translation x", "translation y", "translation z", "rotation x", "rotation y", "rotation z")


def described(model: FiniteElementModel, rows: IntArray, motion: FloatArray) -> str:
    """ "mostly at DOF 3-1, 4-1 (translation x of 2 nodes)" for a displacement `motion` (k,) of the model's `rows`."""
    largest = [model.dofs.pairs[rows[k]] for k in np.argsort(-abs(motion), kind="stable")[:6]]
    text = "mostly at DOF " + ", ".join(f"{n}-{d}" for n, d in largest)
    pattern = _pattern(model, rows, motion)
    return text if pattern is None else f"{text} ({pattern})"


def _pattern(model: FiniteElementModel, rows: IntArray, motion: FloatArray) -> str | None:
    """The rigid motions that make up the displacement, largest first; None where it is not rigid or positions are unknown."""
    moving = abs(motion) > MOVES * abs(motion).max()
    dofs = DofSet(model.dofs.node[rows[moving]], model.dofs.direction[rows[moving]])
    if model.nodes is None or not (dofs.direction > 0).all():
        return None
    ids = np.unique(dofs.node)
    center = np.mean([model.nodes.position(int(n)) for n in ids], axis=0)
    vectors = rigid_body_vectors(model.nodes, dofs, about=center)
    size = np.linalg.norm(vectors, axis=0)
    vectors = vectors[:, size > 0] / size[size > 0]
    share = la.lstsq(vectors, motion[moving])[0]
    if np.linalg.norm(vectors @ share - motion[moving]) > RIGID_FIT * np.linalg.norm(motion[moving]):
        return None
    names = np.array(NAMES)[size > 0]
    chosen = [str(names[k]) for k in np.argsort(-abs(share)) if abs(share[k]) > 0.1 * abs(share).max()]
    words = " and ".join(chosen) if len(chosen) <= 2 else _screw(share / size[size > 0], size > 0, center)
    return f"{words} of {ids.size} node{'s' if ids.size > 1 else ''}"


def _screw(motion: FloatArray, known: npt.NDArray[np.bool_], center: FloatArray) -> str:
    """A rigid motion about no axis of the basic frame: the axis that it turns about, or the direction in which it moves."""
    twist = np.zeros(6)
    twist[known] = motion
    move, turn = twist[:3], twist[3:]
    if not turn.any():
        return f"translation along {_vector(move / np.linalg.norm(move))}"
    through = center + np.cross(turn, move) / (turn @ turn)
    return f"rotation about the axis along {_vector(turn / np.linalg.norm(turn))} through {_vector(through)}"


def _vector(values: FloatArray) -> str:
    return "(" + ", ".join(f"{value + 0.0:.3g}" for value in np.where(abs(values) < 1e-6 * abs(values).max(), 0.0, values)) + ")"
