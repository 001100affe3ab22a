"""What a study file may say about its results: response grid, report, files for other programs."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from flexplant.io.write.c_text import KEYWORDS
from flexplant.study.fields import Positive, Section


class ResponseSpec(Section):
    """Frequencies of a response: a list, or a range to which points at the resonances are added."""

    from_hz: Positive = Field(default=1.0, description="lowest frequency")
    to_hz: Positive = Field(default=500.0, description="highest frequency")
    points: int = Field(default=600, ge=2, le=200_000, description="number of frequencies in the range, resonances are added")
    spacing: Literal["log", "linear"] = Field(default="log", description="spacing of the range")
    frequency_hz: list[Positive] | None = Field(default=None, description="exactly these frequencies instead of a range")

    @model_validator(mode="after")
    def _range(self) -> ResponseSpec:
        if self.to_hz <= self.from_hz:
            raise ValueError(f"to_hz ({self.to_hz:g}) must be larger than from_hz ({self.from_hz:g})")
        return self


class ReportSpec(Section):
    """What the report shows."""

    mode_shapes: list[int] = Field(
        default=[],
        description="numbers of the animated modes, counted from 1 with the rigid-body modes",
    )
    display: str = Field(default="display", description="name of the recovery that moves the display nodes")


class ExportSpec(Section):
    """The plant in one more format, for another program (plant.npz and plant.mat are always written)."""

    to: Literal["c", "fmu", "h5", "jl", "m", "mat", "npz"] = Field(
        description="ending that chooses the format: C99 source, FMU, HDF5, Julia, MATLAB/Octave script, .mat, .npz",
    )
    name: str = Field(
        default="plant",
        pattern="^[A-Za-z][A-Za-z0-9_]{0,59}$",
        description="file name without ending, and the model's name inside the format",
    )
    dt_s: Positive | None = Field(default=None, description="c: sample time, seconds; fmu: communication step to suggest")
    hold: Literal["zero", "first"] | None = Field(default=None, description="c: inputs held over a step (left out), or linear")
    fmi: Literal[2, 3] | None = Field(default=None, description="fmu: version of FMI, 2 (left out) or 3 with arrays")

    @model_validator(mode="after")
    def _options_of_the_format(self) -> ExportSpec:
        if self.to == "c" and self.dt_s is None:
            raise ValueError("C source runs at a fixed step: give dt_s, in seconds")
        if self.to == "m" and self.name in KEYWORDS:
            raise ValueError(f"{self.name!r} is a word of MATLAB's own, so the function could not be called; give another name")
        for key, formats in (("dt_s", ("c", "fmu")), ("hold", ("c",)), ("fmi", ("fmu",))):
            if getattr(self, key) is not None and self.to not in formats:
                raise ValueError(f"{key} is an option of {' and '.join(formats)}, not of {self.to}")
        return self
