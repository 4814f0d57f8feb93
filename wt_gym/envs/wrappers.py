"""Wrappers: the reward as a vector of objectives, and a filter of actions that protects the limits of the costs.

A vector reward has the convention of MO-Gymnasium (Felten et al., NeurIPS 2023), which need not be installed: ``step``
gives an array in place of a number; ``unwrapped.reward_space`` and ``unwrapped.reward_dim`` describe it, which is where
that library's wrappers and learners look.

Before a step near a limit the safety filter takes it on trial and lets the base controller continue from there for a
horizon, by a snapshot of the environment. If the turbine leaves a limit on the way or ends, the agent's action is
replaced by the one that takes its offsets back as fast as they may move. This is the one-step form of predictive safety
filters (Wabersich and Zeilinger, Automatica 129, 2021), with the simulator as model: its trials know the wind to come,
so the filter is a bound on what a filter of a turbine, which must estimate that wind, can do.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from wt_gym.base.options import check_number, shown
from wt_gym.envs.dial import DIAL_NAMES, DIALED, factor_of
from wt_gym.envs.terminations import PITCH_TRAVEL
from wt_gym.envs.turbine_env import WindTurbineEnv, turbine_env_of
from wt_gym.turbines.variants import unloaded_clearance

PROTECTION = "protection"
"""Objective of the terms that no factor of a dial is for, and of the penalty for an early end."""
_END = "termination"


class VectorReward(gym.Wrapper[np.ndarray, np.ndarray, np.ndarray, np.ndarray], gym.utils.RecordConstructorArgs):
    """The reward of any task as a vector of objectives, without the factors of a dial.

    Each objective is the sum of its reward terms with the weights of the task, relative to the base controller where
    the reward is. The objectives add up to the reward; with a dial, those of fatigue, power and travel do so times its
    factors.

    Parameters
    ----------
    env : gymnasium.Env
        With a `wt_gym.envs.turbine_env.WindTurbineEnv` inside whose reward is a number.
    objectives : {"dial", "terms"} or mapping of str to sequence of str
        ``"dial"``: fatigue, power, travel and `PROTECTION`. ``"terms"``: each term over its weight, and the end of the
        episode as -1. A mapping: names of objectives to those of their terms; others, and the penalty for an early end,
        are `PROTECTION`.

    Raises
    ------
    ValueError
        If the reward is a vector already, or there is no such term.
    """

    def __init__(self, env: gym.Env[Any, Any], objectives: str | Mapping[str, Sequence[str]] = "dial"):
        gym.utils.RecordConstructorArgs.__init__(self, objectives=objectives)
        gym.Wrapper.__init__(self, env)
        self._plain = plain = turbine_env_of(env)
        if plain.options.rewards.vector:
            raise ValueError("the reward of the environment must be a number, got vector_reward=True")
        self._weights = {term.name: float(term.weight) for term in plain.reward_terms}
        self._alone = objectives == "terms"
        kinds: dict[str, tuple[str, ...]] = {name: (name,) for name in (*self._weights, _END)}
        if self._alone:
            self._weights |= {_END: plain.limits.penalty or 1.0}
        else:
            kinds = self._kinds(objectives)
        self._index = {term: k for k, terms in enumerate(kinds.values()) for term in terms}
        self.objectives = tuple(kinds)  # names of the components
        inner = cast(Any, plain)
        inner.reward_space = spaces.Box(-np.inf, np.inf, (len(kinds),), np.float32)
        inner.reward_dim = len(kinds)

    def _kinds(self, objectives: str | Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
        """Terms by objective."""
        if objectives == "dial":
            chosen = {name: tuple(t for t in DIALED[name] if t in self._weights) for name in DIAL_NAMES}
        elif isinstance(objectives, str):
            raise ValueError(f"objectives must be 'dial', 'terms' or a mapping, got {objectives!r}")
        else:
            chosen = {name: tuple(terms) for name, terms in objectives.items()}
        given = [term for terms in chosen.values() for term in terms]
        if unknown := [term for term in given if term not in self._weights]:
            raise ValueError(f"objectives must have terms among {', '.join(self._weights)}, got {shown(unknown)}")
        if len(set(given)) != len(given) or PROTECTION in chosen:
            raise ValueError(f"objectives must have each term once and no name {PROTECTION!r}, got {shown(chosen)}")
        return {**chosen, PROTECTION: (*(t for t in self._weights if t not in given), _END)}

    def step(self, action: Any) -> tuple[np.ndarray, np.ndarray, bool, bool, dict[str, Any]]:
        """As of the environment, with a reward of shape (n_objectives,), float32.

        ``info["objectives"]`` has it by name, ``info["scalar_reward"]`` the reward of the environment.
        """
        dial = self._plain.dial  # that holds for this step
        factors = None if dial is None else tuple(dial.values())
        observation, reward, terminated, truncated, info = self.env.step(action)
        vector = np.zeros(len(self.objectives))
        for name, value in info["reward_terms"].items():
            plain = value if factors is None else value / factor_of(name, factors)
            vector[self._index[name]] += plain / self._weights[name] if self._alone else plain
        found = vector.astype(np.float32)
        by_name = dict(zip(self.objectives, found.tolist(), strict=True))
        info = info | {"objectives": by_name, "scalar_reward": float(cast(Any, reward))}
        return observation, found, terminated, truncated, info


class SafetyFilter(gym.Wrapper[np.ndarray, np.ndarray, np.ndarray, np.ndarray], gym.utils.RecordConstructorArgs):
    """Replaces actions after which the base controller could not keep the limits.

    ``info["filtered"]`` says whether the action of a step was replaced, ``info["filtered_share"]`` in which share of
    the steps of the episode.

    Parameters
    ----------
    env : gymnasium.Env
        With residual actions and ``cost_limits`` on rotor speed, tip clearance or tower acceleration; the pitch travel
        is a matter of long times and not filtered.
    horizon : float
        Time for which the base controller must keep the limits after the step [s].
    watch : float
        Share of the way to a limit from which steps are tried: from rated rotor speed, from the clearance of the
        unloaded rotor, from no acceleration; 0: all steps, at the cost of as many simulated ones as a horizon has.

    Raises
    ------
    ValueError
        If actions are not residual, nothing is limited, or a number has no meaning.
    """

    def __init__(self, env: gym.Env[Any, Any], horizon: float = 5.0, watch: float = 0.5):
        gym.utils.RecordConstructorArgs.__init__(self, horizon=horizon, watch=watch)
        gym.Wrapper.__init__(self, env)
        self._plain = plain = turbine_env_of(env)
        limits = {name: limit for name, limit in (plain.options.limits.costs or {}).items() if name != PITCH_TRAVEL}
        if plain.layout.action.mode != "residual":
            raise ValueError(f"a safety filter needs action_mode='residual', got {plain.layout.action.mode!r}")
        if not limits:
            raise ValueError(
                "a safety filter needs cost_limits on rotor_speed, tip_clearance or tower_acceleration, got "
                f"{plain.options.limits.costs!r}"
            )
        self._limits = limits
        self._steps = round(check_number("horizon", horizon, "s") / plain.control_dt)
        self._watch = check_number("watch", watch)
        if self._steps < 1 or not 0.0 <= self._watch < 1.0:
            raise ValueError(
                f"horizon must be at least {plain.control_dt:g} s and watch from 0 to below 1, got {horizon!r} s and "
                f"{watch!r}"
            )
        self._free = unloaded_clearance(plain.turbine)
        self._count = self._filtered = 0

    def reset(self, **arguments: Any) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode."""
        self._count = self._filtered = 0
        observation, info = self.env.reset(**arguments)
        return observation, info | {"filtered": False, "filtered_share": 0.0}

    def step(self, action: Any) -> tuple[np.ndarray, Any, bool, bool, dict[str, Any]]:
        """As of the environment, with the action or the one that takes the offsets back."""
        replaced = self._near() and not self._holds(action)
        taken = retreat(self._plain) if replaced else action
        observation, reward, terminated, truncated, info = self.env.step(taken)
        self._count += 1
        self._filtered += replaced
        result = {"filtered": replaced, "filtered_share": self._filtered / self._count}
        return observation, reward, terminated, truncated, info | result

    def _near(self) -> bool:
        """Return True if the turbine is on its way to a limit."""
        return any(self._way(name, limit) >= self._watch for name, limit in self._limits.items())

    def _way(self, name: str, limit: float) -> float:
        """Share of the way to a limit that the turbine has come in the last step."""
        signals = self._plain.signals
        if name == "rotor_speed":
            way = signals["rotor_speed_max"] / self._plain.turbine.drivetrain.rated_rotor_speed - 1.0
            return float(way / (limit - 1.0)) if limit > 1.0 else math.inf
        if name == "tip_clearance":
            way = self._free - min(signals["tip_clearance_min"].tolist())
            return float(way / (self._free - limit)) if limit < self._free else math.inf
        axes = (signals[f"nacelle_acceleration_{axis}"] for axis in ("fore_aft", "side_side"))
        return math.hypot(*axes) / limit

    def _holds(self, action: Any) -> bool:
        """Return True if the limits hold in the step and under the base controller after it; the environment stays."""
        plain = self._plain
        here = plain.snapshot()
        try:
            for k in range(1 + self._steps):
                *_, terminated, truncated, info = plain.step(action if k == 0 else retreat(plain))
                if terminated or any(info["costs"][name] > 0.0 for name in self._limits):
                    return False
                if truncated:
                    return True
            return True
        finally:
            plain.restore(here)


def retreat(env: WindTurbineEnv) -> np.ndarray:
    """Action (n_act,) that takes residual offsets back to the demands of the base controller, as fast as they move."""
    action, setpoint = env.layout.action, env.setpoint
    out = np.zeros(action.size, dtype=np.float32)
    if action.residual == "offset":
        return out
    held = {}
    if "pitch" in action.components:
        held = dict(zip(action.names[: action.n_pitch], np.atleast_1d(setpoint.pitch), strict=False))
    if "torque" in action.components:
        held[action.names[action._torque_at]] = setpoint.generator_torque
    if "set_point" in action.components:
        held[action.names[-1]] = setpoint.set_point
    for k, name in enumerate(action.names):
        if name in held:
            out[k] = np.clip(-held[name] / (float(action.high[k]) * env.control_dt), -1.0, 1.0)
    return out
