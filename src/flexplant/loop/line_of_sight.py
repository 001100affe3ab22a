"""The line-of-sight loop: structure, lens, steering mirror and proportional controller (equations 28-33, 37-38)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy.typing as npt

from flexplant.blocks.basic import summing_junction
from flexplant.blocks.controllers import proportional
from flexplant.blocks.mirror import steering_mirror
from flexplant.blocks.optics import AXES, angle_sensor, checked_axes, focal_length_of, line_of_sight_geometry, per_axis, thin_lens
from flexplant.errors import InputError, expect, nearest
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.ports import LinearBlock
from flexplant.model.arrays import checked_switch
from flexplant.plant.channels import listed_names
from flexplant.plant.state_space import StateSpace


@dataclass(frozen=True, eq=False, kw_only=True)
class LineOfSight:
    """Parameters of the loop. The spot is r = f (dx / f + 2 alpha); the measured spot counts as the mirror angle r / (2 f).

    focal_length: m. gain: Kp on that angle, mirror_omega: rad/s, mirror_zeta: damping ratio; each one value or one per axis.
    The loop gain per axis is Kp T(s), T = omega^2 / (s^2 + 2 zeta omega s + omega^2), and the disturbance dx enters the output:
    r = dx / (1 + Kp T). Raises InputError for values that cannot be used.
    """

    focal_length: float
    gain: npt.ArrayLike
    mirror_omega: npt.ArrayLike
    mirror_zeta: npt.ArrayLike
    axes: Sequence[str] = AXES

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", checked_axes(self.axes))
        focal_length_of(self.focal_length, "line of sight")
        for kind in ("gain", "mirror_omega", "mirror_zeta"):
            object.__setattr__(self, kind, per_axis(getattr(self, kind), self.axes, f"line of sight: {kind}"))
        _mirror(self)  # says what a mirror cannot be


SIGNALS = {"spot": "geometry", "angle": "mirror", "voltage": "controller", "tilt": "lens"}


def line_of_sight_diagram(
    los: LineOfSight,
    plant: LinearBlock | None = None,
    *,
    plant_outputs: Sequence[str] | None = None,
    closed: bool = True,
    commands: bool = False,
    signals: Sequence[str] = ("spot",),
) -> Diagram:
    """The whole loop as a Diagram: plant -> lens -> geometry -> sensor -> error -> controller -> mirror -> geometry.

    plant: its inputs become external inputs under their own names; plant_outputs: its lens displacements in the order of the
    axes (all its outputs by default). Without a plant the displacements "displacement_x", ... (m) are external inputs.
    closed=False keeps every block and sets the gain to zero: the mirror stands still. commands=True adds "command_x", ... (rad).
    signals: what to read, of spot (m), angle (mirror, rad), voltage (V), tilt (lens, rad); outputs "spot_x", "spot_y", ...
    Raises InputError if the plant's outputs do not match the axes, or for an unknown signal; DiagramError from the wiring.
    """
    expect(los, LineOfSight, "line_of_sight_diagram", "LineOfSight(focal_length=, gain=, mirror_omega=, mirror_zeta=) makes one")
    if not (plant is None or isinstance(plant, LinearBlock)):
        raise InputError(f"line_of_sight_diagram: plant is a ModalPlant or a StateSpace, got {type(plant).__name__}")
    checked_switch(closed, "line_of_sight_diagram: closed")
    checked_switch(commands, "line_of_sight_diagram: commands")
    f, axes = los.focal_length, los.axes
    blocks = {
        "lens": thin_lens(f, axes=axes),
        "geometry": line_of_sight_geometry(f, axes=axes),
        "sensor": angle_sensor(f, axes=axes),
        **_servo(los if closed else replace(los, gain=0.0), commands=commands),
    }
    wires = [
        *_wires("lens.tilt", "geometry.tilt", axes),
        *_wires("mirror.angle", "geometry.angle", axes),
        *_wires("geometry.spot", "sensor.spot", axes),
        *[(f"sensor.angle_{axis}", f"error_{axis}.measured") for axis in axes],
        *_servo_wires(axes),
    ]
    inputs = {f"command_{axis}": f"error_{axis}.command" for axis in axes} if commands else {}
    if plant is None:
        inputs = {**dict(_wires("displacement", "lens.decenter", axes)), **inputs}
    else:
        blocks = {"plant": plant, **blocks}
        wires += [
            (f"plant.{y}", f"lens.decenter_{axis}")
            for y, axis in zip(_lens_outputs(plant, plant_outputs, axes), axes, strict=True)
        ]
        inputs = {**{name: f"plant.{name}" for name in plant.inputs}, **inputs}
    return Diagram(blocks=blocks, connections=wires, inputs=inputs, outputs=_readouts(signals, axes), name="line_of_sight")


def loop_gain(los: LineOfSight) -> StateSpace:
    """L(s) = Kp T(s), diagonal: angle error "error_x", ... to mirror angle "angle_x", ... (rad)."""
    expect(los, LineOfSight, "loop_gain", "LineOfSight(focal_length=, gain=, mirror_omega=, mirror_zeta=) makes one")
    return close(
        Diagram(
            blocks={"controller": _controller(los), "mirror": _mirror(los)},
            connections=_wires("controller.voltage", "mirror.voltage", los.axes),
            inputs=dict(_wires("error", "controller.error", los.axes)),
            outputs=_readouts(["angle"], los.axes),
            name="loop_gain",
        )
    )


def closed_loop_transfer(los: LineOfSight) -> StateSpace:
    """L / (1 + L), diagonal: commanded mirror angle "command_x", ... to mirror angle "angle_x", ... (rad)."""
    expect(los, LineOfSight, "closed_loop_transfer", "LineOfSight(focal_length=, gain=, mirror_omega=, mirror_zeta=) makes one")
    feedback = [(f"mirror.angle_{axis}", f"error_{axis}.measured") for axis in los.axes]
    return close(
        Diagram(
            blocks=_servo(los, commands=True),
            connections=[*feedback, *_servo_wires(los.axes)],
            inputs={f"command_{axis}": f"error_{axis}.command" for axis in los.axes},
            outputs=_readouts(["angle"], los.axes),
            name="closed_loop",
        )
    )


def output_sensitivity(los: LineOfSight) -> StateSpace:
    """1 / (1 + L), diagonal: lens displacement "displacement_x", ... (the output disturbance) to spot "spot_x", ... (m)."""
    expect(los, LineOfSight, "output_sensitivity", "LineOfSight(focal_length=, gain=, mirror_omega=, mirror_zeta=) makes one")
    return replace(close(line_of_sight_diagram(los)), name="output_sensitivity")


def _servo(los: LineOfSight, *, commands: bool) -> dict[str, LinearBlock]:
    """Error junction per axis, controller, mirror."""
    signs = {"command": 1.0, "measured": -1.0} if commands else {"measured": -1.0}
    junctions = {f"error_{a}": summing_junction(signs, output_name="error", unit="rad", name=f"error_{a}") for a in los.axes}
    return {**junctions, "controller": _controller(los), "mirror": _mirror(los)}


def _controller(los: LineOfSight) -> StateSpace:
    return proportional(los.gain, axes=los.axes)


def _mirror(los: LineOfSight) -> StateSpace:
    return steering_mirror(los.mirror_omega, los.mirror_zeta, axes=los.axes)


def _servo_wires(axes: Sequence[str]) -> list[tuple[str, str]]:
    errors = [(f"error_{axis}.error", f"controller.error_{axis}") for axis in axes]
    return [*errors, *_wires("controller.voltage", "mirror.voltage", axes)]


def _wires(start: str, end: str, axes: Sequence[str]) -> list[tuple[str, str]]:
    return [(f"{start}_{axis}", f"{end}_{axis}") for axis in axes]


def _readouts(signals: Sequence[str], axes: Sequence[str]) -> dict[str, str]:
    for signal in listed_names(signals, "line of sight: signals"):
        if signal not in SIGNALS:
            raise InputError(f"line of sight: no signal {signal!r:.60}." + nearest(signal, SIGNALS))
    return {f"{signal}_{axis}": f"{SIGNALS[signal]}.{signal}_{axis}" for signal in signals for axis in axes}


def _lens_outputs(plant: LinearBlock, names: Sequence[str] | None, axes: Sequence[str]) -> list[str]:
    found = list(plant.outputs) if names is None else listed_names(names, "line of sight: plant_outputs")
    if len(found) != len(axes):
        raise InputError(
            f"line of sight: {len(found)} plant outputs {found[:6]} for the axes {', '.join(axes)}; "
            "name the lens displacement of each axis in plant_outputs"
        )
    return found
