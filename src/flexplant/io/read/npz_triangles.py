"""`*_KM.npz`: K and M as triangles with the DOF of every row: dof (n, 2), Ki, Kj, Kv, Mi, Mj, Mv (places from 0).

Node positions are not in the file; give a Nastran deck as `geometry` to have them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.bulk import read_cards
from flexplant.io.parse.coordinates import Geometry
from flexplant.io.parse.files import provenance
from flexplant.io.parse.names import name_from
from flexplant.io.parse.npz import MAX_BYTES, looks_like_npz, member_names, read_npz
from flexplant.io.parse.npz_matrices import triangle
from flexplant.io.parse.sidecar import sidecar_path
from flexplant.model.component import FiniteElementModel
from flexplant.model.dofs import DofSet

KEYS = ("dof", "Ki", "Kj", "Kv", "Mi", "Mj", "Mv")


def sniff(head: bytes, path: Path) -> bool:
    """A zip archive with these arrays."""
    return looks_like_npz(head) and sidecar_path(path) is None and set(KEYS) <= set(member_names(path))


def read_model(
    path: Path, *, name: str | None = None, geometry: str | Path | None = None, max_bytes: float = MAX_BYTES
) -> FiniteElementModel:
    """The model; geometry: a Nastran deck with the grids' positions and displacement frames."""
    arrays = read_npz(path, max_bytes=max_bytes)
    if missing := [k for k in KEYS if k not in arrays]:
        raise ReadError(path, f"has no arrays {', '.join(missing)}")
    dof = arrays["dof"]
    if dof.ndim != 2 or dof.shape[1] != 2 or dof.dtype.kind not in "iu":
        raise ReadError(path, f"must be integers of shape (n, 2), got {dof.dtype} {dof.shape}", record="dof")
    dofs = DofSet(dof[:, 0].astype(np.int64), dof[:, 1].astype(np.int64))
    deck = () if geometry is None else (Path(geometry),)
    return FiniteElementModel(
        name=name or name_from(path),
        mass=triangle(arrays, "M", len(dofs), path),
        stiffness=triangle(arrays, "K", len(dofs), path),
        dofs=dofs,
        nodes=None if geometry is None else Geometry.of(read_cards(geometry)).nodes(dofs.nodes),
        source=provenance(path, FORMAT.name, __name__, deck),
    )


FORMAT = Format(
    name="npz_triangles",
    description="K and M as triangles with the DOF of each row, *_KM.npz",
    suffixes=(".npz",),
    sniff=sniff,
    tested_against="MYSTRAN 18.0 matrices",
    readers={"read_model": read_model},
)
