"""The whole example study from an empty folder: seconds of every step. Limit: 60 s on two cores."""

import tempfile
import time
from pathlib import Path

from flexplant.study.examples import example_study
from flexplant.study.pipeline import run_study


def main() -> None:
    """Print a line a step."""
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        result = run_study(example_study("shocksat"), output=Path(folder) / "out")
    for step, seconds in result.seconds.items():
        print(f"{step:32s} {seconds:7.2f} s")
    print(f"{'all, with the report':32s} {time.perf_counter() - start:7.2f} s (limit 60 s)")


if __name__ == "__main__":
    main()
