"""Functions of the user's own compiled into the loop of sampled blocks, where numba can."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from flexplant.blocks.sampled import USER, SampledBlock
from flexplant.loop.hybrid import Element
from flexplant.numerics.compiled import is_compiled, numba, with_checked_indices

RAISED, FINE, WRONG_SIZE, NOT_FINITE = 0, 1, 2, 3  # what a call returns
SIGNATURE = "int64(float64, CPointer(float64), CPointer(float64), CPointer(float64))"


def c_functions(elements: tuple[Element, ...], *, plain: bool) -> list[Any] | None:
    """A C function (t, u, state, y) for each element that is a user's function, None for the others; None where one cannot be.

    plain: also compile functions that are not decorated. One that draws from numpy's global random numbers is left to Python:
    compiled code has a generator of its own, and would ignore the seed.
    """
    found: list[Any] = []
    for element in elements:
        block = element.block
        if not isinstance(block, SampledBlock) or block.kind != USER:
            found.append(None)
            continue
        if numba() is None or block.own is None or not (is_compiled(block.own) or (plain and _is_pure(block.own))):
            return None
        made = _kept_c_function if is_compiled(block.own) else _c_function
        call = made(block.own, len(block.inputs), block.n_states, len(block.outputs), block.takes_state)
        if call is None:
            return None
        found.append(call)
    return found


def _is_pure(function: Callable[..., object]) -> bool:
    code = getattr(function, "__code__", None)
    return code is not None and "random" not in code.co_names


def _c_function(own: Callable[..., object], nu: int, ns: int, ny: int, takes_state: bool) -> Any | None:
    """The compiled call, or None where numba does not know how."""
    nb: Any = numba()
    law: Any = with_checked_indices(own)
    carray = nb.carray

    @nb.njit
    def written(values, place, size):  # type: ignore[no-untyped-def]
        given = np.atleast_1d(np.asarray(values))
        if given.size != size:
            return WRONG_SIZE
        for k in range(size):
            if not np.isfinite(given[k]):
                return NOT_FINITE
        for k in range(size):
            place[k] = given[k]
        return FINE

    def stateless(t, u, s, y):  # type: ignore[no-untyped-def]  # noqa: ARG001
        try:
            return written(law(t, carray(u, (nu,)).copy()), y, ny)
        except Exception:  # noqa: BLE001  (compiled: numba knows no other; Python's own call then says what it is)
            return RAISED

    def with_state(t, u, s, y):  # type: ignore[no-untyped-def]
        try:
            found, state = law(t, carray(u, (nu,)).copy(), carray(s, (ns,)).copy())
            first = written(found, y, ny)
            return written(state, s, ns) if first == FINE else first
        except Exception:  # noqa: BLE001
            return RAISED

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return nb.cfunc(SIGNATURE)(with_state if takes_state else stateless)
        except (nb.core.errors.NumbaError, NotImplementedError, TypeError, ValueError):
            return None


# a decorated function keeps the values it was first compiled with; a plain one reads what is around it anew in each run
_kept_c_function = lru_cache(maxsize=64)(_c_function)
