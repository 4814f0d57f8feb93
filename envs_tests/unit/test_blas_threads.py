"""Linear algebra on one thread, and on as many as before afterwards."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from wt_gym.base.blas_threads import one_blas_thread


def numbers(_=None):
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def two_threads():
    with threadpool_limits(limits=2, user_api="blas"):
        yield


def test_what_was_before_comes_back_also_after_an_error():
    with pytest.raises(KeyError), one_blas_thread():  # noqa: PT012
        with one_blas_thread():
            assert numbers() == {1}
        assert numbers() == {1}
        raise KeyError
    assert numbers() == {2}


def test_held_around_threads_it_outlasts_theirs():
    def worker(_):
        with one_blas_thread():
            inside = numbers()
        return inside | numbers()

    with one_blas_thread(), ThreadPoolExecutor(2) as pool:
        assert list(pool.map(worker, range(4))) == 4 * [{1}]
    assert numbers() == {2}
