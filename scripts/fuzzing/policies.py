"""What a fuzzed environment is asked to do."""

from collections.abc import Callable, Iterator

import numpy as np

from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.agents import ControllerAgent


class Policy:
    """Actions that take no notice of what they do.

    Parameters
    ----------
    kind : str
        "random": evenly drawn in each step; "constant": one drawn action; "corner": each component at an end;
        "component": one component at an end, the others at rest; "bang-bang": from end to end, with a drawn period;
        "walk": small drawn changes; "mixed": stretches of all these.
    size : int
        Of an action.
    """

    def __init__(self, kind: str, size: int, rng: np.random.Generator):
        self._kind, self._size, self._rng = kind, size, rng
        self._actions = self._series()

    def __call__(self, observation: np.ndarray, start: bool) -> np.ndarray:
        """Action for an observation; the first of an episode begins a new series."""
        if start:
            self._actions = self._series()
        return next(self._actions).astype(np.float32)

    def _series(self) -> Iterator[np.ndarray]:
        if self._kind != "mixed":
            yield from _SERIES[self._kind](self._size, self._rng)
        while True:
            series = _SERIES[str(self._rng.choice(list(_SERIES)))](self._size, self._rng)
            for _ in range(int(self._rng.integers(5, 60))):
                yield next(series)


def _random(size: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    while True:
        yield rng.uniform(-1.0, 1.0, size)


def _constant(size: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    action = rng.uniform(-1.0, 1.0, size)
    while True:
        yield action


def _corner(size: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    action = rng.choice([-1.0, 1.0], size)
    while True:
        yield action


def _component(size: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    action = np.zeros(size)
    action[rng.integers(size)] = rng.choice([-1.0, 1.0])
    while True:
        yield action


def _bang_bang(size: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    period, signs = int(rng.integers(1, 40)), rng.choice([-1.0, 0.0, 1.0], size)
    while True:
        for sign in (1.0, -1.0):
            for _ in range(period):
                yield sign * signs


def _walk(size: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    action = np.zeros(size)
    while True:
        action = np.clip(action + rng.normal(0.0, 0.1, size), -1.0, 1.0)
        yield action


_SERIES: dict[str, Callable[[int, np.random.Generator], Iterator[np.ndarray]]] = {
    "random": _random,
    "constant": _constant,
    "corner": _corner,
    "component": _component,
    "bang-bang": _bang_bang,
    "walk": _walk,
}


def make_policy(kind: str, env: WindTurbineEnv, rng: np.random.Generator) -> Callable[[np.ndarray, bool], np.ndarray]:
    """Policy of a case (`fuzzing.cases.POLICY_NAMES`): of an observation, and whether it is the first of an episode."""
    if kind != "controller":
        return Policy(kind, env.layout.action.size, rng)
    names = ["discon", "retuned"]
    if env.turbine.n_blades > 2:
        names += ["ipc", "constrained_ipc"]
    if "rotor_wind" in env.layout.observation.names:  # what it reads too, which some turbines have to measure first
        names.append("tsr_tracking")
    agent = ControllerAgent(env.layout, str(rng.choice(names)))
    return lambda observation, start: agent.predict(observation, episode_start=[start])[0]
