"""What a study file may say about wheel, optics and controller."""

from __future__ import annotations

from pydantic import Field, model_validator

from flexplant.study.fields import Finite, NotNegative, Positive, Rotation, Section
from flexplant.study.schema_outputs import ResponseSpec


class WheelSpec(Section):
    """Harmonic reaction wheel (equation 34), the same amplitude for every component and harmonic."""

    node: str = Field(description="component.node the wheel acts on; its six directions must be plant inputs")
    amplitude: Positive = Field(description="N/Hz^2 for forces, N m/Hz^2 for moments")
    harmonics: list[Positive] = Field(min_length=1, description="multiples of the wheel speed")
    phases_deg: tuple[Finite, Finite, Finite, Finite, Finite, Finite] = Field(description="phase of Fx, Fy, Fz, Mx, My, Mz")
    orientation: Rotation | None = Field(
        default=None,
        description="rows: wheel axes in the node's frame; left out: the same axes",
    )
    speeds_hz: list[Positive] = Field(min_length=1, description="wheel speeds of the time histories")


class OpticsSpec(Section):
    """Thin lens and flat steering mirror (equations 28-32)."""

    x: str = Field(description="plant output that moves the lens in x")
    y: str = Field(description="plant output that moves the lens in y")
    axial: str | None = Field(default=None, description="plant output along the optical axis, shown beside x and y")
    focal_length_m: Positive = Field(description="metres")
    mirror_omega_rad_s: Positive = Field(description="natural frequency of the steering mirror, rad/s")
    mirror_zeta: NotNegative = Field(description="damping ratio of the steering mirror")


class ControllerSpec(Section):
    """Proportional control of the mirror (equation 33), on the spot turned into mirror angle, r / (2 f)."""

    proportional_gain: tuple[Positive, Positive] = Field(description="gain in x and y, V/rad")


class TimeSpec(Section):
    """Time histories."""

    duration_s: Positive = Field(description="seconds")
    step_s: Positive = Field(description="seconds")

    @model_validator(mode="after")
    def _length(self) -> TimeSpec:
        if not 2 <= self.duration_s / self.step_s <= 5_000_000:
            raise ValueError(f"duration_s / step_s gives {self.duration_s / self.step_s:.3g} steps; 2 to 5 million are possible")
        return self


class SweepSpec(Section):
    """RMS of the spot over the wheel speed."""

    from_hz: Positive = Field(description="lowest wheel speed")
    to_hz: Positive = Field(description="highest wheel speed")
    points: int = Field(default=400, ge=2, le=100_000, description="number of speeds")


class LineOfSightSpec(Section):
    """The wheel shakes the lens, the mirror steers the spot back."""

    wheel: WheelSpec
    optics: OpticsSpec
    controller: ControllerSpec
    time: TimeSpec
    sweep: SweepSpec | None = Field(default=None, description="RMS spot over wheel speed; left out: no sweep")
    frequency: ResponseSpec = Field(
        default=ResponseSpec(to_hz=2000.0),
        description="frequencies of singular values and loop curves",
    )
