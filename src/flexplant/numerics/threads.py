"""One thread for BLAS and LAPACK while a result is made: more of them split sums, which changes its last digits."""

from __future__ import annotations

import threading
from contextlib import ContextDecorator
from functools import cache
from typing import Any

import scipy.linalg  # noqa: F401 - brings its own BLAS, which is to be found with numpy's
from threadpoolctl import ThreadpoolController


@cache
def _libraries() -> list[Any]:
    """The BLAS libraries that numpy and scipy have loaded; found once, which takes some hundredths of a second."""
    return list(ThreadpoolController().select(user_api="blas").lib_controllers)


def _limit(library: Any, threads: int) -> None:
    """threadpoolctl lets one thread of Python alone change a pool that all share, and ignores others; here a lock sorts them."""
    getattr(library, "_real_set_num_threads", library.set_num_threads)(threads)


class OneThread(ContextDecorator):
    """Limits BLAS to one thread within; calls may nest and overlap in several threads, the last one to leave lifts the limit.

    The limit holds for the whole process meanwhile, as BLAS knows no other. Entering takes some hundredths of a millisecond, and
    nothing within another one. Libraries that threadpoolctl does not know (Accelerate) keep their threads.
    """

    def __init__(self) -> None:
        self._lock, self._inside, self._before = threading.Lock(), 0, list[int]()

    def __enter__(self) -> None:
        """Limit the threads, if no one has yet."""
        with self._lock:
            if not self._inside:
                self._before = [library.num_threads for library in _libraries()]
                for library in _libraries():
                    _limit(library, 1)
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        """Restore them, where no one else is inside."""
        with self._lock:
            self._inside -= 1
            if not self._inside:
                for library, threads in zip(_libraries(), self._before, strict=True):
                    _limit(library, threads)


one_thread = OneThread()
