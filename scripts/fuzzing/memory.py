"""Whether the memory of a process stays flat over many steps and resets."""

from __future__ import annotations

import gc
from dataclasses import dataclass

import gymnasium as gym
import numpy as np

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.base.process_memory import resident_memory
from wt_gym.tasks import DEFAULT_ENV

__all__ = ["MemoryRecord", "measure_memory"]

_SAMPLES = 100
_WARM = 0.2
"""Share of the samples before the growth counts: caches fill, the allocator settles."""


@dataclass(frozen=True)
class MemoryRecord:
    """Resident memory over a long run.

    Attributes
    ----------
    steps : list of int
    resident : list of float
        [MiB].
    resets : int
    """

    steps: list[int]
    resident: list[float]
    resets: int

    @property
    def growth(self) -> float:
        """Growth after the warm part, by a straight line through the samples [KiB per 1000 steps]."""
        warm = round(_WARM * len(self.steps))
        slope = np.polyfit(self.steps[warm:], self.resident[warm:], 1)[0]
        return float(slope) * 1024.0 * 1000.0


def measure_memory(steps: int, env_id: str = DEFAULT_ENV, episode_steps: int = 50) -> MemoryRecord:
    """Step an environment at random with short episodes.

    Parameters
    ----------
    steps : int
        At least 1000.
    env_id : str
    episode_steps : int
        After which it is reset.

    Raises
    ------
    ValueError
        If there are too few steps to tell.
    OSError
        If the system does not tell how much memory a process has.
    """
    if steps < 10 * _SAMPLES:
        raise ValueError(f"memory needs at least {10 * _SAMPLES} steps to tell, got {steps}")
    env = gym.make(env_id, wind_seeds=(1, 2))
    env.action_space.seed(0)
    record, resets, length = MemoryRecord([], [], 0), 0, episode_steps
    for step in range(steps):
        if length >= episode_steps:
            env.reset(seed=resets)
            resets, length = resets + 1, 0
        *_, terminated, truncated, _ = env.step(env.action_space.sample())
        length = episode_steps if terminated or truncated else length + 1
        if (step + 1) % (steps // _SAMPLES) == 0:
            gc.collect()  # what is only waiting to be collected, or kept for reuse, does not grow without end
            record.steps.append(step + 1)
            resident = resident_memory()
            if resident is None:
                raise OSError("the memory of a process is not known on this system; install psutil")
            record.resident.append(resident)
    env.close()
    return MemoryRecord(record.steps, record.resident, resets)
