"""Finite-element models become components: one file a method."""

from flexplant.reduction.craig_bampton import craig_bampton
from flexplant.reduction.guyan import guyan

__all__ = ["craig_bampton", "guyan"]
