"""Structural damping in Nastran's files: K4, the sum of GE K_e over elements, so that harmonic motion has K + i K4.

It is element damping (GE of materials, PELAS, PBUSH, and K42GG input); the overall coefficient PARAM,G is not part of it, nor of
the file. Sources: OptiStruct reference guide, PARAM,POSTEXT (KHH) and K42GG; MSC Nastran dynamic analysis guide, damping.
"""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from flexplant.errors import InputError, ReadError
from flexplant.model.arrays import Matrix

Found = TypeVar("Found")
CHOICES = ("read", "ignore", "error")


def check_choice(structural: str) -> None:
    """InputError unless it is one of "read", "ignore" and "error"."""
    if structural not in CHOICES:
        raise InputError(f"structural={structural!r:.60}: use 'read', 'ignore' or 'error'")


def present(matrix: Matrix | None) -> Matrix | None:
    """None for the 1 x 1 zero that Nastran writes for what is not there."""
    return None if matrix is None or (matrix.shape == (1, 1) and not abs(matrix).max()) else matrix


def taken(path: Path, matrix: Found | None, structural: str, name: str) -> Found | None:
    """The matrix where it is to be read, None where it is to be ignored; ReadError where it must not be there."""
    if matrix is not None and structural == "error":
        raise ReadError(path, f"has structural damping {name}; pass structural='read', or 'ignore' and give modal damping")
    return matrix if structural == "read" else None
