"""`.npz` with several parts of a structure: K1, M1, lab1, K2, M2, lab2, ...; lab is (n, 2): node, direction of each row.

Node positions are not in the file; give a Nastran deck as `geometry` to have them.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.bulk import read_cards
from flexplant.io.parse.coordinates import Geometry
from flexplant.io.parse.files import provenance
from flexplant.io.parse.listed_rows import listed_model
from flexplant.io.parse.names import name_from
from flexplant.io.parse.npz import MAX_BYTES, looks_like_npz, member_names, read_npz
from flexplant.model.component import FiniteElementModel
from flexplant.model.dofs import DofSet


def parts(names: list[str]) -> list[int]:
    """Numbers of the parts that have K, M and lab."""
    found = {int(m[1]) for name in names if (m := re.fullmatch(r"lab(\d{1,6})", name))}
    return sorted(i for i in found if f"K{i}" in names and f"M{i}" in names)


def sniff(head: bytes, path: Path) -> bool:
    """A zip archive with K1, M1, lab1 (or other numbers)."""
    return looks_like_npz(head) and bool(parts(list(member_names(path))))


def read_model(
    path: Path,
    *,
    name: str | None = None,
    part: int | None = None,
    geometry: str | Path | None = None,
    max_bytes: float = MAX_BYTES,
) -> FiniteElementModel:
    """One part: its number, which may be left out where there is one. geometry: a Nastran deck with the grids."""
    arrays = read_npz(path, max_bytes=max_bytes)
    there = parts(list(arrays))
    if part is None and len(there) == 1:
        part = there[0]
    if part not in there:
        raise ReadError(path, f"has the parts {', '.join(map(str, there)) or 'none'}; pass part= (got {part!r})")
    label = arrays[f"lab{part}"]
    if label.ndim != 2 or label.shape[1] != 2 or label.dtype.kind not in "iu":
        raise ReadError(path, f"must be integers of shape (n, 2), got {label.dtype} {label.shape}", record=f"lab{part}")
    dofs = DofSet(label[:, 0].astype(np.int64), label[:, 1].astype(np.int64))
    deck = () if geometry is None else (Path(geometry),)
    nodes = None if geometry is None else Geometry.of(read_cards(geometry)).nodes(dofs.nodes)
    matrices = {"mass": arrays[f"M{part}"], "stiffness": arrays[f"K{part}"]}
    source = provenance(path, FORMAT.name, __name__, deck) | {"part": part}
    return listed_model(path, matrices, dofs, nodes, name or f"{name_from(path)}{part}", source)


FORMAT = Format(
    name="npz_parts",
    description="several parts in one .npz: K1, M1, lab1, ...",
    suffixes=(".npz",),
    sniff=sniff,
    tested_against="MSC Nastran 2018.2 results",
    readers={"read_model": read_model},
)
