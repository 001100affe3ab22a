"""Foreseen errors and warnings, each told in one line on stderr; errors turned into exit codes."""

from __future__ import annotations

import functools
import glob
import inspect
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import typer

from flexplant.cli.options import OWN_OPTIONS
from flexplant.errors import CheckFailedError, FlexplantError, LeftOutWarning, PlausibilityWarning, ReadError, SolverError

NOTES = (PlausibilityWarning, LeftOutWarning)
OK, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
SPELLED = {"version": "fmi"}  # options of a format that a command has under a name of its own
P = ParamSpec("P")
R = TypeVar("R")


def told(command: Callable[P, R]) -> Callable[P, R]:
    """The command with its foreseen errors told in one line on stderr and turned into exit codes."""

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            with notes():
                return command(*args, **kwargs)
        except (CheckFailedError, SolverError) as error:
            raise end(str(error), FAILED) from None
        except FlexplantError as error:
            raise end(hinted(str(error), command), BAD_INPUT) from None
        except OSError as error:
            raise end(f"{error.filename or 'file'}: {error.strerror or error}", BAD_INPUT) from None
        except MemoryError:
            raise end("not enough memory for this model", FAILED) from None
        except KeyboardInterrupt:
            raise end("interrupted; nothing was written", INTERRUPTED) from None

    return wrapped


@contextmanager
def notes() -> Iterator[None]:
    """Warnings about implausible numbers, and about what a result lacks, as one line each on stderr, a file's once."""
    with warnings.catch_warnings():
        for kind in NOTES:
            warnings.simplefilter("default", kind)
        shown = warnings.showwarning

        def tell(message: Any, category: Any, *rest: Any, **more: Any) -> None:
            if issubclass(category, NOTES):
                typer.echo(f"flexplant: note: {message}", err=True)
            else:
                shown(message, category, *rest, **more)

        warnings.showwarning = tell
        yield


def look(*paths: Path) -> None:
    """ReadError for a file that is not there, before anything large is imported; a stem without ending may stand for a file."""
    for path in paths:
        if path.exists():
            continue
        beside = sorted(p.name for p in path.parent.glob(f"{glob.escape(path.stem)}.*"))[:8] if path.stem else []
        if path.suffix or not beside:
            raise ReadError(path, "no such file" + (f"; beside it: {', '.join(beside)}" if beside else ""))


def hinted(text: str, command: Callable[..., Any]) -> str:
    """An error of the library in the command line's words: its own option, or --option where it takes those of a format."""
    takes = inspect.signature(command).parameters
    own, spelled = next(((w, s) for w, s in SPELLED.items() if s in takes and re.search(rf"\b{w}\b", text)), ("", ""))
    if own:
        return re.sub(rf"\b{own}=", f"--{spelled} ", text).replace(repr(own), f"--{spelled}")
    asked = re.search(r"pass (\w+)=", text)
    if asked is None or asked[1] in ("overwrite", *OWN_OPTIONS) or "option" not in takes:
        return text
    return f"{text} (here: --option {asked[1]}=...)"


def end(text: str, code: int) -> typer.Exit:
    """The text on stderr, a line each; what is raised ends the command."""
    typer.echo("\n".join(f"flexplant: {line}" for line in text.splitlines()), err=True)
    return typer.Exit(code)
