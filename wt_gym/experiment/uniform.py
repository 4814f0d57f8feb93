"""An agent that acts at random: what any method has to beat."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.envs.layout import EnvLayout

__all__ = ["UniformAgent"]


class UniformAgent:
    """Draws every action evenly from the action space.

    Parameters
    ----------
    layout : EnvLayout
        Layout of observation and action, ``env.unwrapped.layout``.
    seed : int
        Of the draws; each start of an episode begins them again.
    """

    def __init__(self, layout: EnvLayout, seed: int = 0):
        self._size, self._seed = layout.action.size, seed
        self._rng = np.random.default_rng(seed)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Return an action for each observation, and the state as it came."""
        if episode_start is not None and np.any(episode_start):
            self._rng = np.random.default_rng(self._seed)
        shape = (*np.shape(observation)[:-1], self._size)
        return self._rng.uniform(-1.0, 1.0, shape).astype(np.float32), state
