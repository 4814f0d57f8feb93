"""Winds to evaluate in, of an environment and of what a command line asks for; and winds that runs had."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import gymnasium as gym

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.analysis.results import Wind
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from wt_gym.envs.turbine_env import WindTurbineEnv
    from wt_gym.envs.wind_sampler import WindSampler

__all__ = ["DEFAULT_WIND_SEEDS", "USUAL_SPEED", "actual_wind", "winds_for", "winds_of"]

DEFAULT_WIND_SEEDS = EVALUATION_WIND_SEEDS[:6]
"""Turbulence seeds that no training saw; six is what IEC 61400-1 asks for at each mean speed."""
USUAL_SPEED = 15.0
"""Where nothing is said, winds have this mean speed [m/s] if the environment draws it, else that in the middle."""
_DRAWS = len(DEFAULT_WIND_SEEDS)


def winds_for(
    env_id: str,
    env_kwargs: Mapping[str, Any],
    speeds: Sequence[float] | None = None,
    seeds: Sequence[int] | None = None,
    draws: int | None = None,
    length: float | None = None,
) -> tuple[Wind, ...]:
    """Winds of an environment by id; see `winds_of`."""
    env = gym.make(env_id, **env_kwargs)
    try:
        return winds_of(turbine_env_of(env).wind, speeds, seeds, draws, length)
    finally:
        env.close()


def winds_of(
    wind: WindSampler,
    speeds: Sequence[float] | None = None,
    seeds: Sequence[int] | None = None,
    draws: int | None = None,
    length: float | None = None,
) -> tuple[Wind, ...]:
    """Every speed with every turbulence seed, or with every draw of what else an environment draws.

    Parameters
    ----------
    wind : WindSampler
        Of the environment.
    speeds : sequence of float, optional
        Mean speeds [m/s]; by default `USUAL_SPEED`, or the middle of the environment's range if that lies outside.
    seeds : sequence of int, optional
        Turbulence seeds, by default `DEFAULT_WIND_SEEDS`.
    draws : int, optional
        Of gusts, of several inflows, of the time in a file, of the direction of a wind without turbulence; by default
        six, or as many as files have pieces of the length of a run.
    length : float, optional
        Of a run [s].

    Returns
    -------
    tuple of Wind

    Raises
    ------
    ValueError
        If something is asked for that the wind of the environment does not have.
    """
    turbulent, drawn = "wind_seed" in wind.options, wind.draws_more and "wind_seed" not in wind.options
    if speeds is not None and "wind_speed" not in wind.options:
        raise ValueError(f"speeds must be left out, the wind of this environment has its own; got {list(speeds)} m/s")
    if seeds is not None and not turbulent:
        instead = ": give a number of draws" if drawn else ""
        raise ValueError(f"seeds must be left out, the wind of this environment has none; got {list(seeds)}{instead}")
    if draws is not None and not drawn:
        instead = "give turbulence seeds" if turbulent else "one run in it is all"
        raise ValueError(f"draws must be left out: the wind of this environment has its speed and seed only; {instead}")
    if draws is not None and draws < 1:
        raise ValueError(f"draws must be at least 1, got {draws!r}")
    if drawn and length is not None and (pieces := wind.windows(length)):
        if draws is not None and draws > len(pieces):
            raise ValueError(
                f"draws must be at most {len(pieces)}, the windows of {length:g} s in the files; "
                f"got {draws}: make runs shorter"
            )
        draws = min(draws or _DRAWS, len(pieces))
    return tuple(
        Wind(speed, seed, draw)
        for speed in (speeds or (_usual_speed(*wind.asked_speeds),))
        for seed in ((seeds or DEFAULT_WIND_SEEDS) if turbulent else (None,))
        for draw in (range(1, (draws or _DRAWS) + 1) if drawn else (None,))
    )


def actual_wind(env: WindTurbineEnv, asked: Wind, winds: Sequence[Wind]) -> Wind:
    """Wind that an episode has: its speed and seed, and in words what these do not tell.

    Parameters
    ----------
    env : WindTurbineEnv
        Has been reset for the wind that was asked for.
    asked : Wind
    winds : sequence of Wind
        All that are asked for. Those that mean the same to the environment are numbered.
    """
    own, options = env.episode_wind, env.wind.options

    def heard(wind: Wind) -> Wind:
        speed = wind.speed if "wind_speed" in options else 0.0
        return replace(wind, speed=speed, seed=wind.seed if "wind_seed" in options else None)

    draw = asked.draw
    if sum(heard(wind) == heard(asked) for wind in winds) > 1:
        draw = winds.index(asked) + 1
    description = own.inflow.description if env.wind.draws_more or env.wind.seeds is None else ""
    seed = own.wind_seed if own.wind_seed >= 0 else None
    return Wind(float(own.wind_speed), seed, draw, description if seed is None else "")


def _usual_speed(low: float, high: float) -> float:
    return USUAL_SPEED if low <= USUAL_SPEED <= high else 0.5 * (low + high)
