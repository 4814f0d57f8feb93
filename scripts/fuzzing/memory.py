"""Growth of the memory of a process over many steps and resets."""

import gc
from typing import NamedTuple

import gymnasium as gym
import numpy as np

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.base.processes import resident_memory
from wt_gym.tasks import DEFAULT_ENV

_SAMPLES = 100
_EPISODE_STEPS = 50


class MemoryRecord(NamedTuple):
    """Resident memory [MiB] over a long run."""

    steps: list[int]
    resident: list[float]
    resets: int

    @property
    def warm(self) -> int:
        """Samples before the growth counts: caches fill, the allocator settles."""
        return len(self.steps) // 5

    @property
    def growth(self) -> float:
        """Growth after the warm part, by a straight line through the samples [KiB per 1000 steps]."""
        slope = np.polyfit(self.steps[self.warm :], self.resident[self.warm :], 1)[0]
        return float(slope) * 1024.0 * 1000.0


def measure_memory(steps: int) -> MemoryRecord:
    """Step an environment at random, at least 1000 times, with short episodes.

    Raises
    ------
    ValueError
        If there are too few steps to tell.
    OSError
        If the system does not tell how much memory a process has.
    """
    if steps < 10 * _SAMPLES:
        raise ValueError(f"memory needs at least {10 * _SAMPLES} steps to tell, got {steps}")
    env = gym.make(DEFAULT_ENV, wind_seeds=(1, 2))
    env.action_space.seed(0)
    counts: list[int] = []
    sizes: list[float] = []
    resets, length = 0, _EPISODE_STEPS
    for step in range(1, steps + 1):
        if length >= _EPISODE_STEPS:
            env.reset(seed=resets)
            resets, length = resets + 1, 0
        *_, terminated, truncated, _ = env.step(env.action_space.sample())
        length = _EPISODE_STEPS if terminated or truncated else length + 1
        if step % (steps // _SAMPLES) == 0:
            gc.collect()  # what is only waiting to be collected, or kept for reuse, does not grow without end
            if (resident := resident_memory()) is None:
                raise OSError("the memory of a process is not known on this system; install psutil")
            counts.append(step)
            sizes.append(resident)
    env.close()
    return MemoryRecord(counts, sizes, resets)
