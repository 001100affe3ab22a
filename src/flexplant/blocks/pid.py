"""The PID controller with a filtered derivative."""

from __future__ import annotations

import numpy as np

from flexplant.errors import InputError
from flexplant.model.arrays import is_finite
from flexplant.plant.state_space import StateSpace


def pid(
    kp: float,
    ki: float = 0.0,
    kd: float = 0.0,
    *,
    filter_time: float | None = None,
    input_name: str = "error",
    output_name: str = "command",
    input_unit: str = "",
    output_unit: str = "",
    name: str = "pid",
) -> StateSpace:
    """C(s) = kp + ki / s + kd s / (filter_time s + 1), filter_time in seconds.

    One state for the integral, one for the filter, only where used. InputError if kd is given without a filter time.
    """
    for value in (kp, ki, kd, *([] if filter_time is None else [filter_time])):
        if not is_finite(value):
            raise InputError(f"pid {name!r:.60}: kp, ki, kd and filter_time must be finite numbers, got {value!r:.60}")
    kp, ki, kd = float(kp), float(ki), float(kd)
    if kd and not (filter_time is not None and filter_time > 0):
        raise InputError(f"pid {name!r}: kd = {kd} needs filter_time > 0 s (a pure derivative is improper), got {filter_time!r}")
    # kd s/(tf s + 1) = kd/tf (1 - 1/(tf s + 1)): a feedthrough and one lag, whose state is the filtered input
    lag = 1 / filter_time if kd and filter_time else 0.0
    used = np.array([bool(ki), bool(kd)])
    A = np.diag([0.0, -lag])[np.ix_(used, used)]
    B = np.array([[1.0], [lag]])[used]
    C = np.array([[ki, -kd * lag]])[:, used]
    D = np.array([[kp + kd * lag]])
    return StateSpace(A, B, C, D, [input_name], [output_name], name=name, input_units=[input_unit], output_units=[output_unit])
