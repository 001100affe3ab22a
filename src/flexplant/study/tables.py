"""Tables of a study."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flexplant.model.component import Component
from flexplant.modes import Modes
from flexplant.verification import CheckReport, Table
from flexplant.verification.reduction_range import TITLE


def component_text(component: Component, report: CheckReport) -> str:
    """A component's size, checks, mass properties and fixed-interface modes, for a terminal."""
    head = f"{component.name}: {component.n_boundary} boundary DOF at nodes {component.boundary.nodes}, {component.n_modal} modal"
    recovery = [f"recovery {r.name!r}: {len(r.labels)} rows" for r in component.recovery.values()]
    return "\n\n".join(["\n".join([head, *recovery]), str(report), str(fixed_interface_table(component))]) + "\n"


def fixed_interface_table(component: Component, count: int = 20) -> Table:
    """The first fixed-interface modes (residual vectors among them, as the file has them)."""
    hz = component.fixed_interface_hz
    rows = tuple((i + 1, int(component.modal_ids[i]), float(hz[i])) for i in range(min(count, hz.size)))  # type: ignore[index]
    more = f", first {count} of {hz.size}" if hz.size > count else ""
    return Table(f"Fixed-interface modes of {component.name}{more}", ("mode", "id", "Hz"), rows)


def response_table(response: xr.DataArray) -> Table:
    """Magnitude and phase of every entry of a response at its first frequency."""
    at = response.isel(frequency=0)
    pairs = [(y, u, complex(at.sel(output=y, input=u))) for u in at["input"].values for y in at["output"].values]
    rows = tuple((str(y), str(u), abs(value), float(np.degrees(np.angle(value)))) for y, u, value in pairs)
    title = f"Response at {float(response['frequency'][0]):g} Hz"
    return Table(title, ("output", "input", "magnitude, SI", "phase [deg]"), rows)


def modes_table(modes: Modes, count: int = 40) -> Table:
    """The first free-free modes."""
    rows = tuple((i + 1, float(hz), "rigid body" if i < modes.n_rigid else "") for i, hz in enumerate(modes.frequency_hz[:count]))
    more = f", first {count} of {len(modes)}" if len(modes) > count else ""
    return Table(f"Modes of the coupled system{more}", ("mode", "Hz", ""), rows)


def worst_rows(table: Table, count: int = 12) -> Table:
    """A long table of estimated errors cut to its largest ones, for a terminal; any other table as it is."""
    if not table.title.startswith(TITLE) or len(table.rows) <= count:
        return table
    errors = np.array([row[2] for row in table.rows], dtype=float)
    shown = np.sort(np.argsort(-errors, kind="stable")[:count])
    return Table(f"{table.title} (largest {count})", table.columns, tuple(table.rows[int(k)] for k in shown))
