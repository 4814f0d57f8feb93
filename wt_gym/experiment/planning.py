"""Planning with the environment itself as the model: shooting by the cross-entropy method from snapshots.

The planner tries its actions in the very episode it controls, so that it knows model and future wind exactly: no
controller of a real turbine does. What it reaches is a bound for those that do not, not their rival.
"""

from __future__ import annotations

from inspect import signature
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from wt_gym.base.options import check_number, shown
from wt_gym.envs.turbine_env import turbine_env_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    import gymnasium as gym
    from numpy.typing import NDArray

    from wt_gym.envs.terms import EnvSnapshot

__all__ = ["ShootingPlanner", "check_settings"]

LONGEST_HORIZON = 600.0
"""[s]; a plan takes its horizon once a sample and round, at every action."""
MOST_ACTIONS = MOST_SAMPLES = MOST_ROUNDS = 1000
"""Of a plan, of a round, and of a search."""
_LEAST_SPREAD = 0.05  # of the samples, so that the search continues


def check_settings(settings: Mapping[str, Any]) -> None:
    """Refuse settings of a `ShootingPlanner` that it would refuse, without an environment.

    Parameters
    ----------
    settings : mapping
        Arguments besides the environment, by name.

    Raises
    ------
    ValueError
    """
    known = {name: p.default for name, p in signature(ShootingPlanner).parameters.items() if name != "env"}
    if unknown := [name for name in settings if name not in known]:
        raise ValueError(f"parameters of a planner must be among {', '.join(known)}; got {', '.join(unknown)}")
    _check(**{**known, **settings})


def _check(horizon: float, hold: float, samples: int, elites: int, rounds: int, spread: float, seed: int) -> None:
    """Refuse times and numbers without meaning."""
    times = {"horizon": horizon, "hold": hold, "spread": spread}
    horizon, hold, spread = (check_number(name, value) for name, value in times.items())
    for name, value in (("samples", samples), ("elites", elites), ("rounds", rounds), ("seed", seed)):
        if isinstance(value, bool) or not isinstance(value, int | np.integer):
            raise ValueError(f"{name} of a planner must be a whole number, got {shown(value)}")
    if horizon > LONGEST_HORIZON:
        raise ValueError(f"the horizon of a planner must be at most {LONGEST_HORIZON:g} s, got {horizon:g} s")
    if not 0.0 < hold <= horizon:
        raise ValueError(f"hold must be positive and at most the horizon of {horizon!r} s, got {hold!r} s")
    if horizon / hold > MOST_ACTIONS:
        raise ValueError(f"a plan must have at most {MOST_ACTIONS} actions, got {horizon!r} s in steps of {hold!r} s")
    if not (1 <= elites <= samples and rounds >= 1):
        raise ValueError(
            f"elites must be from 1 to samples and rounds at least 1, got {elites} of {samples} and {rounds}"
        )
    if samples > MOST_SAMPLES or rounds > MOST_ROUNDS:
        raise ValueError(
            f"samples must be at most {MOST_SAMPLES} and rounds at most {MOST_ROUNDS}, got {samples} and {rounds}"
        )
    if not spread > 0.0:
        raise ValueError(f"spread must be positive and finite, got {spread!r}")
    if seed < 0:
        raise ValueError(f"seed of a planner must be at least 0, got {seed}")


class ShootingPlanner:
    """Chooses the actions whose rewards over the next seconds are best.

    A plan is a sequence of actions, each held for a while. Plans are drawn around the one that was best before, tried
    in the environment, and drawn again around the best of them; zero actions are always among them. The first action of
    the best plan is done, then everything begins again. The environment is left as it was found.

    Parameters
    ----------
    env : gymnasium.Env
        The environment that the actions are for, one of this package, behind any wrappers; what wrappers do to actions
        and rewards is not seen.
    horizon : float
        Time over which rewards are summed [s].
    hold : float
        Time for which an action is held [s], rounded to control steps.
    samples : int
        Plans tried in each round.
    elites : int
        The best of them, around which the next ones are drawn.
    rounds : int
        Rounds of drawing.
    spread : float
        Standard deviation of the plans in the first round.
    seed : int
        Of the draws; they are the planner's own.

    Raises
    ------
    ValueError
        If times or numbers have no meaning.
    """

    def __init__(
        self,
        env: gym.Env,
        horizon: float = 2.0,
        hold: float = 0.4,
        samples: int = 12,
        elites: int = 3,
        rounds: int = 2,
        spread: float = 0.5,
        seed: int = 0,
    ):
        self._env = turbine_env_of(env)
        _check(horizon, hold, samples, elites, rounds, spread, seed)
        self._held = max(1, round(hold / self._env.control_dt))
        self._shape = (max(1, round(horizon / hold)), *self._env.action_space.shape)
        self._samples, self._elites, self._rounds, self._spread = samples, elites, rounds, spread
        self._seed = seed
        self.reset()

    def reset(self) -> None:
        """Forget the plan and begin the draws again."""
        self._rng = np.random.default_rng(self._seed)
        self._plan, self._left = np.zeros(self._shape), 0

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Action for the present instant of the environment, as stable-baselines3's models give it.

        Parameters
        ----------
        observation : numpy.ndarray, shape (n_obs,)
            Not read: the planner has the environment.
        state, deterministic
            Accepted for compatibility.
        episode_start : array_like of bool, optional
            Where True the plan is forgotten.

        Returns
        -------
        action : numpy.ndarray, float32, shape (n_act,)
        state
            As it came.
        """
        if np.ndim(observation) != 1:
            raise ValueError(
                f"observations of a planner must be those of one environment, got shape {np.shape(observation)}"
            )
        if episode_start is not None and np.any(episode_start):
            self.reset()
        if self._left == 0:
            self._plan, self._left = self._search(np.vstack([self._plan[1:], self._plan[-1:]])), self._held
        self._left -= 1
        return self._plan[0].astype(np.float32), state

    def _search(self, guess: np.ndarray) -> np.ndarray:
        """Best plan found, shape (n_actions, n_act)."""
        here = self._env.snapshot()
        best, best_value = None, -np.inf
        center, spread = guess, np.full(self._shape, self._spread)
        try:
            for turn in range(self._rounds):
                drawn = center + spread * self._rng.standard_normal((self._samples, *self._shape))
                plans = np.clip(drawn, -1.0, 1.0)
                if turn == 0:
                    plans = np.concatenate([np.zeros((1, *self._shape)), guess[None], plans])
                values = np.array([self._value(plan, here) for plan in plans])
                order = np.argsort(values)[::-1]
                if values[order[0]] > best_value:
                    best, best_value = plans[order[0]], values[order[0]]
                elites = plans[order[: self._elites]]
                center, spread = elites.mean(axis=0), np.maximum(elites.std(axis=0), _LEAST_SPREAD)
        finally:
            self._env.restore(here)
        return cast(np.ndarray, best)

    def _value(self, plan: np.ndarray, here: EnvSnapshot) -> float:
        """Sum of the rewards of a plan from a snapshot on, until the episode ends."""
        self._env.restore(here)
        total = 0.0
        for action in plan:
            for _ in range(self._held):
                _, reward, terminated, truncated, _ = self._env.step(action)
                total += float(np.sum(reward))
                if terminated or truncated:
                    return total
        return total
