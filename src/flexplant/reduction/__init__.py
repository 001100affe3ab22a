"""Finite-element models become components: one file a method."""

from flexplant.reduction.characteristic import characteristic_constraint_modes
from flexplant.reduction.craig_bampton import craig_bampton
from flexplant.reduction.damping import with_dampers, with_proportional_damping
from flexplant.reduction.expansion import Expansion, expand, expansion
from flexplant.reduction.guyan import guyan
from flexplant.reduction.interface import with_interface_node
from flexplant.reduction.reduced import ReducedComponent, ReductionReport
from flexplant.reduction.rubin import rubin

__all__ = [
    "Expansion",
    "ReducedComponent",
    "ReductionReport",
    "characteristic_constraint_modes",
    "craig_bampton",
    "expand",
    "expansion",
    "guyan",
    "rubin",
    "with_dampers",
    "with_interface_node",
    "with_proportional_damping",
]
