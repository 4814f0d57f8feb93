"""One agent in one wind of a task."""

from __future__ import annotations

import platform
import time
import warnings
from functools import cache, partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

import wt_gym
from wt_gym.analysis.metrics import idle_time, run_metrics
from wt_gym.base.canary import CANARY, Canary, cached_canary, canary_text
from wt_gym.base.errors import BenchmarkError, SimulationError
from wt_gym.control.controllers import make_controller
from wt_gym.control.operating_point import rotor_inertia
from wt_gym.envs.canary import canary_of, control_step
from wt_gym.envs.record_store import user_record_digest
from wt_gym.envs.running_record import time_scale
from wt_gym.envs.turbine_env import WindTurbineEnv, turbine_env_of
from wt_gym.runs.definition import RunDefinition
from wt_gym.runs.playing import play as play_episode
from wt_gym.simulation.contract import fingerprint
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.simulation.fidelity import suited_fidelity
from wt_gym.turbines import load_turbine

if TYPE_CHECKING:
    from collections.abc import Callable

    import xarray as xr
    from numpy.typing import NDArray

    from wt_gym.benchmark.tasks import BenchmarkTask, BenchmarkWind
    from wt_gym.control.controllers.controller import Controller
    from wt_gym.envs.episode import EpisodeStep
    from wt_gym.simulation import Fidelity
    from wt_gym.turbines import Turbine

__all__ = [
    "INTERFACE",
    "benchmark_fingerprint",
    "benchmark_metrics",
    "delivered_power",
    "make_env",
    "play",
    "run_definition",
]

INTERFACE = (
    "action_mode", "pitch", "action_components", "action_spans", "residual_fade", "residual_washout", "residual_form",
    "controller", "observation", "history", "sensor_washout",
)  # fmt: skip
"""Arguments of the environment that an agent may choose: what it sees, what its actions mean, its base controller."""

_LATER = (("sensor_washout", None), ("residual_form", "rate"))
"""Arguments that came after results had been recorded, with the values that those were made with."""
_ENDLESS = 10**9  # control steps
_SHORT, _SHORT_SKIP = 4.0, 1.0
"""Length of the run whose metrics are compared, and of its start that they leave out, for a large turbine [s]."""
_SPELL = 10.0  # s, over which power beyond the rated one may make up for power below it


def run_definition(
    task: BenchmarkTask, wind: BenchmarkWind, agent: dict[str, Any], interface: dict[str, Any] | None = None
) -> dict[str, Any]:
    """What decides on the numbers of a run, as JSON values.

    Parameters
    ----------
    task : BenchmarkTask
    wind : BenchmarkWind
    agent : dict
        JSON values that tell the agent from every other one.
    interface : dict, optional
        See `make_env`.
    """
    return RunDefinition(
        wind=wind.definition,
        duration=task.duration,
        skip=task.skip,
        fingerprint=_fingerprint(_argument(task, "turbine"), _argument(task, "fidelity")),
        agent=agent,
        env_id=task.env_id,
        env_kwargs=task.env_kwargs,
        interface={name: value for name, value in (interface or {}).items() if (name, value) not in _LATER},
        more={"task": task.name, "version": task.version},
    ).to_json()


def make_env(task: BenchmarkTask, wind: BenchmarkWind, interface: dict[str, Any] | None = None) -> gym.Env:
    """Environment of a task for a wind.

    Parameters
    ----------
    task : BenchmarkTask
    wind : BenchmarkWind
    interface : dict, optional
        Arguments out of `INTERFACE`, as JSON values; ``controller`` with parameters as a list [name, parameters].

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If the interface holds something else.
    """
    interface = dict(interface or {})
    foreign = [name for name in interface if name not in INTERFACE]
    if foreign:
        raise BenchmarkError(
            f"what an agent chooses of the environment must be among {', '.join(INTERFACE)}, got {', '.join(foreign)}"
        )
    if isinstance(interface.get("controller"), list):
        name, parameters = interface["controller"]
        interface["controller"] = partial(_make_controller, name, parameters)
    given = {**task.env_kwargs, **interface} | {"relative_reward": False, "starts": None}  # compared with other runs
    if wind.transient is not None:
        given |= {"inflow": wind.inflow(_turbine(task)), "wind_speed": None}
    with warnings.catch_warnings():  # a frozen task keeps the version of its id
        warnings.filterwarnings("ignore", ".*is out of date", DeprecationWarning)
        env = gym.make(task.env_id, **given, episode_length=task.duration, max_episode_steps=_ENDLESS)
    turbine_env_of(env).outer_steps = _ENDLESS
    return env


def _make_controller(name: str, parameters: dict[str, Any], turbine: Turbine) -> Controller:
    return make_controller(name, turbine, **parameters)


def play(
    task: BenchmarkTask,
    wind: BenchmarkWind,
    make_agent: Callable[[gym.Env], Any],
    interface: dict[str, Any] | None = None,
    on_step: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Run an agent once.

    Parameters
    ----------
    task : BenchmarkTask
    wind : BenchmarkWind
    make_agent : callable
        Gets the environment and gives something with stable-baselines3's ``predict``.
    interface : dict, optional
        See `make_env`.
    on_step : callable, optional
        Called with the simulated time [s] after every step.

    Returns
    -------
    dict
        ``metrics`` (empty if the run ended before its time), ``ending`` (``"time"`` or why it was terminated),
        ``failure``, ``duration`` [s], ``episode_return``, ``cost`` (sum), ``idle_time`` [s]
        (`wt_gym.envs.terminations.IdleClock.total`), ``made_with`` and ``wall_seconds``.
    """
    began = time.monotonic()

    def told(step: EpisodeStep) -> None:
        if on_step is not None:
            on_step(step.info["time"])

    options: dict[str, Any] = {"azimuth": 0.0}
    if wind.transient is None:
        options |= {"wind_speed": wind.speed, "wind_seed": wind.seed, "time_offset": 0.0}
    env = make_env(task, wind, interface)
    try:
        found = play_episode(env, make_agent(env), seed=wind.seed or 0, options=options, on_step=told)
        turbine, complete = turbine_env_of(env).turbine, found.ending == "time"
        return {
            "metrics": benchmark_metrics(found.after_start, turbine, task.skip) if complete else {},
            "ending": found.ending,
            "failure": found.failure,
            "duration": found.time,
            "episode_return": found.episode_return,
            "cost": found.cost,
            "idle_time": idle_time(found.data),
            "made_with": _software_versions(),
            "wall_seconds": round(time.monotonic() - began, 1),
        }
    finally:
        env.close()


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
    """Mean of a power whose every ten seconds count at most as rated.

    Parameters
    ----------
    power : numpy.ndarray, shape (n,)
        [W].
    time : numpy.ndarray, shape (n,)
        Evenly spaced [s].
    rated : float
        [W].

    Returns
    -------
    float
        [W]; what is left after the last whole ten seconds is a spell of its own.
    """
    begins = np.arange(0, power.size, max(1, round(_SPELL / (time[1] - time[0]))))
    counts = np.diff(begins, append=power.size)
    return float(np.minimum(np.add.reduceat(power.astype(np.float64), begins), counts * rated).sum() / power.size)


def _argument(task: BenchmarkTask, name: str) -> Any:
    """Argument that the environment of a task is made with."""
    return {**gym.spec(task.env_id).kwargs, **task.env_kwargs}[name]


def _turbine(task: BenchmarkTask) -> Turbine:
    return _load_turbine(_argument(task, "turbine"))


_load_turbine = cache(load_turbine)


def benchmark_fingerprint(turbine: Turbine, fidelity: str | Fidelity | None) -> dict[str, Any]:
    """Digests of turbine and fidelity, and the canary of the package for them.

    Parameters
    ----------
    turbine : Turbine
    fidelity : str or Fidelity or None
        None: that of the blades (`wt_gym.simulation.fidelity.choose_fidelity`).

    Returns
    -------
    dict
        ``turbine``, ``fidelity``, and ``canary``: numbers of short episodes by channel (`wt_gym.envs.canary`), with the
        metrics of a short run. Where episodes start from a record of the user, ``start`` is its digest; the records of
        the package show in the canary. `wt_gym.base.canary.differing` compares two fingerprints.
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
    """Metrics of a short run from the operating point, as a run of the benchmark has them."""
    env = WindTurbineEnv(
        turbine=turbine, fidelity=fidelity, wind_speed=turbine.rated_wind_speed, start="steady",
        action_mode="residual", control_dt=control_step(turbine, fidelity),
    )  # fmt: skip
    scale = time_scale(turbine)
    nobody = SimpleNamespace(predict=lambda *_, **__: (np.zeros(env.action_space.shape), None))
    try:
        run = play_episode(env, nobody, seed=0, options={}, duration=scale * _SHORT)
        metrics = benchmark_metrics(run.after_start, turbine, scale * _SHORT_SKIP)
    except SimulationError as error:  # which is a behavior too
        return {"metrics/run": type(error).__name__}
    finally:
        env.close()
    return {f"metrics/{name}": canary_text([value]) for name, value in metrics.items()}


@cache
def _fingerprint(turbine: str, fidelity: str) -> dict[str, Any]:
    return benchmark_fingerprint(_load_turbine(turbine), fidelity)


def _software_versions() -> dict[str, str]:
    """Versions, for the record: they decide on no score."""
    return {
        "wt_gym": wt_gym.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "gymnasium": gym.__version__,
        "machine": platform.machine(),
    }
