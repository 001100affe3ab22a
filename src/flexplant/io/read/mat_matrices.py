"""MATLAB `.mat` matrices (up to version 7.2; dense or sparse) with a sidecar (see `flexplant.io.parse.sidecar`)."""

from __future__ import annotations

from pathlib import Path

from flexplant.io.formats import Format
from flexplant.io.parse.mat5 import HEADER_BYTES, read_mat
from flexplant.io.parse.sidecar_readers import sidecar_readers
from flexplant.model.arrays import Matrix

NAME = "mat_matrices"


def sniff(head: bytes, path: Path) -> bool:  # noqa: ARG001  every sniff function has it
    """The text that MATLAB and scipy put first."""
    return head.startswith(b"MATLAB ") and len(head) > HEADER_BYTES


def _load(path: Path, max_bytes: float) -> dict[str, Matrix]:
    return read_mat(path, max_bytes=max_bytes)


FORMAT = Format(
    name=NAME,
    description="MATLAB .mat matrices with a YAML sidecar",
    suffixes=(".mat",),
    sniff=sniff,
    tested_against="scipy.io",
    readers=sidecar_readers(_load, NAME),
)
