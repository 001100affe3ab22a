"""Figures from result values: nothing here computes physics."""

from flexplant.report.figures.frequency import bode, sensitivity, singular_values, transfer_function
from flexplant.report.figures.modes import frequency_comparison, mode_contributions
from flexplant.report.figures.theme import Mark
from flexplant.report.figures.time import rms_over_speed, spot, time_histories

__all__ = [
    "Mark",
    "bode",
    "frequency_comparison",
    "mode_contributions",
    "rms_over_speed",
    "sensitivity",
    "singular_values",
    "spot",
    "time_histories",
    "transfer_function",
]
