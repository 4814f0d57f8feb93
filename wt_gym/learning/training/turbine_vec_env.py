"""Turbines in one process as a vector environment of stable-baselines3."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env.base_vec_env import VecEnv

from wt_gym.envs.vector_env import WindTurbineVectorEnv

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

    from wt_gym.envs.turbine_env import WindTurbineEnv

__all__ = ["TurbineVecEnv"]


class TurbineVecEnv(VecEnv):
    """`wt_gym.envs.vector_env.WindTurbineVectorEnv` behind the interface of stable-baselines3.

    Threads step the turbines. Infos are those of the single environments, with ``terminal_observation`` and
    ``TimeLimit.truncated`` as stable-baselines3 requires them; no wrapper stands around a single environment.

    Parameters
    ----------
    env_id : str
        Of this package.
    num_envs : int
    **kwargs
        Arguments of the environment, and ``threads``.

    Raises
    ------
    ValueError
        If the id is not an environment of this package.
    """

    def __init__(self, env_id: str, num_envs: int, **kwargs: Any):
        made = gym.make_vec(env_id, num_envs, "vector_entry_point", autoreset_mode=AutoresetMode.SAME_STEP, **kwargs)
        self.turbines = cast(WindTurbineVectorEnv, made)
        super().__init__(num_envs, made.single_observation_space, made.single_action_space)

    def reset(self) -> np.ndarray:
        """Start episodes with the seeds and options that were set for it."""
        options = self._options[0] or None
        if any(other != self._options[0] for other in self._options):
            raise ValueError("options of a reset hold for all turbines")
        results = self.turbines.reset_each(self._seeds, options, range(self.num_envs))
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = [info for _, info in results]
        return np.stack([observation for observation, _ in results])

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Advance every turbine by a control step; where an episode ends the next begins."""
        outcomes = self.turbines.step_each(self._actions)
        infos = []
        for k, outcome in enumerate(outcomes):
            info = outcome.info
            if outcome.final is not None:
                self.reset_infos[k], (last, info) = outcome.info, outcome.final
                info["terminal_observation"] = last
            info["TimeLimit.truncated"] = outcome.truncated and not outcome.terminated
            infos.append(info)
        observations, rewards, terminated, truncated, *_ = zip(*outcomes, strict=True)
        dones = np.array(terminated) | np.array(truncated)
        return np.stack(observations), np.array(rewards), dones, infos

    def close(self) -> None:
        """Release simulators and threads."""
        self.turbines.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Attribute of the single environments."""
        return [getattr(env, attr_name) for env in self._chosen(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the single environments."""
        for env in self._chosen(indices):
            setattr(env, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the single environments."""
        return [getattr(env, method_name)(*method_args, **method_kwargs) for env in self._chosen(indices)]

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Say that no wrapper stands around a single environment."""
        return [False for _ in self._chosen(indices)]

    def get_images(self) -> list[np.ndarray | None]:
        """Pictures of the turbines."""
        return list(self.turbines.render())

    def _chosen(self, indices: VecEnvIndices) -> list[WindTurbineEnv]:
        return [self.turbines.envs[k] for k in self._get_indices(indices)]
