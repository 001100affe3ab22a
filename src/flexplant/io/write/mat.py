"""MATLAB `.mat` (version 5): A, B, C, D (E), dt, InputName, OutputName, and the modal arrays of a modal plant.

In MATLAB or Octave:  p = load("plant.mat"); sys = ss(p.A, p.B, p.C, p.D, "InputName", p.InputName, "OutputName", p.OutputName)
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flexplant.io.formats import Writer
from flexplant.io.parse.mat5 import CELL_CLASS, CHAR_CLASS, MATRIX
from flexplant.io.parse.own_plant import Plant, matlab_variables
from flexplant.io.write.ownership import mark

NAME = "mat"
HEADER_TEXT = 116  # bytes
INT8, INT32, UINT32, UTF16 = 1, 5, 6, 17


def write_plant(plant: Plant, path: Path) -> None:
    """A plant; dt = 0 means continuous time."""
    save(matlab_variables(plant), path, NAME)


def save(variables: dict[str, Any], path: Path, format_name: str) -> None:
    """The variables (matrices, structures of them, a text, or a tuple of texts as a cell column), and who wrote them.

    Texts are ours to write: scipy's are UTF-8 with a count of characters, which Octave takes for a count of bytes.
    """
    from scipy.io import savemat

    texts = {name: value for name, value in variables.items() if isinstance(value, (str, tuple))}
    with path.open("wb") as stream:
        savemat(stream, {n: v for n, v in variables.items() if n not in texts}, do_compression=True, oned_as="column")
        for name, value in texts.items():
            stream.write(_text(name, value) if isinstance(value, str) else _cells(name, value))
        stream.seek(0)
        stream.write(f"MATLAB 5.0 MAT-file, {mark(format_name)}".ljust(HEADER_TEXT).encode())


def _element(kind: int, data: bytes) -> bytes:
    return struct.pack("<2I", kind, len(data)) + data + bytes(-len(data) % 8)


def _array(name: str, of_class: int, shape: tuple[int, int], data: bytes) -> bytes:
    flags = _element(UINT32, struct.pack("<2I", of_class, 0))
    return _element(MATRIX, flags + _element(INT32, struct.pack("<2i", *shape)) + _element(INT8, name.encode()) + data)


def _text(name: str, text: str) -> bytes:
    """A row of characters in UTF-16, the units that MATLAB counts."""
    data = text.encode("utf-16-le", "surrogatepass")
    return _array(name, CHAR_CLASS, (1 if data else 0, len(data) // 2), _element(UTF16, data))


def _cells(name: str, texts: Sequence[str]) -> bytes:
    return _array(name, CELL_CLASS, (len(texts), 1), b"".join(_text("", text) for text in texts))


WRITER = Writer(
    name=NAME,
    description="MATLAB .mat",
    suffixes=(".mat",),
    writers={"write_plant": write_plant},
    tested_against="scipy.io; Octave 7 through `matlab_script`",
)
