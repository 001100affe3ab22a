"""Geometric optics to first order: thin lens, flat mirror, spot on the detector (equations 28-30)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from flexplant.blocks.basic import static
from flexplant.errors import InputError
from flexplant.model.arrays import FloatArray, frozen, is_finite, real_values
from flexplant.plant.fields import checked_names
from flexplant.plant.state_space import StateSpace

AXES = ("x", "y")


def checked_axes(axes: Sequence[str]) -> tuple[str, ...]:
    """The names of the axes; InputError for none, one text, and names that are listed twice."""
    names = checked_names(axes, "axes", "optics")
    if not names:
        raise InputError("optics: axes are none; name them, such as ('x', 'y')")
    return names


def ports(quantity: str, axes: Sequence[str]) -> list[str]:
    """Port names such as "angle_x", "angle_y"."""
    return [f"{quantity}_{axis}" for axis in checked_axes(axes)]


def per_axis(values: npt.ArrayLike, axes: Sequence[str], what: str) -> FloatArray:
    """One finite value per axis, from one value for all or one for each; InputError names both counts."""
    axes, given = checked_axes(axes), real_values(values, what)
    if given.shape not in ((), (len(axes),)) or not np.isfinite(given).all():
        raise InputError(f"{what} {values!r}: use one finite value, or one for each of the axes {', '.join(axes)}")
    return np.asarray(frozen(np.broadcast_to(given, (len(axes),))))


def focal_length_of(value: float, owner: str) -> float:
    """A focal length in metres that can be divided by; InputError otherwise."""
    if not is_finite(value) or not np.finfo(float).tiny <= abs(value) <= 1 / np.finfo(float).tiny:
        raise InputError(f"{owner}: focal length {value!r:.60} m; use a finite length that is not zero")
    return float(value)


def thin_lens(focal_length: float, *, axes: Sequence[str] = AXES, name: str = "lens") -> StateSpace:
    """dtheta = dx / f: decentre of a thin lens to beam tilt (equation 28). Ports "decenter_x" (m) -> "tilt_x" (rad)."""
    f = focal_length_of(focal_length, f"lens {name!r}")
    return _diagonal(1 / f, axes, ("decenter", "m"), ("tilt", "rad"), name)


def flat_mirror(*, axes: Sequence[str] = AXES, name: str = "reflection") -> StateSpace:
    """theta = 2 alpha: a flat mirror doubles the angle (equation 29). Ports "angle_x" -> "tilt_x", both rad."""
    return _diagonal(2.0, axes, ("angle", "rad"), ("tilt", "rad"), name)


def line_of_sight_geometry(focal_length: float, *, axes: Sequence[str] = AXES, name: str = "geometry") -> StateSpace:
    """r = f (dtheta + 2 alpha): lens tilt and mirror angle to the spot (equation 30).

    Ports "tilt_x", ... and "angle_x", ... (rad) -> "spot_x", ... (m).
    """
    f, n = focal_length_of(focal_length, f"geometry {name!r:.60}"), len(checked_axes(axes))
    return static(
        f * np.hstack([np.eye(n), 2 * np.eye(n)]),
        inputs=ports("tilt", axes) + ports("angle", axes),
        outputs=ports("spot", axes),
        name=name,
        input_units=["rad"] * (2 * n),
        output_units=["m"] * n,
    )


def angle_sensor(focal_length: float, *, axes: Sequence[str] = AXES, name: str = "sensor") -> StateSpace:
    """The measured spot as the mirror angle that would have moved it, r / (2 f). Ports "spot_x" (m) -> "angle_x" (rad)."""
    f = focal_length_of(focal_length, f"sensor {name!r}")
    return _diagonal(1 / (2 * f), axes, ("spot", "m"), ("angle", "rad"), name)


def _diagonal(factor: float, axes: Sequence[str], source: tuple[str, str], target: tuple[str, str], name: str) -> StateSpace:
    inputs = ports(source[0], axes)
    n = len(inputs)
    return static(
        factor * np.eye(n),
        inputs=inputs,
        outputs=ports(target[0], axes),
        name=name,
        input_units=[source[1]] * n,
        output_units=[target[1]] * n,
    )
