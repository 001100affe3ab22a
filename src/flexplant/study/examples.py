"""Where the example studies are: beside the package in a wheel, in the repository's folder of an editable install."""

from __future__ import annotations

from pathlib import Path

from flexplant.errors import StudyError, nearest

EXAMPLES = {"shocksat": "examples/shocksat/data"}


def example_study(name: str) -> Path:
    """The study file of an example; StudyError names the known ones, or the places where it should have been."""
    if not isinstance(name, str) or name not in EXAMPLES:
        raise StudyError(f"there is no example {name!r:.60}." + nearest(name, EXAMPLES))
    package = Path(__file__).resolve().parents[1]
    places = [package / "_examples" / name, package.parents[1] / EXAMPLES[name]]
    for folder in places:
        if (folder / "study.yaml").is_file():
            return folder / "study.yaml"
    raise StudyError(f"the files of example {name!r} are not installed (looked in {places[0]} and {places[1]})")
