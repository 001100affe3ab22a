"""Matrix Market files with a table of DOF: stiffness and mass (and damping) `.mtx`, and a `.csv` of node, direction (, x, y, z).

The mass is found by its name: "mass" in place of "stiffness" (or "stif"), or "M" in place of "K". The table is `<stem>.csv`,
`<stem>_dofs.csv`, or `dofs.csv` in the same folder. Rows with direction 0 are modal: then it is a component.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.dof_table import DofTable, read_dof_table
from flexplant.io.parse.files import provenance
from flexplant.io.parse.listed_rows import listed_component, listed_model
from flexplant.io.parse.matrix_market import looks_like_matrix_market, read_matrix_market
from flexplant.io.parse.names import name_from
from flexplant.io.parse.partner_files import maybe_partner
from flexplant.model.component import Component, FiniteElementModel

WORDS = (("stiffness", "mass", "damping"), ("stif", "mass", "damp"), ("K", "M", "C"))


def sniff(head: bytes, path: Path) -> bool:  # noqa: ARG001  every sniff function has it
    """A coordinate or array Matrix Market file that is not Ansys's."""
    return looks_like_matrix_market(head) and b"ANSYS" not in head[:400].upper()


def read_component(
    path: Path,
    *,
    name: str | None = None,
    mass: str | Path | None = None,
    damping: str | Path | None = None,
    dofs: str | Path | None = None,
) -> Component:
    """A component from its stiffness file; the other files are found by name where they are not given."""
    matrices, table, source = _read(path, mass, damping, dofs)
    return listed_component(path, matrices, table.dofs, table.nodes, name or name_from(path), source)


def read_model(
    path: Path,
    *,
    name: str | None = None,
    mass: str | Path | None = None,
    damping: str | Path | None = None,
    dofs: str | Path | None = None,
) -> FiniteElementModel:
    """A finite-element model from its stiffness file; the other files are found by name where they are not given."""
    matrices, table, source = _read(path, mass, damping, dofs)
    return listed_model(path, matrices, table.dofs, table.nodes, name or name_from(path), source)


def _read(path: Path, mass: Any, damping: Any, dofs: Any) -> tuple[dict[str, Any], DofTable, dict[str, Any]]:
    mass_file = Path(mass) if mass is not None else _beside(path, 1)
    if mass_file is None:
        raise ReadError(path, "needs a mass matrix: a file with 'mass' for 'stiffness' (or M for K) in its name, or mass=")
    damping_file = Path(damping) if damping is not None else _beside(path, 2)
    table_file = Path(dofs) if dofs is not None else _table(path)
    files = {"mass": mass_file, "stiffness": path, "damping": damping_file}
    matrices = {kind: None if file is None else read_matrix_market(file) for kind, file in files.items()}
    others = tuple(f for f in (mass_file, damping_file, table_file) if f is not None)
    return matrices, read_dof_table(table_file), provenance(path, FORMAT.name, __name__, others)


def _beside(path: Path, kind: int) -> Path | None:
    found = (maybe_partner(path, words[0], words[kind]) for words in WORDS)
    return next((file for file in found if file is not None and file.suffix == path.suffix), None)


def _table(path: Path) -> Path:
    candidates = [path.with_suffix(".csv"), path.with_name(f"{path.stem}_dofs.csv"), path.with_name("dofs.csv")]
    found = next((p for p in candidates if p.is_file()), None)
    if found is None:
        looked = ", ".join(p.name for p in candidates)
        raise ReadError(path, f"needs a table of the DOF of its rows (node,direction a line): {looked} beside it, or dofs=")
    return found


FORMAT = Format(
    name="matrix_market",
    description="Matrix Market .mtx with a .csv of the DOF",
    suffixes=(".mtx",),
    sniff=sniff,
    tested_against="scipy.io",
    readers={"read_component": read_component, "read_model": read_model},
)
