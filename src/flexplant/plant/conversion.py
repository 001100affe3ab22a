"""To and from python-control and scipy.signal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.signal

from flexplant.errors import InputError, MissingExtraError
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace, state_space


def to_control(plant: ModalPlant | StateSpace | Descriptor) -> Any:
    """control.StateSpace with the plant's names; python-control allows no dots in names, so "bus.101.1" becomes "bus_101_1".

    Raises MissingExtraError without python-control, InputError without inputs, and where two names become one.
    """
    try:
        import control
    except ImportError:
        raise MissingExtraError("control", "control") from None
    s = state_space(plant)
    if not s.inputs:
        raise InputError(f"to_control: {s.name!r} has no inputs, and python-control has no such systems; select at least one")
    names = {kind: _undotted(getattr(s, kind), kind) for kind in ("inputs", "outputs")}
    return control.StateSpace(s.A, s.B, s.C, s.D, 0 if s.dt is None else s.dt, name=s.name.replace(".", "_"), **names)


def _undotted(names: Sequence[str], kind: str) -> list[str]:
    plain = [name.replace(".", "_") for name in names]
    if len(set(plain)) != len(plain):
        twice = next(name for name in plain if plain.count(name) > 1)
        raise InputError(f"to_control: two {kind} become {twice!r} without dots; rename one of them")
    return plain


def from_control(
    system: Any, *, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None, name: str | None = None
) -> StateSpace:
    """StateSpace of a control.StateSpace (or transfer function), its names kept unless others are given.

    Raises MissingExtraError without python-control, InputError for anything else, for an unspecified sample time, and for a
    transfer function with more zeros than poles.
    """
    try:
        import control
    except ImportError:
        raise MissingExtraError("control", "control") from None
    if isinstance(system, control.TransferFunction):
        system = _realised(system, control)
    if not isinstance(system, control.StateSpace):
        raise InputError(f"from_control needs a control.StateSpace or TransferFunction, got {type(system).__name__}")
    if system.dt is True:
        raise InputError(
            "from_control: the system is discrete with an unspecified sample time (dt=True); give it a dt in seconds"
        )
    dt = None if not system.dt else float(system.dt)
    given_inputs = system.input_labels if inputs is None else inputs
    given_outputs = system.output_labels if outputs is None else outputs
    label = system.name if name is None else name
    return StateSpace(system.A, system.B, system.C, system.D, given_inputs, given_outputs, dt=dt, name=label)


def _realised(system: Any, control: Any) -> Any:
    degrees = [(len(n), len(d)) for ns, ds in zip(system.num, system.den, strict=True) for n, d in zip(ns, ds, strict=True)]
    if any(zeros > poles for zeros, poles in degrees):
        raise InputError("from_control: the transfer function has more zeros than poles, thus no state space; add a roll-off")
    return control.ss(system)


def to_scipy(plant: ModalPlant | StateSpace | Descriptor) -> Any:
    """scipy.signal.StateSpace (continuous) or its discrete kind with dt; scipy keeps no names."""
    s = state_space(plant)
    matrices = (s.A, s.B, s.C, s.D)
    return scipy.signal.StateSpace(*matrices) if s.dt is None else scipy.signal.StateSpace(*matrices, dt=s.dt)


def from_scipy(
    system: Any, *, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None, name: str = "plant"
) -> StateSpace:
    """StateSpace of any scipy.signal linear system; names default to u1, u2, ... and y1, y2, ...

    Raises InputError for anything else.
    """
    if not isinstance(system, (scipy.signal.lti, scipy.signal.dlti)):
        raise InputError(f"from_scipy needs a scipy.signal lti or dlti system, got {type(system).__name__}")
    s = system.to_ss()
    ny, nu = np.shape(s.D)
    given_inputs = [f"u{k + 1}" for k in range(nu)] if inputs is None else inputs
    given_outputs = [f"y{k + 1}" for k in range(ny)] if outputs is None else outputs
    return StateSpace(s.A, s.B, s.C, s.D, given_inputs, given_outputs, dt=s.dt, name=name)
