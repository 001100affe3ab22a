"""Finite-element models become components: one file a method."""

from flexplant.reduction.craig_bampton import craig_bampton
from flexplant.reduction.guyan import guyan
from flexplant.reduction.reduced import ReducedComponent, ReductionReport, expand
from flexplant.reduction.rubin import rubin

__all__ = ["ReducedComponent", "ReductionReport", "craig_bampton", "expand", "guyan", "rubin"]
