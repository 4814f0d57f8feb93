"""How an episode ends: by what the turbine does, by its length, or by a limit from outside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import gymnasium as gym

from wt_gym.base.options import check_whole_steps

if TYPE_CHECKING:
    from gymnasium.envs.registration import EnvSpec

    from wt_gym.simulation import Signals
    from wt_gym.turbines import Turbine

__all__ = ["EpisodeLength", "Limits", "registered_limit", "standstill_limit", "tip_clearance"]


@dataclass
class Limits:
    """What terminates an episode.

    Attributes
    ----------
    rated : float
        Rotor speed [rad/s].
    overspeed, standstill : float
        Highest and lowest rotor speed over rated.
    penalty : float
        That is taken off the reward then.
    """

    rated: float
    overspeed: float
    standstill: float
    penalty: float

    def ending(self, signals: Signals, clearance: float) -> str | None:
        """Why the episode is terminated, if it is.

        Parameters
        ----------
        signals : Signals
            After a step.
        clearance : float
            Smallest one of a tip during the step, see `tip_clearance` [m].
        """
        if signals["rotor_speed_max"] > self.overspeed * self.rated:
            return "overspeed"
        if signals["rotor_speed"] < self.standstill * self.rated:
            return "standstill"
        return "tower_strike" if clearance <= 0.0 else None

    def punish(self, reward: float, terms: dict[str, float]) -> tuple[float, dict[str, float]]:
        """Reward and terms of a terminated episode's last step."""
        return reward - self.penalty, {**terms, "termination": -self.penalty}


def standstill_limit(given: float | None, turbine: Turbine, parks: bool) -> float:
    """Lowest rotor speed over rated rotor speed: what is given, or what suits the generator.

    Raises
    ------
    ValueError
        If parked rotors, which may turn slowly to either side, would end at once.
    """
    limit = given if given is not None else 0.2 if turbine.drivetrain.takes_torque else -1.0
    if parks and limit >= 0.0:
        raise ValueError(
            "standstill_limit must be negative for extreme winds: an episode starts a parked rotor, which may turn "
            f"slowly to either side; got {limit!r}"
        )
    return limit


def tip_clearance(signals: Signals) -> float:
    """Smallest signed distance of a tip from the tower during the last step [m]."""
    return float(min(signals["tip_clearance_min"].tolist()))


def registered_limit(spec: EnvSpec | None) -> int | None:
    """Control steps after which episodes of an id end, if it has such a limit; one given to `make` is not known."""
    registered = None if spec is None else gym.registry.get(spec.id)
    return None if registered is None else registered.max_episode_steps


class EpisodeLength:
    """When an episode is truncated.

    Parameters
    ----------
    time : float or None
        Length of an episode [s]; None: without an end of its own.
    control_dt : float
        [s]

    Attributes
    ----------
    steps : int or None
        Control steps after which it ends.

    Raises
    ------
    ValueError
        If the time is not a whole number of control steps, at least one.
    """

    def __init__(self, time: float | None, control_dt: float):
        self.steps = None if time is None else check_whole_steps("episode_length", time, control_dt, least=1)
        self._control_dt, self._told = control_dt, False

    def longest(self, spec: EnvSpec | None, outer_steps: int | None) -> float | None:
        """Longest time that an episode can last [s], None without a limit.

        Parameters
        ----------
        spec : EnvSpec or None
            What the environment was made of. A `gymnasium.wrappers.TimeLimit` does not tell what it encloses; that of
            the id is known.
        outer_steps : int or None
            Control steps after which something outside ends an episode, where that is told.
        """
        steps = self.steps
        if steps is None:
            steps = registered_limit(spec) if outer_steps is None else outer_steps
        return None if steps is None else steps * self._control_dt

    def warn(self, spec: EnvSpec | None, outer_steps: int | None) -> None:
        """Warn, once, where the limit of an id ends episodes before the length that they were given.

        Parameters
        ----------
        spec : EnvSpec or None
        outer_steps : int or None
            Control steps that episodes are known to end after from outside; None: the limit of the id may stand.
        """
        limit, wanted = registered_limit(spec), self.steps
        if spec is None or limit is None or wanted is None or outer_steps not in (None, limit) or wanted <= limit:
            return
        if self._told:
            return
        self._told = True
        gym.logger.warn(
            f"the limit of {spec.id} ends episodes after {limit} steps, {limit * self._control_dt:g} s, before the "
            f"episode_length of {wanted * self._control_dt:g} s: make it with max_episode_steps={wanted} instead"
        )
