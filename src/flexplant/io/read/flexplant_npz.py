"""The project's own `.npz` of a component or model (layout: `flexplant.io.parse.own`)."""

from __future__ import annotations

from pathlib import Path

from flexplant.io.formats import Format
from flexplant.io.parse.npz import looks_like_npz, member_names, read_npz
from flexplant.io.parse.own_readers import HEADER, own_readers

NAME = "flexplant_npz"


def sniff(head: bytes, path: Path) -> bool:
    """A zip archive with our header among its arrays."""
    return looks_like_npz(head) and HEADER in member_names(path)


FORMAT = Format(
    name=NAME,
    description="flexplant's own .npz",
    suffixes=(".npz",),
    sniff=sniff,
    tested_against="itself, bit-equal",
    readers=own_readers(read_npz, NAME, __name__),
)
