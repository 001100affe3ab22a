"""Ansys matrices as Harwell-Boeing text, `HBMAT` of a `.full` or a substructure's `.sub` file: a file each for K, M (and C).

What the rows are: the `.mapping` that HBMAT writes with Mapping=YES (equation, node, UX), or a table `.csv` of node,direction
(direction 0 is a modal coordinate of a CMS superelement), beside the stiffness file under its stem, or mapping=. The binary
`.sub` and `.emat` files themselves are recognised, and refused with the commands that make text of them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.ansys_binary import binary_kind
from flexplant.io.parse.ansys_mapping import read_coordinates, read_equations
from flexplant.io.parse.dof_table import read_dof_table
from flexplant.io.parse.files import provenance, read_head, sibling
from flexplant.io.parse.harwell_boeing import looks_like_harwell_boeing, read_harwell_boeing
from flexplant.io.parse.listed_rows import listed_component, listed_model
from flexplant.io.parse.names import name_from
from flexplant.io.parse.number_text import read_lines
from flexplant.io.parse.partner_files import maybe_partner, partner
from flexplant.model.arrays import Matrix
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes

REFUSED = (".emat", ".sub")
ADVICE = (
    "is Ansys' binary {kind} file, which is not read; make text of it in /AUX2: FILE,job,{ending}  then  "
    "HBMAT,job_stiff,matrix,,ASCII,STIFF,NO,YES  and  HBMAT,job_mass,matrix,,ASCII,MASS,NO,YES"
)


def sniff(head: bytes, path: Path) -> bool:
    """Harwell-Boeing text, or an Ansys binary file with matrices under its usual ending."""
    kind = binary_kind(head)
    return looks_like_harwell_boeing(head) or (kind in REFUSED and path.suffix.lower() == kind)


def read_model(
    path: Path,
    *,
    name: str | None = None,
    mass: str | Path | None = None,
    mapping: str | Path | None = None,
    coordinates: str | Path | None = None,
    geometry: str | Path | None = None,
) -> FiniteElementModel:
    """The model from its stiffness file.

    mass: its file, None for the name with "mass" in place of "stiff". mapping: `.mapping` or `.csv`. coordinates: a table
    "node x y z" (NLIST or *VWRITE), None for the positions of the `.csv`, if any.
    """
    given = _parts(path, name, mass, mapping, geometry if coordinates is None else coordinates)
    return listed_model(**given)


def read_component(
    path: Path,
    *,
    name: str | None = None,
    mass: str | Path | None = None,
    mapping: str | Path | None = None,
    coordinates: str | Path | None = None,
    geometry: str | Path | None = None,
) -> Component:
    """A superelement (HBMAT of a `.sub`): the rows of the table with direction 0 are modal; arguments as `read_model`."""
    given = _parts(path, name, mass, mapping, geometry if coordinates is None else coordinates)
    return listed_component(**given)


def _parts(path: Path, name: str | None, mass: Any, mapping: Any, coordinates: Any) -> dict[str, Any]:
    _refuse_binary(path)
    mass_file = partner(path, mass, "stiff", "mass", "mass")
    damping_file = maybe_partner(path, "stiff", "damp")
    table = _table(path, mapping)
    stiffness = read_harwell_boeing(path)
    dofs, nodes = _rows(table, stiffness.shape[0])
    if coordinates is not None:
        nodes = read_coordinates(Path(coordinates))
    matrices: dict[str, Matrix | None] = {"mass": read_harwell_boeing(mass_file), "stiffness": stiffness}
    matrices["damping"] = None if damping_file is None else read_harwell_boeing(damping_file)
    others = tuple(f for f in (mass_file, damping_file, table, coordinates) if f is not None)
    source = provenance(path, FORMAT.name, __name__, tuple(Path(f) for f in others))
    return {"path": path, "matrices": matrices, "dofs": dofs, "nodes": nodes, "name": name or name_from(path), "source": source}


def _refuse_binary(path: Path) -> None:
    kind = binary_kind(read_head(path))
    if kind is not None:
        raise ReadError(path, ADVICE.format(kind=kind, ending=kind[1:]))


def _table(path: Path, given: str | Path | None) -> Path:
    found = Path(given) if given is not None else sibling(path, ".mapping") or sibling(path, ".csv")
    if found is None:
        raise ReadError(path, "needs its .mapping (HBMAT with Mapping=YES) or a .csv of node,direction beside it, or mapping=")
    return found


def _rows(table: Path, n: int) -> tuple[DofSet, Nodes | None]:
    if table.suffix.lower() == ".csv":
        read = read_dof_table(table)
        return read.dofs, read.nodes
    return read_equations(table, read_lines(table), n), None


FORMAT = Format(
    name="ansys_hbmat",
    description="Ansys matrices as Harwell-Boeing text: HBMAT of .full and .sub, with .mapping or .csv",
    suffixes=(".matrix",),
    sniff=sniff,
    tested_against="scipy.io.hb_write",
    readers={"read_model": read_model, "read_component": read_component},
)
