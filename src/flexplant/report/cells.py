"""How table cells and numbers are written in the page."""

from __future__ import annotations

import math
from numbers import Integral, Real

import numpy as np

from flexplant.model.table import Table

DIGITS = 6


def number_text(value: object, digits: int = DIGITS) -> str:
    """A cell as text: numbers to `digits` significant digits without noise, True and False as words, None as a dash."""
    if value is None:
        return "–"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, Integral):
        return str(int(value))
    if isinstance(value, Real):
        return _real_text(float(value), digits)
    return str(value)


def _real_text(value: float, digits: int) -> str:
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0:
        return "0"
    if 1e-4 <= abs(value) < 1e7:
        # an error of 0.0021 % needs no six digits, a frequency of 107.001 Hz does
        text = f"{value:.{digits if abs(value) >= 1 else min(digits, 4)}g}"
        return f"{value:.0f}" if "e" in text else text
    mantissa, exponent = f"{value:.{min(digits, 4) - 1}e}".split("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"


def is_number(value: object) -> bool:
    """Whether the cell is set to the right, as numbers are."""
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)


def number_columns(table: Table) -> list[bool]:
    """Which columns hold numbers (and blanks or "~0"), (n columns,)."""
    columns = zip(*table.rows, strict=True) if table.rows else [()] * len(table.columns)
    return [any(map(is_number, column)) and all(map(_fits_numbers, column)) for column in columns]


def _fits_numbers(value: object) -> bool:
    return value is None or is_number(value) or str(value).strip().lstrip("~<>≈").replace(".", "", 1).isdecimal() or value == ""


def is_digest(value: object) -> bool:
    """Whether the text is a long hexadecimal digest, which may break anywhere."""
    text = str(value).removeprefix("sha256:")
    return len(text) >= 32 and all(c in "0123456789abcdef" for c in text)
