"""A small report with one of everything, for the tests of the page."""

from collections.abc import Callable

import numpy as np
import xarray as xr

from flexplant.report import DisplayMesh, Plot, Report, Section, StructureView, Tile, figures
from flexplant.verification import Check, CheckReport, Table

HZ = np.geomspace(10, 1000, 300)
N_FIGURES = 6


def unchanged(text: str) -> str:
    return text


def box() -> StructureView:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 2.0)])
    quads = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
    mesh = DisplayMesh(np.arange(8), corners, quads, [[0, 1], [0, 7]])
    translation = np.tile([1.0, 0, 0], (8, 1))
    bending = corners[:, 2:] ** 2 * [0, 1.0, 0]
    return StructureView(mesh, np.array([translation, bending]), [0.0, 112.8], first_mode=1)


def checks(name: Callable[[str], str] = unchanged) -> CheckReport:
    return CheckReport(
        checks=(
            Check(name("rigid-body modes"), 6, 6, True, "", name("Nothing floats.")),
            Check(name("phase margin"), 0.81, 30.0, False, "deg", name("Lightly damped.")),
        ),
        tables=(
            Table(name("Frequencies"), (name("Mode"), "Hz", "Error (%)"), ((name("Axial 1"), 107.0, None), ("X", 112.756, 8e-4))),
        ),
        notes=(name("No shapes to compare."),),
    )


def plots(name: Callable[[str], str] = unchanged) -> list[Plot]:
    s = 2j * np.pi * HZ
    mirror = xr.DataArray(1e4 / (s**2 + 60 * s + 1e4), dims=("frequency",), coords={"frequency": HZ})
    time = np.arange(0, 0.5, 1e-3)
    spot = xr.DataArray(
        1e-6 * np.array([np.sin(200 * time), np.cos(200 * time)]),
        dims=("output", "time"),
        coords={"output": ["x", "y"], "time": time},
    )
    rms = xr.DataArray(HZ**2, dims=("speed",), coords={"speed": HZ})
    drawn = [
        figures.transfer_function({name("reduced"): mirror, "explicit": 1.01 * mirror}, title=name("Dish"), reference="explicit"),
        figures.sensitivity({name("S"): mirror}, marks=[figures.Mark(100, name("crossing"), -3)]),
        figures.time_histories({name("open loop"): spot}, labels={"x": name("x")}),
        figures.spot({name("open loop"): spot}, x="x", y="y"),
        figures.rms_over_speed({name("open loop"): rms}),
        figures.mode_contributions([107.0, 112.8], {name("x"): [1e-6, 1.0]}, names=[name("Axial"), "X"]),
    ]
    assert len(drawn) == N_FIGURES
    return [Plot(figure, name("A caption.")) for figure in drawn]


def full_report(name: Callable[[str], str] = unchanged) -> Report:
    """Every text passes through `name`, so that a test can make all of them hostile."""
    view = box()
    labelled = StructureView(
        view.mesh,
        view.shapes,
        view.frequency_hz,
        labels=[name("Tx"), name("X bending 1")],
        title=name("Modes"),
        caption=name("Turn it."),
    )
    return Report(
        title=name("ShockSat-like spacecraft"),
        subtitle=name("A surrogate"),
        summary=(name("The loop is stable."),),
        tiles=(Tile(name("Peak"), 675.4, name("Hz"), name("published: 675 Hz"), True), Tile("Text", name("dual"))),
        checks=checks(name),
        sections=(
            Section(name("Structure"), (name("The structure."), labelled)),
            Section(name("Checks"), (checks(name),)),
            Section(name("Figures"), (*plots(name), checks(name).tables[0])),
        ),
        provenance={name("Files"): {name("bus.OU1"): name("0123456789abcdef" * 4)}, "Settings": {"modes": 126, "damping": 0.005}},
    )
