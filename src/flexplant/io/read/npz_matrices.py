"""Plain `.npz` matrices with a sidecar (see `flexplant.io.parse.sidecar`).

A matrix is an array of that name, or sparse as its CSR parts name.data, name.indices, name.indptr, name.shape. Without
`matrices` in the sidecar the names are mass, stiffness.
"""

from __future__ import annotations

from pathlib import Path

from flexplant.io.formats import Format
from flexplant.io.parse.npz import looks_like_npz, member_names, read_npz
from flexplant.io.parse.npz_matrices import unpack_matrices
from flexplant.io.parse.own_readers import HEADER
from flexplant.io.parse.sidecar import sidecar_path
from flexplant.io.parse.sidecar_readers import sidecar_readers
from flexplant.model.arrays import Matrix

NAME = "npz_matrices"


def sniff(head: bytes, path: Path) -> bool:
    """A zip archive of arrays with a sidecar beside it; one of our own says itself what it is, whatever lies beside it."""
    return looks_like_npz(head) and sidecar_path(path) is not None and HEADER not in member_names(path)


def _load(path: Path, max_bytes: float) -> dict[str, Matrix]:
    return unpack_matrices(read_npz(path, max_bytes=max_bytes), path)


FORMAT = Format(
    name=NAME,
    description="numpy .npz matrices with a YAML sidecar",
    suffixes=(".npz",),
    sniff=sniff,
    tested_against="numpy, scipy",
    readers=sidecar_readers(_load, NAME),
)
