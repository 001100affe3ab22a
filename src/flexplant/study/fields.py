"""Kinds of values in a study file, and paths that may not leave its folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo

from flexplant.errors import nearest

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]
Rotation = tuple[Vector, Vector, Vector]
NodeId = int
Directions = Annotated[str, Field(pattern="^[0-6]+$")]
NodeRange = NodeId | Annotated[str, Field(pattern=r"^\d{1,18}-\d{1,18}$")]  # 17, or "17-40"
DampingRatio = NotNegative | list[NotNegative] | list[tuple[NotNegative, NotNegative]]


LONGEST_RANGE = 100_000


def nodes_of(node: int | str) -> list[int]:
    """[17] of 17 or "17", all ids from 17 to 40 of "17-40". Raises ValueError for a text that is neither."""
    first, dash, last = str(node).partition("-")
    ids = range(int(first), int(last if dash else first) + 1)
    if not 0 < len(ids) <= LONGEST_RANGE:
        raise ValueError(f"{node!r} is no range of nodes from the lower to the higher one, at most {LONGEST_RANGE} of them")
    return list(ids)


def _inside(text: str, info: ValidationInfo) -> str:
    """The path as given, after checking that it exists and lies in the study's folder."""
    context = info.context
    if context is None:
        return text
    folder = Path(context["folder"]).resolve()
    path = (folder / text).resolve()
    if not context["allow_outside"] and not path.is_relative_to(folder):
        raise ValueError(f"{text!r} lies outside the study's folder; move the file there or allow it with --allow-outside")
    if not path.is_file():
        raise ValueError(f"there is no file {text!r} in the study's folder {folder}")
    return text


StudyPath = Annotated[str, AfterValidator(_inside)]


def _options(options: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
    """Options of a format, after checking that those that are paths lie in the study's folder."""
    from flexplant.io.registry import every_option, path_options

    if own := sorted({"format", "name", "units", "damping"} & set(options)):
        raise ValueError(f"{own[0]!r} is no option of a format; it has a key of its own, beside options")
    for name in set(options) - every_option():
        raise ValueError(f"no format has an option {name!r}.{nearest(name, every_option())}")
    for name in path_options() & set(options):
        _inside(str(options[name]), info)
    return options


FormatOptions = Annotated[dict[str, str | bool | int | Finite | list[int] | list[Finite]], AfterValidator(_options)]


class Section(BaseModel):
    """A part of the study file: unknown keys are errors, values cannot be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True)
