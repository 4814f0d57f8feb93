"""Kernels in the cache before other processes want them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

import wt_gym  # noqa: F401 - registers the environments

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["compile_kernels", "compile_kernels_of"]


def compile_kernels(env: gym.Env) -> None:
    """Run one step, so that every kernel is in the cache that worker processes share, and close the environment."""
    env.reset(seed=0)
    env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    env.close()


def compile_kernels_of(env_id: str, env_kwargs: Mapping[str, Any]) -> None:
    """Make an environment and `compile_kernels` of it: what a machine does once before its processes begin."""
    compile_kernels(gym.make(env_id, **env_kwargs))
