"""An agent that always does the same: the reference below every controller."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from wt_gym.envs.layout import EnvLayout

__all__ = ["ConstantAgent"]


class ConstantAgent:
    """Gives one action whatever it sees; by default the middle of the range, which holds all demands in rate mode.

    Parameters
    ----------
    layout : EnvLayout
        Layout of observation and action, ``env.unwrapped.layout``.
    action : array_like, shape (n_act,), optional
        Within [-1, 1].

    Raises
    ------
    wt_gym.base.errors.ActionError
        If the action does not fit the environment.
    """

    def __init__(self, layout: EnvLayout, action: ArrayLike | None = None):
        values = np.zeros(layout.action.size) if action is None else np.asarray(action)
        self._action: NDArray[np.float32] = layout.action.validate(values).astype(np.float32)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the constant action for each observation, and the state as it came."""
        observation = np.asarray(observation)
        if observation.ndim == 1:
            return self._action.copy(), state
        return np.tile(self._action, (observation.shape[0], 1)), state
