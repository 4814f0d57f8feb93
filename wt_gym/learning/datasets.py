"""Minari data sets of agents at work, for offline learning."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec

import wt_gym
from wt_gym.base.processes import with_variables
from wt_gym.envs.episode import episode_steps
from wt_gym.envs.layout import layout_of
from wt_gym.experiment.agents import UniformAgent, load_agent, load_model
from wt_gym.experiment.environments import check_environment
from wt_gym.experiment.names import env_choices_of, read_name

if TYPE_CHECKING:
    from collections.abc import Callable

    from minari import MinariDataset
    from numpy.typing import NDArray

    from wt_gym.envs.episode import Agent
    from wt_gym.learning.options import DatasetConfig

__all__ = ["ENV_KWARGS", "record_dataset"]

ENV_KWARGS = {"pitch": "individual", "episode_length": 60.0}
"""Arguments of the environment by default: rates of all blades, so that the actions of controllers are what they do."""

_ROOT = "MINARI_DATASETS_PATH"


def record_dataset(
    config: DatasetConfig, folder: str | Path, on_episode: Callable[[int, float], None] | None = None
) -> MinariDataset:
    """Record episodes of an agent as a Minari data set.

    Observations, actions, rewards, ends and, in the infos, ``cost`` of every step are kept; seeds of the episodes, the
    environment with its arguments, and reference scores, mean returns of random actions and of the agent itself.
    Where the recording is stopped the episodes that were done are written.

    Parameters
    ----------
    folder : str or path
        Root of Minari's data sets (``MINARI_DATASETS_PATH``).
    on_episode : callable, optional
        Gets number and return of every recorded episode.

    Raises
    ------
    ValueError
        If there is such a data set already, or the agent is unknown or does not fit the environment.
    """
    folder = Path(folder).absolute()
    if (folder / config.dataset_id).exists():
        raise ValueError(f"there is a data set {config.dataset_id} in {folder} already; remove it or give another id")
    folder.mkdir(parents=True, exist_ok=True)
    env_id, kwargs, make_agent = _agent(config)
    env = gym.make(env_id, **kwargs)
    agent = make_agent(env)
    if config.noise > 0.0:
        agent = _Noisy(agent, config.noise, config.seed)
    lowest = [_episode(env, UniformAgent(layout_of(env)), config.seed + k) for k in range(config.random_episodes)]
    played: list[dict[str, Any]] = []
    try:
        for k in range(config.episodes):
            played.append(_episode(env, agent, config.seed + k))
            if on_episode is not None:
                on_episode(k + 1, sum(played[-1]["rewards"]))
    finally:
        if played:  # an interrupted recording keeps its episodes
            dataset = _write(config, folder, env, played, lowest)
    env.close()
    return dataset


def _write(
    config: DatasetConfig, folder: Path, env: gym.Env, played: list[dict[str, Any]], lowest: list[dict[str, Any]]
) -> MinariDataset:
    """Write the episodes that were played, with the mean returns of random ones for comparison."""
    import minari
    from minari.data_collector.episode_buffer import EpisodeBuffer

    spec = cast(EnvSpec, env.spec)  # of an environment that gymnasium.make has made
    with with_variables({_ROOT: str(folder)}):  # where Minari reads its root
        return minari.create_dataset_from_buffers(
            config.dataset_id,
            [EpisodeBuffer(id=k, seed=config.seed + k, **episode) for k, episode in enumerate(played)],
            env=env,
            algorithm_name=config.agent,
            ref_min_score=_mean_return(lowest),
            ref_max_score=_mean_return(played),
            requirements=[f"wt_gym=={wt_gym.__version__}"],
            description=f"{config.agent} in {spec.id}, {len(played)} episodes, noise {config.noise:g} on actions",
        )


def _agent(config: DatasetConfig) -> tuple[str, dict[str, Any], Callable[[gym.Env], Agent]]:
    """Environment, its arguments, and what makes the agent for it."""
    name = read_name(config.agent)
    if name.kind == "trained":
        trained = load_model(name)
        of_training = (trained.record or {}).get("config", {})
        env_id = config.env_id or of_training.get("env_id")
        if env_id is None:
            raise ValueError(f"the environment must be given for {config.agent}, which has no record of its training")

        def make_trained(env: gym.Env) -> Agent:
            trained.enter(layout_of(env))
            if not config.allow_other_environment:
                check_environment(trained.record or {}, env)
            return trained

        chosen = {**of_training.get("env_kwargs", {}), **env_choices_of(config.agent), **config.env_kwargs}
        return env_id, chosen, make_trained
    env_id, kwargs = config.env_id or "wt_gym/NREL5MW-Turbulent-v1", {**ENV_KWARGS, **config.env_kwargs}
    if name.text == "random":
        return env_id, kwargs, lambda env: UniformAgent(layout_of(env), config.seed)
    kwargs |= env_choices_of(config.agent)
    return env_id, kwargs, lambda env: load_agent(config.agent, layout_of(env), env)


class _Noisy:
    """An agent with normal noise on its actions, which stay within their bounds."""

    def __init__(self, agent: Agent, noise: float, seed: int):
        self._agent, self._noise, self._rng = agent, noise, np.random.default_rng(seed)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        action, state = self._agent.predict(observation, state, episode_start, deterministic)
        noisy = action + self._noise * self._rng.standard_normal(action.shape)
        return np.clip(noisy, -1.0, 1.0).astype(np.float32), state


def _episode(env: gym.Env, agent: Agent, seed: int) -> dict[str, Any]:
    """Play an episode; give what Minari keeps of one, with a cost of zero at its start."""
    observation, _ = env.reset(seed=seed)
    steps = list(episode_steps(env, agent, observation))
    return {
        "observations": [observation, *(step.observation for step in steps)],
        "actions": [step.action for step in steps],
        "rewards": [float(step.reward) for step in steps],
        "terminations": [step.terminated for step in steps],
        "truncations": [step.truncated for step in steps],
        "infos": {"cost": [0.0, *(step.info["cost"] for step in steps)]},
    }


def _mean_return(episodes: list[dict[str, Any]]) -> float:
    return float(np.mean([sum(episode["rewards"]) for episode in episodes]))
