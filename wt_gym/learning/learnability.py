"""Whether a task can be learned: bound of its actions, alignment of its gradient by horizon, signal to noise.

*Bound*: the offsets of the linear optimal pitch, which is the best law known, played through the actions of the task,
earn a share of what they earn without its limits. What the actions exclude no algorithm finds.

*Alignment*: at zero actions the exact gradient of the return by an action follows from a linear model
(`wt_gym.learning.linear_env`). Of the gradient that the observation predicts, discounted with a horizon H,

    g_H(t) = sum_k exp(-k dt / H) dr_(t+k) / da_t,

the alignment is the correlation with that of an infinite horizon. Below zero, an agent with this horizon learns the
opposite.

*Signal to noise*: policy gradients of a linear policy, estimated from rollouts of a random one with generalized
advantages, have a mean g and a variance S over rollouts. The ratio |g|^2 / tr S is given for 2048 decisions: its
inverse is how many times as many make a gradient that points the right way.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from wt_gym.base.options import Options, option, option_record
from wt_gym.control.controllers.linear_optimal import OFFSET_ACTIONS, linear_part
from wt_gym.control.controllers.names import BASELINE
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.agents import ConstantAgent
from wt_gym.experiment.run import ENDLESS, EpisodePlayer, benchmark_metrics
from wt_gym.experiment.tuning import Cost
from wt_gym.learning.linear_env import STILL, LinearModel, LinearVectorEnv, cached_model
from wt_gym.learning.pretraining_episodes import PlayedActions

HORIZONS = (1.0, 4.0, 20.0)
"""Horizons of the alignment [s]."""
DECISIONS = 2048
"""Decisions for which signal to noise is given."""


@option_record
class LearnabilityOptions(Options):
    """What is measured, and how."""

    title = "learnability"

    speeds: tuple[float, ...] = option("mean winds of the bound", default=(15.0, 18.0), unit="m/s", flat="wind_speed")
    seeds: tuple[int, ...] = option("seeds of their turbulence", default=(1, 2), flat="wind_seeds")
    duration: float = option("length of a run", default=180.0, unit="s", low=60.0)
    skip: float = option("start of a run that does not count", default=30.0, unit="s", low=0.0)
    models: int = option("linear models beside each other", default=96, low=8)
    rounds: int = option("rollouts of each", default=6, low=1)
    noise: float = option("standard deviation of the random actions", default=0.22, low=0.0, above=True)
    discount: float = option("discount a decision", default=0.98, low=0.0, high=1.0)
    trace: float = option("lambda of the generalized advantages", default=0.9, low=0.0, high=1.0)


@dataclass(frozen=True)
class Learnability:
    """Result."""

    bound: float  #: share of the improvement of the lifetime cost over the baseline controller [-]
    alignment: dict[float, tuple[float, float, float]]  #: of mean, tilt and yaw by horizon [s]
    signal: float  #: signal to noise in `DECISIONS` decisions


def _metrics(
    env_id: str, arguments: Mapping[str, Any], agent: Any, job: tuple[float, int], o: LearnabilityOptions
) -> Any:
    """Metrics of a run, and offsets (n, 3) that its controller adds, over the control steps [rad]."""
    env = gym.make(env_id, max_episode_steps=ENDLESS, **{**arguments, **STILL})
    plain = turbine_env_of(env)
    plain.outer_steps = ENDLESS
    speed, seed = job
    player = EpisodePlayer(
        env, agent or ConstantAgent(plain.layout), seed=seed, duration=o.duration,
        options={"azimuth": 0.0, "wind_speed": speed, "wind_seed": seed, "time_offset": 0.0},
    )  # fmt: skip
    offsets = []
    for _ in player:
        part = linear_part(plain.controller)
        offsets.append((0.0, 0.0, 0.0) if part is None else part.offsets.acting)
    env.close()
    return benchmark_metrics(player.episode.after_start, plain.turbine, o.skip), np.array(offsets)


def bound(env_id: str, arguments: Mapping[str, Any], o: LearnabilityOptions) -> float:
    """Share of the improvement by the linear optimal pitch that the same offsets earn through the actions of a task."""
    plain = turbine_env_of(gym.make(env_id, **arguments))
    spans, names = plain.operation.action.pitch_high, plain.layout.action.names
    if tuple(names) != OFFSET_ACTIONS:
        raise ValueError(f"the bound needs actions that are offsets of mean, tilt and yaw, got {', '.join(names)}")
    free = {**arguments, "observation": ["rotor"]}
    gained, cost = np.zeros(2), Cost()
    for job in ((speed, seed) for speed in o.speeds for seed in o.seeds):
        before, _ = _metrics(env_id, {**free, "controller": BASELINE}, None, job, o)
        best, offsets = _metrics(env_id, {**free, "controller": "linear_optimal"}, None, job, o)
        played = PlayedActions((offsets / spans).clip(-1.0, 1.0))
        now, _ = _metrics(env_id, arguments, played, job, o)
        gained -= [cost.of(best, before, plain.turbine), cost.of(now, before, plain.turbine)]
    if gained[0] <= 0.0:
        raise ValueError(f"linear_optimal must gain in the winds of the bound, got winds of {o.speeds} m/s")
    return float(gained[1] / gained[0])


def _models(
    env_id: str, arguments: Mapping[str, Any], count: int, model: LinearModel | None, steps: int | None = None
) -> LinearVectorEnv:
    return LinearVectorEnv(count, steps, AutoresetMode.DISABLED, model=model, modeled=env_id, **arguments)


def alignment(
    env_id: str, arguments: Mapping[str, Any], model: LinearModel | None = None
) -> dict[float, tuple[float, float, float]]:
    """Alignment of the gradient of mean, tilt and yaw with that of an infinite horizon, by horizon [s]."""
    models = _models(env_id, arguments, 1, model)
    rates = models.gradient_rates()  # n_runs, n, n_lags, 3
    dt, (_, steps, lags, _) = models.envs[0].control_dt, rates.shape
    features = models.model.observations[:, :steps].reshape(-1, models.model.observations.shape[-1]).astype(float)
    inputs = np.concatenate([np.ones((len(features), 1)), (features - features.mean(0)) / (features.std(0) + 1e-6)], 1)
    normal = inputs.T @ inputs + 3e-3 * len(inputs) * np.eye(inputs.shape[1])

    def predicted(horizon: float) -> NDArray[np.float64]:
        weights = np.exp(-dt * np.arange(lags) / horizon)
        whole = np.einsum("rtlj,l->rtj", rates, weights).reshape(-1, 3)
        return np.asarray(inputs @ np.linalg.solve(normal, inputs.T @ whole))

    endless = predicted(np.inf)
    found = {}
    for horizon in HORIZONS:
        own = predicted(horizon)
        mean, tilt, yaw = (float(np.corrcoef(own[:, j], endless[:, j])[0, 1]) for j in range(3))
        found[horizon] = mean, tilt, yaw
    return found


def signal_to_noise(
    env_id: str, arguments: Mapping[str, Any], o: LearnabilityOptions, model: LinearModel | None = None,
    steps: int = 200,
) -> float:  # fmt: skip
    """Signal to noise of a policy gradient from `DECISIONS` decisions, at zero mean actions."""
    rng = np.random.default_rng(0)
    gradients, winds = [], []
    models = _models(env_id, arguments, o.models, model, steps)
    for number in range(o.rounds):
        seeds = range(number * o.models, (number + 1) * o.models)
        seen = np.stack([first for first, _ in models.reset_each(seeds, None, range(o.models))])
        winds.append(models._run.copy())
        observed, noise, rewards = [], [], []
        for _ in range(steps):
            drawn = rng.standard_normal((o.models, 3))
            outcomes = models.step_each((o.noise * drawn).clip(-1.0, 1.0))
            observed.append(seen)
            noise.append(drawn)
            rewards.append([out.reward for out in outcomes])
            seen = np.stack([out.observation for out in outcomes])
        gradients.append(_policy_gradients(np.array(observed), np.array(noise), np.array(rewards, float), o))
    each = np.concatenate(gradients)
    variance, wind = each.var(0, ddof=1).sum(), np.concatenate(winds)
    of_winds = np.array([each[wind == run].sum(0) for run in np.unique(wind)])  # products within a wind are biased
    if len(of_winds) < 2:
        raise ValueError("signal to noise needs a model of several winds")
    pairs = len(wind) ** 2 - (np.unique(wind, return_counts=True)[1] ** 2).sum()
    signal = max(float((each.sum(0) ** 2).sum() - (of_winds**2).sum()) / pairs, 0.0)
    return float(signal / variance * DECISIONS / steps)


def _policy_gradients(
    observed: NDArray[np.float64], noise: NDArray[np.float64], rewards: NDArray[np.float64], o: LearnabilityOptions
) -> NDArray[np.float64]:
    """Estimate of each model (n_models, 3, n_obs), from decisions (n_steps, n_models, ...)."""
    steps, count = rewards.shape
    features = (observed - observed.mean((0, 1))) / (observed.std((0, 1)) + 1e-6)
    inputs = np.concatenate([np.ones((steps, count, 1)), features, features**2], -1).reshape(steps * count, -1)
    returns, advantages = np.zeros_like(rewards), np.zeros_like(rewards)
    total = np.zeros(count)
    for k in range(steps - 1, -1, -1):
        total = returns[k] = rewards[k] + o.discount * total
    normal = inputs.T @ inputs + 1e-2 * len(inputs) * np.eye(inputs.shape[1])
    values = (inputs @ np.linalg.solve(normal, inputs.T @ returns.ravel())).reshape(steps, count)
    total = np.zeros(count)
    for k in range(steps - 2, -1, -1):
        total = advantages[k] = rewards[k] + o.discount * values[k + 1] - values[k] + o.discount * o.trace * total
    advantages = (advantages - advantages.mean()) / advantages.std()
    return np.asarray(np.einsum("kn,knj,kni->nji", advantages, noise, features) / steps)


def measure(
    env_id: str, arguments: Mapping[str, Any] | None = None, options: LearnabilityOptions | None = None
) -> Learnability:
    """Measure a task.

    Raises
    ------
    ValueError
        If the task has no linear model, or its actions are no offsets of the pitch in the fixed frame.
    """
    arguments, options = dict(arguments or {}), options or LearnabilityOptions()
    model = cached_model(env_id, arguments)
    signal = signal_to_noise(env_id, arguments, options, model)
    return Learnability(bound(env_id, arguments, options), alignment(env_id, arguments, model), signal)
