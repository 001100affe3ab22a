"""MATLAB `.mat` (version 5): A, B, C, D (E), dt, InputName, OutputName, and the modal arrays of a modal plant.

In MATLAB or Octave:  p = load("plant.mat"); sys = ss(p.A, p.B, p.C, p.D, "InputName", p.InputName, "OutputName", p.OutputName)
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexplant.io.formats import Writer
from flexplant.io.parse.own_plant import Plant, matlab_variables
from flexplant.io.write.ownership import mark

NAME = "mat"
HEADER_TEXT = 116  # bytes


def write_plant(plant: Plant, path: Path) -> None:
    """A plant; dt = 0 means continuous time."""
    save(matlab_variables(plant), path, NAME)


def save(variables: dict[str, Any], path: Path, format_name: str) -> None:
    """The variables, and in the free text of the header who wrote them."""
    from scipy.io import savemat

    with path.open("wb") as stream:
        savemat(stream, variables, do_compression=True, oned_as="column")
        stream.seek(0)
        stream.write(f"MATLAB 5.0 MAT-file, {mark(format_name)}".ljust(HEADER_TEXT).encode())


WRITER = Writer(name=NAME, description="MATLAB .mat", suffixes=(".mat",), writers={"write_plant": write_plant})
