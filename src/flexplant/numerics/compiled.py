"""Inner loops compiled by numba where it is installed (extra "fast"), and done by numpy where it is not, with equal results."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import cache
from typing import Any


@cache
def numba() -> Any | None:
    """The numba module, or None where it is not installed; loaded on first use, because importing it takes a while."""
    try:
        return importlib.import_module("numba")
    except ImportError:
        return None


class Kernel:
    """`loops` compiled on first call (kept on disk beside the source, or in numba's cache directory); else `fallback`.

    Both take the same arguments and write into arrays they are given. The compiler may fuse multiply-adds, so the two agree to
    round-off, not bit by bit; reductions are not reordered, so that a result does not depend on the machine's vector length.
    teach: called with numba before the compilation, to tell it about functions that `loops` calls.
    """

    def __init__(
        self, loops: Callable[..., Any], fallback: Callable[..., Any], teach: Callable[[Any], None] | None = None
    ) -> None:
        self.loops, self.fallback, self.teach = loops, fallback, teach
        self.__doc__ = loops.__doc__
        self._ready: Callable[..., Any] | None = None

    def __call__(self, *arguments: Any) -> Any:
        """Run on the arguments."""
        if self._ready is None:
            if self.teach is not None and numba() is not None:
                self.teach(numba())
            self._ready = self.fallback if numba() is None else compiled(self.loops)
        return self._ready(*arguments)


def compiled(function: Callable[..., Any], **more: Any) -> Any:
    """`function` compiled by numba, cached on disk where a writable directory is found."""
    found: Any = numba()
    options = {"fastmath": {"contract"}, "nogil": True, **more}
    try:
        return found.njit(cache=True, **options)(function)
    except RuntimeError:
        return found.njit(**options)(function)


def inlined(function: Callable[..., Any]) -> Any:
    """`function` compiled into its callers: an array costs ten arguments to hand over, more than a short loop takes."""
    return compiled(function, forceinline=True)


def is_compiled(function: object) -> bool:
    """True for a function that its author has decorated with numba.njit."""
    return hasattr(function, "py_func") and hasattr(function, "signatures")


def with_checked_indices(function: Callable[..., object]) -> Any:
    """The function compiled so that an index outside an array is an error, not a read of what lies there."""
    given = getattr(function, "targetoptions", {})
    if given.get("boundscheck"):
        return function
    nb: Any = numba()
    return nb.jit(**{"nopython": True} | given | {"boundscheck": True})(getattr(function, "py_func", function))
