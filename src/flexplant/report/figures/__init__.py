"""Figures from result values: nothing here computes physics."""

from flexplant.report.figures.broken_loop import broken_loop
from flexplant.report.figures.frequency import bode, sensitivity, singular_values, transfer_function
from flexplant.report.figures.modes import frequency_comparison, mode_contributions
from flexplant.report.figures.plot import plot
from flexplant.report.figures.shape import mode_shape
from flexplant.report.figures.spectra import spectra
from flexplant.report.figures.theme import Mark
from flexplant.report.figures.time import rms_over_speed, spot, time_histories

__all__ = [
    "Mark",
    "bode",
    "broken_loop",
    "frequency_comparison",
    "mode_contributions",
    "mode_shape",
    "plot",
    "rms_over_speed",
    "sensitivity",
    "singular_values",
    "spectra",
    "spot",
    "time_histories",
    "transfer_function",
]
