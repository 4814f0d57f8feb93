"""One run: an agent in an environment, or a controller on a simulator without an environment, and its metrics."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wt_gym.analysis.metrics import IDLE_ATTRIBUTE, run_metrics
from wt_gym.analysis.results import Replay, ReplayRecorder
from wt_gym.base.canary import CANARY, Canary, cached_canary, canary_text
from wt_gym.base.errors import SimulationError
from wt_gym.control import Demand
from wt_gym.control.controllers import Controller, checked_demand, make_controller, readings_of
from wt_gym.control.controllers.discon import BaselineParameters, DisconController
from wt_gym.control.design import rotor_inertia
from wt_gym.control.operating_point import starting_point
from wt_gym.envs.canary import canary_of, control_step
from wt_gym.envs.episode import Agent, EpisodeStep, episode_steps
from wt_gym.envs.power import DiscWind, available_power
from wt_gym.envs.record_store import user_record_digest
from wt_gym.envs.running_record import time_scale
from wt_gym.envs.terminations import IdleClock
from wt_gym.envs.terms import Transition
from wt_gym.envs.turbine_env import WindTurbineEnv, turbine_env_of
from wt_gym.simulation import Fidelity, Recorder, Signals
from wt_gym.simulation.contract import TurbineSimulator, fingerprint
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.simulation.fidelity import suited_fidelity
from wt_gym.turbines import Turbine

if TYPE_CHECKING:
    import gymnasium as gym
    import xarray as xr

__all__ = [
    "ENDLESS", "LEAST_MEASURED", "Episode", "EpisodePlayer", "benchmark_fingerprint", "benchmark_metrics",
    "delivered_power", "play", "run_baseline", "run_controller",
]  # fmt: skip

ENDLESS = 10**9
"""Control steps that no run has: its duration is the only limit."""
LEAST_MEASURED = 2.0
"""Metrics of a few samples say nothing: runs that end earlier than this after the skipped start have none [s]."""
_SHORT, _SHORT_SKIP = 4.0, 1.0
"""Length of the run whose metrics are compared, and of its start that they leave out, for a large turbine [s]."""
_SPELL = 10.0  # s, over which power beyond the rated one may make up for power below it


@dataclass(frozen=True)
class Episode:
    """Outcome of a run."""

    data: xr.Dataset  #: recorded signals over ``time`` [s], those of the start first
    time: float  #: simulated [s]
    ending: str  #: ``"time"``, or why the environment terminated the episode
    failure: str | None  #: message of a failed simulation
    episode_return: float  #: sum of rewards, of all terms with ``vector_reward``
    reward_terms: dict[str, float]  #: sum of each term
    cost: float  #: sum of the costs
    costs: dict[str, float]  #: sum of each
    steps: int
    replay: Replay | None  #: shapes of the last seconds, if they were stored

    @property
    def after_start(self) -> xr.Dataset:
        """Signals without those of the start: each sample stands for the step that led to it."""
        return self.data.isel(time=slice(1, None))


class EpisodePlayer:
    """A run of an agent: an iterator over its steps, and the `Episode` when these have ended.

    Parameters
    ----------
    env : gymnasium.Env
        Any with `wt_gym.envs.turbine_env.WindTurbineEnv` inside; its simulator needs the channels of `Recorder`.
    seed, options
        Of the reset.
    duration : float, optional
        Time after which the run is over [s], by default the end of the episode.
    replay : float
        Length of the end whose shapes are stored [s].
    """

    episode: Episode
    """Outcome, after the last step."""

    def __init__(
        self, env: gym.Env[Any, Any], agent: Agent, *, seed: int, options: dict[str, Any],
        duration: float | None = None, replay: float = 0.0,
    ):  # fmt: skip
        self._env, self._agent, self._seed, self._options = env, agent, seed, options
        self._duration, self._replay = duration, replay

    def __iter__(self) -> Iterator[EpisodeStep]:
        """Reset the environment, let the agent act until the end, and record.

        A simulation that cannot start raises a `SimulationError`; a later failure is the ending.
        """
        env, replay = self._env, self._replay
        observation, _ = env.reset(seed=self._seed, options=self._options)
        plain = turbine_env_of(env)
        recorder, shapes = Recorder(plain.simulator), ReplayRecorder(round(replay / plain.control_dt))
        recorder.append(plain.signals)
        disc = DiscWind(plain.turbine)
        powers = [_demanded_and_available(plain, disc)]
        most = None if self._duration is None else round(self._duration / plain.control_dt)
        total, cost, terms, costs = 0.0, 0.0, dict[str, float](), dict[str, float]()
        for count, step in enumerate(episode_steps(env, self._agent, observation), start=1):
            info = step.info
            total, cost = total + float(np.sum(step.reward)), cost + info["cost"]
            for name, value in info["reward_terms"].items():
                terms[name] = terms.get(name, 0.0) + value
            for name, value in info["costs"].items():
                costs[name] = costs.get(name, 0.0) + value
            if not step.failed:
                recorder.append(plain.signals)
                powers.append(_demanded_and_available(plain, disc, plain.control_dt))
                if replay:
                    shapes.append(info["time"], plain.simulator.geometry())
            yield step
            if count == most:
                break
        recorder.attributes[IDLE_ATTRIBUTE] = plain.idle.total
        data = recorder.to_dataset()
        if None not in powers:
            demanded, available = np.array(powers).T
            allowed = "power that the wind over the rotor allows, at most rated"
            data = data.assign(
                demanded_power=("time", demanded, {"units": "W", "long_name": "power that is asked for"}),
                available_power=("time", available, {"units": "W", "long_name": allowed}),
            )
        self.episode = Episode(
            data, float(info["time"]), info.get("termination", "time"),
            info.get("failure"), float(total), terms, float(cost), costs, count, shapes.to_replay(),
        )  # fmt: skip


def play(env: gym.Env[Any, Any], agent: Agent, **settings: Any) -> Episode:
    """Play a run to its end; parameters and errors as of `EpisodePlayer`."""
    player = EpisodePlayer(env, agent, **settings)
    for _ in player:
        pass
    return player.episode


def _demanded_and_available(env: WindTurbineEnv, disc: DiscWind, dt: float | None = None) -> tuple[float, float] | None:
    """Power demanded, and that which the wind allows a rotor across it [W], at the start or the end of a step [s]."""
    reference, signals = env.operation.reference, env.signals
    if reference is None:
        return None
    inflow = env.operation.wind.inflow
    wind = disc.begin(inflow, signals) if dt is None else disc.advance(inflow, signals, dt)
    return reference.at(signals["time"]), available_power(env.turbine, wind)


def run_controller(
    simulator: TurbineSimulator,
    controller: Controller,
    duration: float,
    control_dt: float | None = None,
    on_step: Callable[[Signals], None] | None = None,
    name: str = "controller",
    recorder: Recorder | None = None,
    start: Mapping[str, Any] | None = None,
) -> Recorder:
    """Simulate under a controller from the operating point of the inflow's mean speed.

    The simulator is reset, the controller started.

    Parameters
    ----------
    duration : float
        [s].
    control_dt : float, optional
        Interval of the controller, by default one aerodynamic time step [s].
    on_step : callable, optional
        Called with the signals after every interval.
    name : str
        Of the controller, an attribute of the record.
    recorder : Recorder, optional
        That gets the signals, by default a new one. A given one keeps what was simulated before a stop.
    start : mapping, optional
        Arguments of the reset; ``rotor_speed`` [rad/s] and ``pitch`` [rad] are by default the operating point's.

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
    start = dict(start or {})
    if not {"rotor_speed", "pitch"} <= start.keys():
        point = starting_point(simulator.turbine, simulator.inflow)
        start = {"rotor_speed": point.rotor_speed, "pitch": point.pitch} | start
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
        idle.advance(Transition(simulator.turbine, signals, signals, dt, inflow), controller, faults)

        recorder.attributes[IDLE_ATTRIBUTE] = idle.total
        if on_step is not None:
            on_step(signals)
    return recorder


def run_baseline(
    simulator: TurbineSimulator, duration: float, control_dt: float | None = None,
    parameters: BaselineParameters | None = None, **options: Any,
) -> Recorder:  # fmt: skip
    """Simulate under the baseline controller; other arguments and errors as of `run_controller`.

    Parameters
    ----------
    parameters : BaselineParameters, optional
        Constants of a controller with a torque curve; by default the turbine's own controller.
    """
    own = make_controller("discon", simulator.turbine) if parameters is None else DisconController(parameters)
    return run_controller(simulator, own, duration, control_dt, name="baseline", **options)


def benchmark_metrics(data: xr.Dataset, turbine: Turbine, skip: float) -> dict[str, float]:
    """Metrics of a run beside those of `wt_gym.analysis.metrics.run_metrics`.

    ``captured_power`` is the mean of the power, whose every 10 s count at most as rated, plus the gain of the
    rotor's kinetic energy over the measured time, at most the rated power [W]: emptying the rotor at the end earns
    nothing, nor does overloading the generator in the gusts of a wind that has lulls, nor what was stored beyond rated
    speed before the measured time begins. Ten seconds are longer than the swings of tower and blades, which a damper by
    torque passes on to the power, and shorter than gust and lull. The energy counts times the efficiency of the
    drivetrain, at the end up to that of rated speed. ``rotor_speed_ratio_max`` is the largest rotor speed of the whole
    run, its unmeasured start included, over the rated one [-].
    """
    metrics = run_metrics(data, turbine, skip)
    drivetrain = turbine.drivetrain
    time = data["time"].values
    measured = time >= time[0] + skip - 1e-9
    first, last = data["rotor_speed"].values[measured][[0, -1]]
    last = min(last, drivetrain.rated_rotor_speed)
    efficiency = drivetrain.gearbox_efficiency * drivetrain.generator_efficiency
    gained = 0.5 * efficiency * rotor_inertia(turbine) * (last**2 - first**2)
    delivered = delivered_power(data["generator_power"].values[measured], time[measured], drivetrain.rated_power)
    captured = delivered + gained / (time[measured][-1] - time[measured][0])
    metrics["captured_power"] = float(min(captured, drivetrain.rated_power))
    metrics["rotor_speed_ratio_max"] = float(data["rotor_speed_max"].max()) / drivetrain.rated_rotor_speed
    return metrics


def delivered_power(power: NDArray[np.float64], time: NDArray[np.float64], rated: float) -> float:
    """Mean of a power over evenly spaced times [s] whose every ten seconds count at most as rated [W].

    The rest after the last whole ten seconds is a spell of its own.
    """
    begins = np.arange(0, power.size, max(1, round(_SPELL / (time[1] - time[0]))))
    counts = np.diff(begins, append=power.size)
    return float(np.minimum(np.add.reduceat(power.astype(np.float64), begins), counts * rated).sum() / power.size)


def benchmark_fingerprint(turbine: Turbine, fidelity: str | Fidelity | None) -> dict[str, Any]:
    """Digests of turbine and fidelity, and the canary of the package for them.

    The fidelity is by default that of the blades (`wt_gym.simulation.fidelity.suited_fidelity`). Gives ``turbine``,
    ``fidelity``, and ``canary``: numbers of short episodes by channel (`wt_gym.envs.canary`), with the metrics of a
    short run. Where episodes start from a record of the user, ``start`` is its digest; the records of the package show
    in the canary. `wt_gym.base.canary.differing` compares two fingerprints.
    """
    chosen = fidelity_of(suited_fidelity(turbine) if fidelity is None else fidelity)
    record = user_record_digest(turbine)
    metrics = cached_canary("metrics", fingerprint(turbine, chosen), lambda: _canary(turbine, chosen))
    return {
        "turbine": fingerprint(turbine)[:16],
        "fidelity": fingerprint(chosen)[:16],
        CANARY: canary_of(turbine, chosen, WindTurbineEnv) | metrics,
    } | ({} if record is None else {"start": record})


def _canary(turbine: Turbine, fidelity: Fidelity) -> Canary:
    """Metrics of a short run from the operating point, as all runs have them."""
    env = WindTurbineEnv(
        turbine=turbine, fidelity=fidelity, wind_speed=turbine.rated_wind_speed, start="steady",
        action_mode="residual", control_dt=control_step(turbine, fidelity),
    )  # fmt: skip
    scale = time_scale(turbine)
    nobody = SimpleNamespace(predict=lambda *_, **__: (np.zeros(env.action_space.shape), None))
    try:
        run = play(env, nobody, seed=0, options={}, duration=scale * _SHORT)
        metrics = benchmark_metrics(run.after_start, turbine, scale * _SHORT_SKIP)
    except SimulationError as error:  # which is a behavior too
        return {"metrics/run": type(error).__name__}
    finally:
        env.close()
    return {f"metrics/{name}": canary_text([value]) for name, value in metrics.items()}
