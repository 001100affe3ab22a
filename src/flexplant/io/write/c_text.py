"""Pieces of C source: identifiers, strings and arrays that any C99 compiler takes, with every bit of the numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from flexplant.errors import InputError

PER_LINE = 4
KEYWORDS = ("break", "case", "catch", "classdef", "continue", "else", "elseif", "end", "for", "function", "global", "if",
            "otherwise", "parfor", "persistent", "return", "spmd", "switch", "try", "while")  # fmt: skip  # of MATLAB


def identifier(text: str) -> str:
    """A C identifier from any text."""
    name = re.sub(r"[^0-9A-Za-z]+", "_", text).strip("_") or "plant"
    return f"p_{name}" if name[0].isdigit() else name


def matlab_name(stem: str) -> str:
    """The stem of a `.m` file; InputError for one that MATLAB and Octave cannot call."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,62}", stem) or stem in KEYWORDS:
        mended = identifier(stem)[:63]
        other = f"{mended}_model" if mended in KEYWORDS else mended
        raise InputError(f"{stem + '.m'!r} cannot be called: MATLAB wants letters, digits and _ ; name it {other + '.m'!r}")
    return stem


def constants(prefix: str, names: Sequence[str]) -> list[str]:
    """One distinct constant a name: PREFIX_BUS_101_1."""
    out: list[str] = []
    for i, name in enumerate(names):
        constant = f"{prefix}_{identifier(name)}".upper()
        while constant in out:
            constant += f"_{i}"
        out.append(constant)
    return out


def string(text: str) -> str:
    """A C string literal, UTF-8."""
    plain = "".join(chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f"\\{b:03o}" for b in text.encode())
    return f'"{plain}"'


def comment(text: str) -> str:
    """Text that can stand in a comment."""
    return "".join(c if c.isprintable() else " " for c in text).replace("*/", "* /").replace("/*", "/ *")


def array(values: Any) -> str:
    """Initialiser of an array of any rank, every number as the shortest text that gives the same double."""
    given = np.asarray(values, dtype=float)
    if not np.isfinite(given).all():
        raise InputError("a plant with numbers that are not finite cannot be written as C source")
    if given.ndim > 1:
        return "{\n" + ",\n".join(array(part) for part in given) + "}"
    numbers = [repr(float(v)) for v in given]
    lines = [", ".join(numbers[i : i + PER_LINE]) for i in range(0, len(numbers), PER_LINE)]
    return "{" + ",\n ".join(lines) + "}"


def definition(kind: str, name: str, values: Any) -> str:
    """A constant array: kind name[n][m] = {...};"""
    shape = "".join(f"[{n}]" for n in np.shape(values))
    return f"static const {kind} {name}{shape} = {array(values)};\n"
