"""Episodes as a pretraining needs them: what the agent sees, the offsets that act, and the loads that come of them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

from wt_gym.base.errors import SimulationError
from wt_gym.control.controllers.fault_supervisor import fault_supervisor_of
from wt_gym.control.controllers.linear_optimal import linear_part, side_sign
from wt_gym.control.controllers.names import BASELINE
from wt_gym.envs.dial import DIAL_NAMES
from wt_gym.envs.options import registered_arguments
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.agents import ConstantAgent
from wt_gym.experiment.run import EpisodePlayer
from wt_gym.simulation.drivetrain.drives import pitch_delay

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.control.actions import Demand
    from wt_gym.control.controllers.controller import Readings
    from wt_gym.envs.episode import Agent
    from wt_gym.envs.turbine_env import WindTurbineEnv

__all__ = ["EpisodeJob", "PlayedActions", "RecordedEpisode", "check_environment", "record_episode"]

_ENDLESS = 10**9  # control steps


@dataclass(frozen=True, eq=False)
class RecordedEpisode:
    """An episode; sample k of the loads is that of the instant at which action k is chosen, the last one has none.

    Attributes
    ----------
    speed : float
        Mean wind [m/s].
    seed : int
    dt : float
        Control step [s].
    observations : numpy.ndarray, shape (n, n_obs), float32
    offsets : numpy.ndarray, shape (3, n)
        Mean, tilt and yaw by which the demands differ from those of the base controller [rad].
    share : numpy.ndarray, shape (n,)
        In which offsets of the agent act.
    flap, pitch : numpy.ndarray, shape (n_blades, n + 1)
        Root moments [N m], pitch [rad].
    tower : numpy.ndarray, shape (2, n + 1)
        Fore-aft and side-side moment at the base [N m].
    power : numpy.ndarray, shape (n + 1,)
        Of the generator [W].
    azimuth : numpy.ndarray, shape (n + 1,)
        In the sense of rotation [rad].
    read_azimuth, read_speed : numpy.ndarray, shape (n,)
        Azimuth and rotor speed by the readings, in whose frame offsets are chosen [rad], [rad/s].
    individual : numpy.ndarray, shape (n,)
        Share of tilt and yaw that a supervisor of faults leaves.
    lead : float
        Time by which the azimuth of the recorded pitch is ahead of that at which an offset was chosen, with the drives
        of the episode [s].
    pitch_gain : float
        Motion of the blades over that of their demand [-].
    """

    speed: float
    seed: int
    dt: float
    observations: NDArray[np.float32]
    offsets: NDArray[np.float64]
    share: NDArray[np.float64]
    flap: NDArray[np.float64]
    pitch: NDArray[np.float64]
    tower: NDArray[np.float64]
    power: NDArray[np.float64]
    azimuth: NDArray[np.float64]
    read_azimuth: NDArray[np.float64]
    read_speed: NDArray[np.float64]
    individual: NDArray[np.float64]
    lead: float
    pitch_gain: float = 1.0

    @property
    def steps(self) -> int:
        """N."""
        return int(self.offsets.shape[1])


@dataclass(frozen=True)
class EpisodeJob:
    """An episode to be recorded, from the beginning of its turbulence.

    Attributes
    ----------
    env_id : str
    arguments : str
        Of the environment, as JSON.
    speed : float
        [m/s].
    seed : int
        Of the turbulence.
    duration : float
        [s].
    agent : Agent or None
        None: actions of zero.
    baseline : bool
        Under the controller of the id instead of the base controller: the published one, with the additions of a task.
    dial : tuple of float or None
        Factors of `wt_gym.envs.dial`, for the whole episode.
    condition : str
        Further arguments of the environment, as JSON; those of ``arguments`` have no faults.
    """

    env_id: str
    arguments: str
    speed: float
    seed: int
    duration: float
    agent: Agent | None = None
    baseline: bool = False
    dial: tuple[float, ...] | None = None
    condition: str = "{}"


class PlayedActions:
    """Agent that plays actions, whatever it sees.

    Parameters
    ----------
    actions : numpy.ndarray, shape (n, n_act)
        After the last come zeros.
    """

    def __init__(self, actions: NDArray[np.float64]) -> None:
        self.actions, self._count = actions.astype(np.float32), 0

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Next action."""
        k = self._count
        self._count += 1
        return (self.actions[k] if k < len(self.actions) else np.zeros_like(self.actions[0])), state


class _Watched:
    """Agent whose observations are kept, and the frame in which its offsets act: that of the readings."""

    def __init__(self, agent: Agent, env: WindTurbineEnv) -> None:
        self.agent, self._env = agent, env
        self.seen: list[NDArray[np.float32]] = []
        self.frame: list[tuple[float, float]] = []

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        self.seen.append(np.array(observation, dtype=np.float32))
        readings: Readings = self._env.operation.readings()
        if (watcher := fault_supervisor_of(self._env.controller)) is not None:
            readings = watcher.believed(readings)
        self.frame.append((readings["azimuth"], readings["rotor_speed"]))
        return self.agent.predict(observation, state=state, episode_start=episode_start, deterministic=deterministic)


def check_environment(env: WindTurbineEnv) -> None:
    """Refuse an environment in which actions have an effect on later observations that no model takes away.

    Raises
    ------
    ValueError
    """
    chosen = env.options.actions
    if not (chosen.mode == "residual" and chosen.pitch == "fixed-frame" and chosen.residual == "offset"):
        raise ValueError(
            "pretraining needs action_mode='residual', pitch='fixed-frame' and residual_form='offset', got "
            f"{chosen.mode!r}, {chosen.pitch!r} and {chosen.residual!r}"
        )
    if tuple(env.layout.action.names) != tuple(f"pitch_{name}_offset" for name in ("mean", "tilt", "yaw")):
        raise ValueError(f"pretraining needs the actions mean, tilt and yaw alone, got {list(env.layout.action.names)}")
    if linear_part(env.controller) is None:
        raise ValueError(
            "pretraining needs a base controller with linear_pitch, such as controller='linear_optimal': it takes the "
            "effect of the agent's offsets off what is measured"
        )
    names = env.layout.observation.names
    # a lidar reads the wind without the rotor's induction, from a nacelle that no action turns; the fit of the model
    # moves over half a minute, and is taken as given
    independent = ("disturbance_", "linear_pitch_", "model_", "lidar_", "dial_")
    if foreign := [name for name in names if not name.startswith(independent)]:
        raise ValueError(
            "pretraining needs observations that do not depend on the actions: observation=['disturbances'], in "
            "conditions ['disturbances', 'model_fit'], with a lidar ['disturbances', 'lidar'], with a dial "
            "['disturbances', 'dial'], got "
            f"{', '.join(foreign[:5])}"
        )
    if env.operation.count != 1:
        raise ValueError(f"pretraining needs control_dt={env.operation.step:g}, the step of the simulator")
    if env.options.variation.varies or env.sensors == "all":
        raise ValueError("pretraining needs one plant and exact sensors: leave out variation and sensors='all'")
    if env.options.observations.history != 1 or env.options.observations.delay:
        raise ValueError("pretraining needs history=1 and sensor_delay=0")


@lru_cache(maxsize=12)
def _environment(env_id: str, arguments: str, baseline: bool, condition: str) -> gym.Env[Any, Any]:
    """Environment that a process keeps."""
    given: dict[str, Any] = {k: value for k, value in json.loads(arguments).items() if not k.startswith("fault_")}
    given |= {"relative_reward": False, "fault_kinds": None, "episode_length": None}  # a job has its own duration
    given |= json.loads(condition)
    if baseline:
        published = registered_arguments(env_id, {}).get("controller", BASELINE)
        given |= {"controller": published, "observation": ["rotor"], "residual_fade": False, "residual_washout": None}
    env = gym.make(env_id, max_episode_steps=_ENDLESS, **given)
    turbine_env_of(env).outer_steps = _ENDLESS
    return env


def record_episode(job: EpisodeJob) -> RecordedEpisode:
    """Play an episode and record it.

    Raises
    ------
    wt_gym.base.errors.SimulationError
        If the episode ends early.
    """
    env = _environment(job.env_id, job.arguments, job.baseline, job.condition)
    plain = turbine_env_of(env)
    agent = _Watched(job.agent or ConstantAgent(plain.layout), plain)
    demands: list[tuple[Demand, Demand]] = []
    share: list[float] = []
    individual: list[float] = []

    options: dict[str, Any] = {"wind_speed": job.speed, "wind_seed": job.seed, "time_offset": 0.0}
    if job.dial is not None:
        options["dial"] = dict(zip(DIAL_NAMES, job.dial, strict=True))
    player = EpisodePlayer(env, agent, seed=job.seed, options=options, duration=job.duration)
    for _ in player:
        operation = plain.operation
        share.append(1.0 if operation.residual is None else operation.residual.share)
        watcher = fault_supervisor_of(plain.controller)
        individual.append(1.0 if watcher is None else watcher.share)
        demands.append((operation.base, operation.demand))
    done = player.episode
    if done.ending != "time":
        raise SimulationError(
            f"the episode at {job.speed:g} m/s, seed {job.seed}, ended after {done.time:g} s ({done.ending}): "
            "pretraining needs whole episodes; give smaller action_spans"
        )
    data, sign, dt = done.data, side_sign(plain.turbine), plain.control_dt
    blades = range(1, plain.turbine.n_blades + 1)

    def series(name: str) -> NDArray[np.float64]:
        return data[name].values.astype(float)

    part, frame = linear_part(plain.controller), np.array(agent.frame[: len(demands)])
    offsets = np.zeros((len(demands), 3))
    if part is not None:
        for k, (base, demand) in enumerate(demands):
            offsets[k] = part.offsets.between(base, demand, *agent.frame[k], dt)
    return RecordedEpisode(
        speed=job.speed,
        seed=job.seed,
        dt=dt,
        observations=np.stack(agent.seen[: len(share)]),
        offsets=offsets.T.copy(),
        share=np.array(share),
        flap=np.stack([series(f"root_flap_moment_{b}") for b in blades]),
        pitch=np.stack([series(f"pitch_{b}") for b in blades]),
        tower=np.stack([series("tower_base_fore_aft_moment"), sign * series("tower_base_side_side_moment")]),
        power=series("generator_power"),
        azimuth=series("azimuth"),
        read_azimuth=frame[:, 0],
        read_speed=frame[:, 1],
        individual=np.array(individual),
        # the demand is ahead by what the nominal drives take; those of the episode take it back, and more
        lead=2.0 * pitch_delay(plain.turbine.pitch, dt) - pitch_delay(plain.simulator.turbine.pitch, dt),
        pitch_gain=1.0 if plain.operation.pitch_gain is None else plain.operation.pitch_gain.gain,
    )
