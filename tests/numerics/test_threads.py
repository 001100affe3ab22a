"""The limit of BLAS to one thread: nested, overlapping in several threads, and lifted again whatever happens."""

import threading

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from flexplant.numerics.threads import one_thread


def blas_threads():
    """How many threads each BLAS library would take."""
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_the_limit_is_lifted_by_the_last_one_to_leave():
    inside, leave = threading.Event(), threading.Event()

    @one_thread
    def elsewhere():
        inside.set()
        assert leave.wait(10)

    with threadpool_limits(2, user_api="blas"):
        assert blas_threads() == {2}
        other = threading.Thread(target=elsewhere)
        with one_thread:
            other.start()
            assert inside.wait(10)
            with one_thread:
                assert blas_threads() == {1}
        assert blas_threads() == {1}
        leave.set()
        other.join()
        assert blas_threads() == {2}
        found = []
        alone = threading.Thread(target=one_thread(lambda: found.append(blas_threads())))
        alone.start()
        alone.join()
        assert found == [{1}]
        assert blas_threads() == {2}


def test_the_limit_is_lifted_after_a_failure():
    @one_thread
    def failing():
        raise ValueError("no")

    with threadpool_limits(2, user_api="blas"):
        with pytest.raises(ValueError, match="no"):
            failing()
        assert blas_threads() == {2}
