"""The files of a study: report, plant, labelled results, tables."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import xarray as xr

from flexplant.io import write_plant, write_results
from flexplant.report import StructureView, render
from flexplant.study.reporting import report
from flexplant.study.result import LineOfSightResult, StudyResult, TruthResult
from flexplant.study.schema import StudySpec
from flexplant.study.schema_outputs import ExportSpec
from flexplant.verification import Table

NAMES = {"report": "report.html", "plant": "plant.npz", "plant for MATLAB": "plant.mat", "results": "results.nc"}


def first_names(study: StudySpec) -> list[str]:
    """The files of a study that are known before it has run."""
    return [*NAMES.values(), *(f"{wanted.name}.{wanted.to}" for wanted in study.export)]


def write_files(result: StudyResult, view: StructureView | None, folder: Path) -> dict[str, str]:
    """Write everything into `folder`; file names by kind."""
    names = dict(NAMES)
    write_plant(result.plant, folder / names["plant"])
    write_plant(result.plant, folder / names["plant for MATLAB"])
    for wanted in result.study.export:
        names[f"plant as {wanted.to}: {wanted.name}"] = _export(result, wanted, folder)
    write_results(dataset(result), folder / names["results"])
    names["tables"] = "tables.txt"
    (folder / names["tables"]).write_text("\n\n".join([str(result.checks), *map(str, result.tables)]) + "\n", encoding="utf-8")
    for table in result.tables:
        name = f"{_slug(table.title)}.csv"
        _write_csv(table, folder / name)
        names[table.title] = name
    (folder / names["report"]).write_text(render(report(result, view)), encoding="utf-8")
    return names


def _export(result: StudyResult, wanted: ExportSpec, folder: Path) -> str:
    given: dict[str, Any] = {"dt": wanted.dt_s, "hold": wanted.hold, "version": wanted.fmi}
    options = {key: value for key, value in given.items() if value is not None}
    return write_plant(result.plant, folder / f"{wanted.name}.{wanted.to}", **options).name


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:60]


def _write_csv(table: Table, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(table.columns)
        writer.writerows(table.rows)


def dataset(result: StudyResult) -> xr.Dataset:
    """All labelled results as one data set; each kind has dimensions of its own."""
    modes, plant = result.modes, result.plant
    variables: dict[str, xr.DataArray] = {
        "mode_frequency_hz": xr.DataArray(modes.frequency_hz, dims="mode"),
        "plant_frequency_hz": xr.DataArray(plant.frequency_hz, dims="plant_mode"),
        "plant_damping_ratio": xr.DataArray(plant.zeta, dims="plant_mode"),
        "frequency_response": result.response,
    }
    variables |= {} if result.truth is None else _truth(result.truth)
    variables |= {} if result.line_of_sight is None else _line_of_sight(result.line_of_sight)
    plain = {name: data.reset_coords(drop=True) for name, data in variables.items()}  # unit texts differ between results
    return xr.Dataset(plain, attrs={"title": result.study.title, "statement": result.study.statement, **result.provenance})


def _truth(truth: TruthResult) -> dict[str, xr.DataArray]:
    kinds = {"direct": truth.direct, "plant": truth.plant, "plant_uncorrected": truth.uncorrected, "plant_viscous": truth.viscous}
    kinds |= {} if truth.second is None else {"second_plant": truth.second}
    return {f"comparison_{name}": data[0, 0].drop_vars(["output", "input"]).rename(frequency="comparison_frequency")
            for name, data in kinds.items()}  # fmt: skip


def _line_of_sight(loop: LineOfSightResult) -> dict[str, xr.DataArray]:
    names = {"frequency": "loop_frequency", "output": "loop_output", "input": "loop_input"}
    spot = [_stacked([data["outputs"] for data in cases.values()], "case", list(cases)) for cases in loop.histories.values()]
    over_time = _stacked(spot, "wheel_hz", list(loop.histories))
    gains = _stacked(list(loop.singular_values.values()), "case", list(loop.singular_values))
    out = {
        "singular_values": gains.rename(frequency="loop_frequency"),
        "closed_loop": loop.closed_loop.rename(names),
        "sensitivity": loop.sensitivity.rename({**names, "output": "spot", "input": "displacement"}),
        "spot_over_time": over_time.rename(output="spot"),
    }
    if loop.sweep is not None:
        out["spot_rms_over_speed"] = loop.sweep["rms"].rename(output="spot", omega_hz="swept_wheel_hz")
    return out


def _stacked(parts: list[xr.DataArray], dim: str, names: list[Any]) -> xr.DataArray:
    """Arrays along a new first dimension with these coordinates."""
    together: xr.DataArray = xr.concat(parts, dim=dim).assign_coords({dim: names})
    return together
