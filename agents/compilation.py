"""Kernels in the cache before other processes want them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import gymnasium as gym

__all__ = ["compile_kernels"]


def compile_kernels(env: gym.Env) -> None:
    """Run one step, so that every kernel is in the cache that worker processes share, and close the environment."""
    env.reset(seed=0)
    env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    env.close()
