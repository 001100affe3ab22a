"""Unit systems: explicit choices, never guessed (`flexplant.model.conversion` converts)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexplant.errors import InputError, expect_text, nearest
from flexplant.model.arrays import is_finite, is_number


@dataclass(frozen=True)
class UnitSystem:
    """A consistent mechanical unit system: one unit of length in metres, of mass in kilograms; time is the second.

    mass_factor: the file's mass numbers are multiplied by this to be in the unit of mass, as by Nastran's PARAM,WTMASS:
    1 / g where mass is written as weight. Stiffness and damping are in consistent units all the same.
    """

    name: str
    length: float
    mass: float
    mass_factor: float = 1.0

    def __post_init__(self) -> None:
        expect_text(self.name, "unit system: name")
        for kind in ("length", "mass", "mass_factor"):
            value = getattr(self, kind)
            if not (is_finite(value) and value > 0):
                raise InputError(f"unit system {self.name!r}: {kind} must be a positive number, got {value!r:.60}")

    @property
    def force(self) -> float:
        """One unit of force, newtons."""
        return self.mass * self.length


UNSTATED = "not stated"  # `units` of a component or model from a file that does not say; numbers as in the file
INCH, POUND_FORCE, GRAVITY = 0.0254, 4.4482216152605, 9.80665
SI = UnitSystem("SI", 1.0, 1.0)
UNIT_SYSTEMS = {
    u.name: u
    for u in (
        SI,
        UnitSystem("mm-tonne-s", 1e-3, 1e3),
        UnitSystem("mm-kg-s", 1e-3, 1.0),
        UnitSystem("inch-slinch-s", INCH, POUND_FORCE / INCH),
        UnitSystem("inch-lbf", INCH, POUND_FORCE / INCH, mass_factor=INCH / GRAVITY),  # mass as weight: g = 386.0886 in/s^2
        UnitSystem("ft-slug-s", 0.3048, POUND_FORCE / 0.3048),
    )
}


def unit_system(units: str | UnitSystem | tuple[float, float]) -> UnitSystem:
    """A preset by name, or (length in m, mass in kg); InputError names the presets.

    "inch-lbf": inch, pound-force, second, with mass written as weight in lbf (density in lbf/in^3, no PARAM,WTMASS in the run).
    """
    if isinstance(units, UnitSystem):
        return units
    if isinstance(units, str):
        if units in UNIT_SYSTEMS:
            return UNIT_SYSTEMS[units]
        raise InputError(f"unknown unit system {units!r}." + nearest(units, UNIT_SYSTEMS))
    pair = list(units) if isinstance(units, (tuple, list)) else []
    if len(pair) != 2 or not all(is_number(value) and 0 < value < np.inf for value in pair):
        raise InputError(f"unit system: a preset or two positive numbers (length in m, mass in kg) are needed, got {units!r}")
    length, mass = pair
    return UnitSystem(f"{length} m, {mass} kg", float(length), float(mass))
