"""A child process: answers, failures, its end with what it printed, one that hangs; linear algebra on one thread."""

import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
import scipy.linalg  # noqa: F401 - its library counts, too
from threadpoolctl import threadpool_info, threadpool_limits

from wt_gym.base import processes
from wt_gym.base.processes import ChildEndedError, ChildFailedError, ChildProcess, one_blas_thread

WORKER = """
import atexit, os, time

class Refused(Exception):
    pass

class Work:
    def __init__(self, factor):
        self.factor = int(factor)
        if not self.factor:  # hangs at its end
            atexit.register(time.sleep, 60.0)
    def times(self, number):
        print("on standard output", flush=True)
        return self.factor * number
    def refuse(self):
        raise Refused("the pump is dry")
    def abort(self):
        print("now it comes", flush=True)
        os.abort()
    def stop(self):
        os._exit(3)
    def fault(self):
        raise KeyError("nobody expects this")

begin, FAILURES = Work, (Refused,)
"""


@pytest.fixture
def begun(tmp_path):
    """What makes a child with a factor; ends all of them."""
    worker, made = tmp_path / "worker.py", []
    worker.write_text(WORKER)

    def begin(factor):
        made.append(ChildProcess(worker, (str(factor),), tmp_path / "log.txt"))
        return made[-1]

    yield begin
    for child in made:
        child.close()


def test_it_answers_and_its_prints_go_to_the_log(begun, tmp_path):
    child = begun(3)
    assert [child.ask("times", number) for number in (1, 2.5)] == [3, 7.5]
    assert (tmp_path / "log.txt").read_text() == 2 * "on standard output\n"


def test_it_survives_its_failures(begun):
    child = begun(3)
    with pytest.raises(ChildFailedError, match=r"^the pump is dry$"):
        child.ask("refuse")
    assert child.alive
    assert child.ask("times", 2) == 6


@pytest.mark.parametrize(
    ("request_name", "how", "printed"),
    [
        ("abort", f"by signal {int(signal.SIGABRT)}", "now it comes"),
        ("stop", "with exit status 3", ""),
        ("fault", "with exit status 1", "nobody expects this"),
    ],
)
def test_its_end_is_told_with_what_it_printed(begun, request_name, how, printed):
    child = begun(3)
    for _ in range(2):  # whoever asks again hears the same
        with pytest.raises(ChildEndedError) as ended:
            child.ask(request_name)
        assert ended.value.how == how
        assert printed in ended.value.printed
        assert not child.alive


def test_one_that_cannot_begin(begun):
    with pytest.raises(ChildEndedError, match=r"(?s)with exit status 1: .*invalid literal for int"):
        begun("three").ask("times", 1)


def test_one_that_hangs_is_ended(begun, monkeypatch):
    monkeypatch.setattr(processes, "_PATIENCE", 0.1)
    child = begun(0)
    child.ask("times", 1)
    process, start = child._process, time.monotonic()
    child.close()
    assert process.returncode == -signal.SIGKILL
    assert time.monotonic() - start < 30.0
    with pytest.raises(ChildEndedError, match="by signal 9"):
        child.ask("times", 1)


def test_it_ends_with_its_object(begun, tmp_path):
    child = ChildProcess(tmp_path / "worker.py", ("3",), tmp_path / "log.txt")
    child.ask("times", 1)
    process = child._process
    del child
    assert process.wait(30.0) == 0
    assert not os.path.exists(f"/proc/{process.pid}")


def numbers():
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}


@pytest.fixture
def two_threads():
    with threadpool_limits(limits=2, user_api="blas"):
        yield


@pytest.mark.usefixtures("two_threads")
def test_threads_of_before_come_back_also_after_an_error():
    with pytest.raises(KeyError), one_blas_thread():  # noqa: PT012
        with one_blas_thread():
            assert numbers() == {1}
        assert numbers() == {1}
        raise KeyError
    assert numbers() == {2}


@pytest.mark.usefixtures("two_threads")
def test_one_thread_held_around_threads_outlasts_theirs():
    def worker(_):
        with one_blas_thread():
            inside = numbers()
        return inside | numbers()

    with one_blas_thread(), ThreadPoolExecutor(2) as pool:
        assert list(pool.map(worker, range(4))) == 4 * [{1}]
    assert numbers() == {2}
