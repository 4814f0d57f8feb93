"""A Ray cluster to work on: one that is there, or one of this machine alone."""

from __future__ import annotations

import os
import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import ray
from ray.exceptions import RayTaskError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from wt_gym.runs.tally import ONE_THREAD

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

__all__ = ["connected", "processors", "warm_nodes"]

_OBJECT_STORE = 300 * 2**20  # bytes: a result is some MB, and is fetched as soon as it is there


@contextmanager
def connected(address: str | None = None, num_cpus: int | None = None) -> Iterator[None]:
    """Be connected to a Ray cluster.

    Parameters
    ----------
    address : str, optional
        As of `wt_gym.runs.executors.executor_for`. A connection that exists already is used and left as it is.
    num_cpus : int, optional
        Processors of a Ray of this machine alone; default: all.

    Raises
    ------
    ConnectionError
        If there is no cluster at the address.
    """
    if ray.is_initialized():
        yield
        return
    address, handlers = address or os.environ.get("RAY_ADDRESS"), _signal_handlers()
    own = {"num_cpus": num_cpus, "object_store_memory": _OBJECT_STORE, "include_dashboard": False}
    ray.init(
        address=address or "local",
        # several workers of a machine would each start as many threads as it has processors
        runtime_env={"env_vars": ONE_THREAD},
        log_to_driver=False,
        logging_level="warning",
        **({} if address else own),
    )
    for number, handler in handlers.items():
        signal.signal(number, handler)  # Ray has put its own in their place
    try:
        yield
    finally:
        ray.shutdown()


def _signal_handlers() -> dict[int, Any]:
    """Handlers of this process by signal; only the main thread can set them."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    return {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}


def processors() -> int:
    """Processors of the cluster at this moment, at least one."""
    return max(1, int(ray.cluster_resources().get("CPU", 1)))


def warm_nodes(warm: Callable[[], None]) -> None:
    """Call something once on each machine of the cluster, all at the same time.

    A first step compiles for a minute and more. Twenty workers that start cold compile the same twenty times, and
    RLlib throws away what a worker has not sampled in a minute.

    Parameters
    ----------
    warm : callable
        Without arguments.
    """
    nodes = [
        node["NodeID"] for node in ray.nodes() if node["Alive"] and node.get("Resources", {}).get("CPU", 0.0) >= 1.0
    ]
    # a node that goes meanwhile does no harm: soft affinity warms another one twice
    tasks = [_call.options(scheduling_strategy=NodeAffinitySchedulingStrategy(node, soft=True)) for node in nodes]
    try:
        ray.get([task.remote(warm) for task in tasks])
    except RayTaskError as error:
        raise error.cause from None  # as it would have been raised here


@ray.remote(num_cpus=1)  # type: ignore[untyped-decorator, unused-ignore]  # typed if Ray is installed
def _call(function: Callable[[], None]) -> None:
    """Call it there."""
    function()
