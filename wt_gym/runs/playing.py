"""Play a run: an agent in an environment, or a controller on a simulator without an environment between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.analysis.metrics import IDLE_ATTRIBUTE
from wt_gym.analysis.results import ReplayRecorder
from wt_gym.control import Demand
from wt_gym.control.controllers import checked_demand, make_controller, readings_of
from wt_gym.control.controllers.discon import BaselineParameters, DisconController
from wt_gym.control.operating_point import starting_point
from wt_gym.envs.episode import episode_steps
from wt_gym.envs.power import DiscWind, available_power
from wt_gym.envs.terminations import IdleClock
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.simulation import Recorder

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import gymnasium as gym
    import xarray as xr

    from wt_gym.analysis.results import Replay
    from wt_gym.control.controllers import Controller
    from wt_gym.envs.episode import Agent, EpisodeStep
    from wt_gym.envs.turbine_env import WindTurbineEnv
    from wt_gym.simulation.channels import Signals
    from wt_gym.simulation.contract import TurbineSimulator

__all__ = ["Episode", "play", "run_baseline", "run_controller"]


@dataclass(frozen=True)
class Episode:
    """What became of a run.

    Attributes
    ----------
    data : xarray.Dataset
        Recorded signals over ``time`` [s], those of the start first.
    time : float
        Simulated [s].
    ending : str
        ``"time"``, or why the environment terminated the episode.
    failure : str or None
        Message of a failed simulation.
    episode_return : float
        Sum of rewards, of all terms with ``vector_reward``.
    reward_terms : dict
        Sum of each term.
    cost : float
        Sum of the costs.
    costs : dict
        Sum of each.
    steps : int
    replay : Replay or None
        Shapes of the last seconds, if they were kept.
    """

    data: xr.Dataset
    time: float
    ending: str
    failure: str | None
    episode_return: float
    reward_terms: dict[str, float]
    cost: float
    costs: dict[str, float]
    steps: int
    replay: Replay | None

    @property
    def after_start(self) -> xr.Dataset:
        """Signals without those of the start: each sample stands for the step that led to it."""
        return self.data.isel(time=slice(1, None))


def play(
    env: gym.Env[Any, Any],
    agent: Agent,
    *,
    seed: int,
    options: dict[str, Any],
    duration: float | None = None,
    replay: float = 0.0,
    on_step: Callable[[EpisodeStep], None] | None = None,
) -> Episode:
    """Reset an environment, let an agent act until the end, and record.

    Parameters
    ----------
    env : gymnasium.Env
        Any with `wt_gym.envs.turbine_env.WindTurbineEnv` inside; of what simulates there `Recorder` needs its channels.
    agent : Agent
    seed, options
        Of the reset.
    duration : float, optional
        Time after which the run is over [s], by default the end of the episode.
    replay : float
        Length of the end whose shapes are kept [s].
    on_step : callable, optional
        Called after every step.

    Raises
    ------
    wt_gym.base.errors.SimulationError
        If the simulation cannot start; what fails later is the ending.
    """
    observation, _ = env.reset(seed=seed, options=options)
    plain = turbine_env_of(env)
    recorder, shapes = Recorder(plain.simulator), ReplayRecorder(round(replay / plain.control_dt))
    recorder.append(plain.signals)
    disc = DiscWind(plain.turbine)
    asked = [_demanded_and_available(plain, disc)]
    most = None if duration is None else round(duration / plain.control_dt)
    total, cost, terms, costs = 0.0, 0.0, dict[str, float](), dict[str, float]()
    for count, step in enumerate(episode_steps(env, agent, observation), start=1):
        info = step.info
        total, cost = total + float(np.sum(step.reward)), cost + info["cost"]
        for name, value in info["reward_terms"].items():
            terms[name] = terms.get(name, 0.0) + value
        for name, value in info["costs"].items():
            costs[name] = costs.get(name, 0.0) + value
        if not step.failed:
            recorder.append(plain.signals)
            asked.append(_demanded_and_available(plain, disc, plain.control_dt))
            if replay:
                shapes.append(info["time"], plain.simulator.geometry())
        if on_step is not None:
            on_step(step)
        if count == most:
            break
    recorder.attributes[IDLE_ATTRIBUTE] = plain.idle.total
    return Episode(
        _with_demanded(recorder.to_dataset(), asked), float(info["time"]), info.get("termination", "time"),
        info.get("failure"), float(total), terms, float(cost), costs, count,
        shapes.to_replay(),
    )  # fmt: skip


def _demanded_and_available(env: WindTurbineEnv, disc: DiscWind, dt: float | None = None) -> tuple[float, float] | None:
    """Power that is asked for, and that the wind allows a rotor across it [W]; None where nothing is asked for.

    At the start, or at the end of a step [s]. As in the reward term ``power`` no yawing changes what is allowed.
    """
    reference, signals = env.operation.reference, env.signals
    if reference is None:
        return None
    inflow = env.operation.wind.inflow
    wind = disc.begin(inflow, signals) if dt is None else disc.advance(inflow, signals, dt)
    return reference.at(signals["time"]), available_power(env.turbine, wind)


def _with_demanded(data: xr.Dataset, asked: list[tuple[float, float] | None]) -> xr.Dataset:
    """Signals with the channels "demanded_power" and "available_power", where something was asked for."""
    if any(one is None for one in asked):
        return data
    columns = np.array(asked).T
    texts = "power that is asked for", "power that the wind over the rotor allows, at most rated"
    added = {
        name: ("time", column, {"units": "W", "long_name": text})
        for name, column, text in zip(("demanded_power", "available_power"), columns, texts, strict=True)
    }
    return data.assign(added)


def run_controller(
    simulator: TurbineSimulator,
    controller: Controller,
    duration: float,
    control_dt: float | None = None,
    on_step: Callable[[Signals], None] | None = None,
    rotor_speed: float | None = None,
    name: str = "controller",
    recorder: Recorder | None = None,
    start: Mapping[str, Any] | None = None,
) -> Recorder:
    """Simulate under a controller from the operating point of the inflow's mean speed.

    Parameters
    ----------
    simulator : Simulator
        Is reset. Any object with its ``reset``, ``advance``, ``turbine``, ``inflow``, ``fidelity`` and ``time_step``.
    controller : Controller
        Is started.
    duration : float
        [s].
    control_dt : float, optional
        Interval of the controller, by default one aerodynamic time step [s].
    on_step : callable, optional
        Called with the signals after every interval.
    rotor_speed : float, optional
        To start with, by default that of the operating point [rad/s].
    name : str
        Of the controller, an attribute of the record.
    recorder : Recorder, optional
        That gets the signals, by default a new one. A given one keeps what was simulated before a stop.
    start : mapping, optional
        Arguments of the reset in place of the operating point.

    Returns
    -------
    Recorder
        Signals at the start and after every interval.

    Raises
    ------
    ValueError
        If interval or duration has no meaning.
    """
    dt = simulator.time_step if control_dt is None else control_dt
    if not (dt > 0.0 and 0.0 <= duration < np.inf):
        raise ValueError(f"a positive interval and a finite duration are needed, got {dt!r} s and {duration!r} s")
    if start is None:
        point = starting_point(simulator.turbine, simulator.inflow)
        start = {"rotor_speed": point.rotor_speed if rotor_speed is None else rotor_speed, "pitch": point.pitch}
    signals = simulator.reset(**start)
    inflow, n_blades = simulator.inflow, simulator.turbine.n_blades
    where = simulator.turbine.hub_height, simulator.turbine.rotation
    controller.start(
        readings_of(controller, signals, inflow, *where), Demand(np.array(signals.pitch), 0.0, signals.generator_torque)
    )
    recorder = Recorder(simulator) if recorder is None else recorder
    recorder.attributes |= {"controller": name, "control_interval_s": dt}
    recorder.append(signals)
    idle, faults = IdleClock(simulator.turbine), simulator.faults
    for _ in range(round(duration / dt)):
        demand = controller.step(readings_of(controller, signals, inflow, *where), dt)
        demand = checked_demand(demand, controller, n_blades)
        signals = simulator.advance(
            dt, pitch=demand.pitch, yaw_rate=demand.yaw_rate, generator_torque=demand.generator_torque
        )
        recorder.append(signals)
        idle.advance(signals, dt, inflow, controller, faults)
        recorder.attributes[IDLE_ATTRIBUTE] = idle.total
        if on_step is not None:
            on_step(signals)
    return recorder


def run_baseline(
    simulator: TurbineSimulator,
    duration: float,
    control_dt: float | None = None,
    on_step: Callable[[Signals], None] | None = None,
    parameters: BaselineParameters | None = None,
    rotor_speed: float | None = None,
    recorder: Recorder | None = None,
) -> Recorder:
    """Simulate under the baseline controller; arguments as `run_controller`.

    Parameters
    ----------
    simulator : Simulator
    duration, control_dt, on_step, rotor_speed, recorder
        See `run_controller`.
    parameters : BaselineParameters, optional
        Constants of a controller with a torque curve; by default the turbine's own controller.
    """
    if parameters is None:
        controller = make_controller("discon", simulator.turbine)
    else:
        controller = DisconController(parameters)
    return run_controller(simulator, controller, duration, control_dt, on_step, rotor_speed, "baseline", recorder)
