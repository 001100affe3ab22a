"""MATLAB `.mat` (version 5): A, B, C, D (E), dt, InputName, OutputName, and the modal arrays of a modal plant.

In MATLAB or Octave:  p = load("plant.mat"); sys = ss(p.A, p.B, p.C, p.D, "InputName", p.InputName, "OutputName", p.OutputName)
"""

from __future__ import annotations

from pathlib import Path

from flexplant.io.formats import Writer
from flexplant.io.parse.own_plant import Plant, matlab_variables


def write_plant(plant: Plant, path: Path) -> None:
    """A plant; dt = 0 means continuous time."""
    from scipy.io import savemat

    with path.open("wb") as stream:
        savemat(stream, matlab_variables(plant), do_compression=True, oned_as="column")


WRITER = Writer(name="mat", description="MATLAB .mat", suffixes=(".mat",), writers={"write_plant": write_plant})
