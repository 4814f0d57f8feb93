"""A linear model of a turbine under its base controller as an environment: hundreds of times as fast as the simulator.

Offsets of the pitch change little about the wind that a turbine meets, so the course of everything under offsets u is
about that without any, recorded in turbulence, plus a linear response,

    y(t) = y_0(t) + sum_(l>=0) G_l u(t-l),

with finite impulse responses G from runs with drawn offsets, by wind speed (`wt_gym.learning.recording.identify`).
Spaces, action and reward are those of the environment whose arguments it is made of: observations are its own,
recorded, with the effects on response, motion and offsets; the reward is that of its fatigue terms and of its pitch
travel, beside zero actions, with credit (`wt_gym.envs.credit`) where it has that. Power has a linear response too, paid
up to the rated one, less the square of the offsets times a coefficient from the runs
(`wt_gym.learning.linear_design.curvature_of_power`). Left out are the energy of the rotor, the ends of episodes, speeds
beyond rated, and all that offsets do to the azimuth and to their own share.

The model is made at the first use, of two hours and forty minutes of simulated time, and kept in the cache of the user.
"""

import json
import pickle
import sys
import threading
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from typing import Any, cast

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from wt_gym.analysis.metrics import BLADE_EXPONENT, damage_equivalent_load
from wt_gym.base.errors import SimulationError
from wt_gym.base.user_cache import cached_file
from wt_gym.control.controllers.linear_optimal import OFFSET_ACTIONS, LoadObserver, linear_part, side_sign
from wt_gym.control.sensors import to_fixed_frame
from wt_gym.envs.credit import FATIGUE, HORIZON, as_in_terms, fatigue_weights, steps_of_observer
from wt_gym.envs.episode import Agent
from wt_gym.envs.fatigue import LOADS
from wt_gym.envs.options import PlainSpec, registered_arguments
from wt_gym.envs.power import Power
from wt_gym.envs.rewards import ActuatorUse, Overspeed
from wt_gym.envs.terminations import registered_limit
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.envs.vector_env import Outcome, WindTurbineVectorEnv
from wt_gym.envs.wind_sampler import TRAINING_WIND_SEEDS
from wt_gym.experiment.run import ENDLESS, benchmark_fingerprint
from wt_gym.learning.linear_design import Forecast, curvature_of_power
from wt_gym.learning.linear_env_kernels import advance_all, observe_all
from wt_gym.learning.options import Excitation
from wt_gym.learning.recording import RecordingStore, identify_and_judge, to_blades

RAW = (*LOADS, "edge_mean", "edge_tilt", "edge_yaw", "power")
"""What is recorded for the lifetime cost [N m, W]."""
_POWER = RAW.index("power")
_WASHED = [row for kind in FATIGUE for row in kind.rows[1]]
SETTLED = 10.0
"""First part of a run, in which no episode starts [s]."""
STILL = {"relative_reward": False, "reward_credit": False, "starts": None, "start": "steady", "episode_length": None}
"""Arguments of a run that is recorded: without starts amid operation, and with the reward of single steps."""
_TERMS = (*FATIGUE, Power, ActuatorUse, Overspeed)
_OWN = ("response_", "tower_velocity_", "tower_displacement_")
"""Beginnings of the names of channels that offsets move."""


@dataclass(frozen=True, eq=False)
class ModelOptions:
    """What a model is recorded from."""

    runs: int = 30  #: without offsets, evenly over the wind speeds
    duration: float = 200.0  #: of these [s]
    speeds: int = 4  #: wind speeds of the responses
    excited: int = 3  #: pairs of runs with and without drawn offsets at each
    excited_duration: float = 150.0  #: of these [s]


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Recorded runs without offsets, and responses to offsets."""

    speeds: NDArray[np.float64]  #: mean wind of each run [m/s], shape (n_runs,)
    observations: NDArray[np.float32]  #: at the decisions, shape (n_runs, n, n_obs)
    raw: NDArray[np.float64]  #: `RAW`, shape (n_runs, n, 9)
    azimuth: NDArray[np.float64]  #: in the sense of rotation [rad], shape (n_runs, n)
    pitch: NDArray[np.float64]  #: of the blades [rad], shape (n_runs, n, n_blades)
    share: NDArray[np.float64]  #: in which offsets act, shape (n_runs, n)
    knots: NDArray[np.float64]  #: wind speeds of the responses [m/s], shape (n_knots,)
    responses: NDArray[np.float64]  #: of `RAW` and observations [1/rad], shape (n_knots, 9 + n_own, 3, n_lags)
    curvature: NDArray[np.float64]  #: share of power that offsets take by their mean square [1/rad^2], (n_knots,)


def own_channels(env: WindTurbineEnv) -> list[int]:
    """Places of the observed channels that offsets move."""
    return [k for k, name in enumerate(env.layout.observation.names) if name.startswith(_OWN)]


def check_environment(env: WindTurbineEnv) -> None:
    """Refuse an environment of which there is no linear model."""
    chosen, part = env.options.actions, linear_part(env.controller)
    if chosen.residual != "offset" or tuple(env.layout.action.names) != OFFSET_ACTIONS:
        raise ValueError(
            "a linear model needs action_mode='residual', pitch='fixed-frame', residual_form='offset' and "
            f"action_components=('pitch',), got the actions {list(env.layout.action.names)}"
        )
    if part is None:
        raise ValueError("a linear model needs a base controller with an observer: 'discon+side_side_damper+observer'")
    allowed = ("disturbance_", "linear_pitch_", "pitch_offset_", *_OWN)
    if foreign := [name for name in env.layout.observation.names if not name.startswith(allowed)]:
        raise ValueError(
            "a linear model needs observation=['disturbances', 'own_response', 'offsets'] or some of them, got "
            f"{', '.join(foreign[:5])}"
        )
    options = env.options
    if options.variation.varies or options.faults.kinds or env.sensors == "all" or options.dial.weights is not None:
        raise ValueError("a linear model needs one plant and exact sensors: leave out variation, faults, sensors, dial")
    seen = options.observations
    if seen.history != 1 or seen.delay or seen.noise or options.controller.residual_washout:
        raise ValueError("a linear model needs history=1, sensor_delay=0, sensor_noise=0 and no residual_washout")
    if options.rewards.vector or options.grid.reference is not None:
        raise ValueError("a linear model has one number as reward and no power reference")
    if foreign := [term.name for term in env.reward_terms if term.weight and not isinstance(term, _TERMS)]:
        raise ValueError(
            "a linear model has rewards of power, fatigue, actuator use and overspeed alone, got those of "
            f"{', '.join(foreign)}"
        )
    steps_of_observer(part.design, env.control_dt)
    if env.wind.speeds is None:
        raise ValueError("a linear model needs winds with a mean speed: wind_speed=(low, high)")


@dataclass(frozen=True)
class _Run:
    """One run: samples at the decisions, offsets between them."""

    observations: NDArray[np.float32]
    raw: NDArray[np.float64]
    azimuth: NDArray[np.float64]
    pitch: NDArray[np.float64]
    share: NDArray[np.float64]
    acted: NDArray[np.float64]  #: (n - 1, 3)


def _sample(env: WindTurbineEnv) -> tuple[Any, ...]:
    signals, sign = env.signals, side_sign(env.turbine)
    azimuth, residual = signals["azimuth"], env.operation.residual
    raw = np.concatenate([
        to_fixed_frame(signals["root_flap_moment"], azimuth),
        [signals["tower_base_fore_aft_moment"], sign * signals["tower_base_side_side_moment"]],
        to_fixed_frame(signals["root_edge_moment"], azimuth), [signals["generator_power"]],
    ])  # fmt: skip
    share = 1.0 if residual is None else residual.share
    return raw, azimuth, signals["pitch"].copy(), share


def record_run(
    env: WindTurbineEnv, speed: float, seed: int, duration: float, actions: NDArray[np.float64] | None = None
) -> _Run:
    """Run for a duration [s] from the beginning of a wind, with actions (n, 3) or without."""
    env.outer_steps = ENDLESS
    observation, _ = env.reset(
        seed=seed, options={"azimuth": 0.0, "wind_speed": speed, "wind_seed": seed, "time_offset": 0.0}
    )
    seen, samples, acted = [observation], [_sample(env)], []
    times = steps_of_observer(cast(LoadObserver, linear_part(env.controller)).design, env.control_dt)
    nothing = np.zeros(3)
    for k in range(round(duration / env.control_dt)):
        observation, _, ended, _, info = env.advance(nothing if actions is None else actions[k])
        if ended:
            raise SimulationError(
                f"the run at {speed:g} m/s, seed {seed}, ended after {info['time']:g} s ({info['termination']}): a "
                "linear model needs whole runs"
            )
        seen.append(observation)
        samples.append(_sample(env))
        acted.append(cast(LoadObserver, linear_part(env.controller)).acted()[:, :times].mean(1))
    raw, azimuth, pitch, share = (np.array(part) for part in zip(*samples, strict=True))
    return _Run(np.array(seen), raw, azimuth, pitch, share, np.array(acted))


def record_runs(
    env_id: str, arguments: Mapping[str, Any], jobs: Sequence[tuple[float, int, float, NDArray[np.float64] | None]]
) -> list[_Run]:
    """Runs of jobs (speed, seed, duration, actions), in several threads."""
    local = threading.local()
    given = _modeled(env_id, arguments, **STILL)

    def play(job: tuple[float, int, float, NDArray[np.float64] | None]) -> _Run:
        if not hasattr(local, "env"):
            local.env = WindTurbineEnv(**given)
        return record_run(local.env, *job)

    play((*jobs[0][:2], 2.0 * WindTurbineEnv(**given).control_dt, None))  # kernels are compiled by one thread
    with ThreadPoolExecutor() as pool:
        return list(pool.map(play, jobs))


def make_model(env: WindTurbineEnv, env_id: str, arguments: Mapping[str, Any], options: ModelOptions) -> LinearModel:
    """Record and identify a model of an environment of these arguments, see `LinearModel`."""
    low, high = env.wind.speeds
    spans, dt = env.operation.action.pitch_high, env.control_dt
    part = cast(LoadObserver, linear_part(env.controller))
    knots = np.linspace(low, high, options.speeds) if high > low else np.array([low])
    pairs = [(float(v), seed) for v in knots for seed in TRAINING_WIND_SEEDS[: options.excited]]
    size = part.design.limit / 4.0
    excitation = Excitation(mean=0.4 * size, tilt_yaw=size)
    steps = round(options.excited_duration / dt)
    jobs: list[Any] = [(v, seed, options.excited_duration, None) for v, seed in pairs]
    for k, (v, seed) in enumerate(pairs):
        levels = excitation.draw(steps, dt, 100 + k) / spans[:, None]
        jobs.append((v, seed, options.excited_duration, levels.clip(-1.0, 1.0).T))
    speeds = np.round(low + (high - low) * (np.arange(options.runs) + 0.5) / options.runs, 2)
    seeds = TRAINING_WIND_SEEDS
    jobs += [(v, seeds[k % len(seeds)], options.duration, None) for k, v in enumerate(speeds.tolist())]
    runs = record_runs(env_id, arguments, jobs)
    still, moved, free = runs[: len(pairs)], runs[len(pairs) : 2 * len(pairs)], runs[2 * len(pairs) :]
    own, lags = own_channels(env), round(HORIZON / dt)
    responses, curvature = [], []
    for k in range(len(knots)):
        at = slice(k * options.excited, (k + 1) * options.excited)
        if np.mean([run.share.mean() for run in moved[at]]) < 0.01:
            raise ValueError(f"offsets must act, and at {knots[k]:g} m/s they have faded out: give winds above")
        inputs = [run.acted.T for run in moved[at]]
        changes = [
            np.concatenate([a.raw - b.raw, a.observations[:, own] - b.observations[:, own]], axis=1).T
            for a, b in zip(moved[at], still[at], strict=True)
        ]
        found, shares = identify_and_judge(inputs, changes, lags, 1e-3, 4.0)
        mean = float(np.mean([run.raw[:, _POWER].mean() for run in still[at]]))
        curvature.append(curvature_of_power(found, _POWER, shares[_POWER], inputs, changes, mean))
        responses.append(found)
    return LinearModel(
        speeds=speeds, knots=knots, responses=np.stack(responses), curvature=np.array(curvature), **_stacked(free),
    )  # fmt: skip


def in_winds(
    model: LinearModel, env_id: str, arguments: Mapping[str, Any], winds: Sequence[tuple[float, int]], duration: float
) -> LinearModel:
    """Model with runs of a duration [s] in other winds, of mean speed [m/s] and seed, in the place of its own."""
    runs = record_runs(env_id, arguments, [(speed, seed, duration, None) for speed, seed in winds])
    return replace(model, speeds=np.array([speed for speed, _ in winds]), **_stacked(runs))


def _stacked(runs: Sequence[_Run]) -> dict[str, Any]:
    names = "observations", "raw", "azimuth", "pitch", "share"
    return {name: np.stack([getattr(run, name) for run in runs]) for name in names}


def cached_model(env_id: str, arguments: Mapping[str, Any], options: ModelOptions = ModelOptions()) -> LinearModel:
    """Model from the cache of the user, or a new one."""
    described = {name: value for name, value in _modeled(env_id, arguments).items() if name not in _NO_MATTER}
    env = make_modeled(env_id, arguments)
    part = cast(LoadObserver, linear_part(env.controller))
    definition = {
        "fingerprint": benchmark_fingerprint(env.turbine, env.fidelity),
        "env": env_id, "arguments": json.dumps(described, sort_keys=True, default=repr), "options": asdict(options),
        "observation": list(env.layout.observation.names), "design": sha256(pickle.dumps(part.design)).hexdigest(),
    }  # fmt: skip
    store = RecordingStore(cached_file("linear"), LinearModel)
    if (model := store.find(definition)) is None:
        print(f"recording a linear model of {env.turbine.name}: a minute or two, once on this machine", file=sys.stderr)
        model = make_model(env, env_id, arguments, options)
        store.keep(definition, model)
    return model


_NO_MATTER = ("reward", "relative_reward", "reward_credit", "start", "starts")


class LinearVectorEnv(WindTurbineVectorEnv):
    """Many linear models beside each other, stepped in one compiled loop; see the module.

    Parameters
    ----------
    num_envs, max_episode_steps, autoreset_mode
        As of `WindTurbineVectorEnv`. Without a limit episodes last until the recorded wind ends.
    model : LinearModel, optional
        By default that of the arguments, from the cache of the user.
    **kwargs
        Arguments of the environment that is modeled.
    """

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        model: LinearModel | None = None,
        **kwargs: Any,
    ):
        env_id = kwargs.pop("modeled")
        kwargs.pop("env_id", None)
        super().__init__(1, max_episode_steps, autoreset_mode, 1, **_modeled(env_id, kwargs))
        check_environment(self.envs[0])
        self.num_envs = num_envs
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._observations = np.zeros((num_envs, len(self.observation_names)), np.float32)
        self.model = cached_model(env_id, kwargs) if model is None else model
        self._prepare()

    def _prepare(self) -> None:
        """Responses of each run, and what the reward is made of."""
        env, model, dt, n = self.envs[0], self.model, self.envs[0].control_dt, self.num_envs
        terms, turbine = env.reward_terms, env.turbine
        responses = np.array([_between(model.knots, model.responses, v) for v in model.speeds])
        normalized = as_in_terms(responses[:, : len(LOADS)], turbine, terms, dt)
        recorded = model.raw[..., : len(LOADS)].transpose(0, 2, 1).copy()
        for row in _WASHED:  # filters begin with the mean of a run
            recorded[:, row] -= recorded[:, row].mean(-1, keepdims=True)
        recorded = as_in_terms(recorded, turbine, terms, dt)
        self._loads = np.ascontiguousarray(recorded.transpose(0, 2, 1))
        self._responses = np.ascontiguousarray(np.concatenate([normalized, responses], axis=1).transpose(0, 3, 1, 2))
        self._curvature = np.array([_between(model.knots, model.curvature, v) for v in model.speeds])
        lags, outputs = self._responses.shape[1:3]
        self._weights = fatigue_weights(terms)
        uses = 1 + turbine.drivetrain.takes_torque + (turbine.nacelle.max_yaw_rate > 0.0)
        use = sum(term.weight for term in terms if isinstance(term, ActuatorUse))
        self._use = use / uses / turbine.pitch.max_rate / dt
        power = sum(term.weight for term in terms if isinstance(term, Power))
        self._power = np.ascontiguousarray(model.raw[..., _POWER])
        rated_power = turbine.drivetrain.rated_power
        self._rated, self._taken = np.array([rated_power, power / rated_power]), power * self._curvature
        self._credited_steps = lags if env.options.rewards.credit else 0
        spans = env.operation.action.spans
        self._spans = env.operation.action.pitch_high.copy()
        self._reach = spans["pitch_rate"] * dt
        count = env.operation.count
        self._lead = 0.5 * (1.0 + 1.0 / count)  # mean over a ramp in so many steps of the simulator
        self._own = np.array(own_channels(env), dtype=np.int64)
        names = list(env.layout.observation.names)
        offsets = [names.index(f"pitch_offset_{k}") for k in (1, 2, 3) if f"pitch_offset_{k}" in names]
        self._offset_places = np.array(offsets, dtype=np.int64)
        space = env.observation_space
        self._low, self._high = np.asarray(space.low, float), np.asarray(space.high, float)
        self._recorded = model.observations
        longest = self._recorded.shape[1] - 1 - round(SETTLED / dt) - lags
        if self._most_steps is not None and self._most_steps > longest:
            raise ValueError(f"max_episode_steps must be at most {longest} with this model, got {self._most_steps}")
        self._run, self._time, self._end, self._first = (np.zeros(n, np.int64) for _ in range(4))
        self._offset, self._acted = np.zeros((n, 3)), np.zeros((n, 3))
        self._changes, self._effects = np.zeros((n, lags, outputs)), np.zeros((n, outputs))
        self._credited, self._rewards = np.zeros(n), np.zeros(n)
        self._now, self._scratch = np.zeros(3), np.zeros(len(LOADS))
        self._dt = dt
        self._generators = [np.random.default_rng() for _ in range(n)]
        self._seeds: list[int | None] = [None] * n
        self._over = np.ones(n, dtype=np.bool_)

    # ---- episodes ----

    def start_at(self, k: int, run: int, time: float = SETTLED) -> None:
        """Begin an episode of model k in a recorded run at a time [s]; it lasts until the run ends."""
        self._run[k], self._time[k] = run, round(time / self.envs[0].control_dt)
        self._end[k] = self._recorded.shape[1] - 1
        for array in (self._offset, self._acted, self._changes, self._effects, self._credited):
            array[k] = 0.0
        self._first[k], self._over[k], self._begun = 0, False, True

    def _draw(self, k: int) -> None:
        """Begin an episode in a drawn run at a drawn time."""
        rng, dt = self._generators[k], self.envs[0].control_dt
        self.start_at(k, int(rng.integers(len(self._recorded))))
        steps = self._most_steps or 0
        first, last = round(SETTLED / dt), self._end[k] - steps - self._changes.shape[1]
        if steps:
            self._time[k] = int(rng.integers(first, max(last, first) + 1))
            self._end[k] = min(self._time[k] + steps, self._end[k])

    def reset_each(
        self, seeds: Sequence[int | None], options: dict[str, Any] | None, chosen: Iterable[int]
    ) -> list[tuple[np.ndarray, dict[str, Any]]]:
        """Start episodes of the chosen models; give observation and info of each."""
        if options:
            raise ValueError(f"a linear model has no options of a reset, got {', '.join(options)}")
        chosen = list(chosen)
        for k in chosen:
            if seeds[k] is not None:
                self._generators[k] = np.random.default_rng(seeds[k])
                self._seeds[k] = seeds[k]
            self._draw(k)
        seen = self._observe()
        return [(seen[k], self._info(k)) for k in chosen]

    def _info(self, k: int) -> dict[str, Any]:
        return {"wind_speed": float(self.model.speeds[self._run[k]])}

    def _observe(self) -> np.ndarray:
        """Observations of all models."""
        out = np.empty(self._observations.shape, np.float32)
        observe_all(
            self._run, self._time, self._offset, self._spans, self._effects, self._recorded,
            len(LOADS) + len(RAW), self._own, self._offset_places, self._low, self._high, out,
        )  # fmt: skip
        return out

    def step_each(self, actions: np.ndarray) -> list[Outcome]:
        """Advance every model by a control step, with errors as of `step`."""
        given, values, over = self._checked(actions), np.zeros((self.num_envs, 3)), self._over.copy()
        for k in range(self.num_envs):
            values[k] = given.get(k, 0.0)
            if over[k]:
                self._draw(k)
        model = self.model
        advance_all(
            ~over, values, self._spans, self._reach, model.share, self._run, self._time, self._offset, self._acted,
            self._changes, self._first, self._loads, self._responses, model.azimuth, model.pitch, self._lead,
            self._weights, self._use, self._power, self._rated, self._taken, len(LOADS) + _POWER, self._credited_steps,
            self._credited, self._effects, self._rewards, self._now, self._scratch,
        )  # fmt: skip
        ended = (self._time >= self._end) & ~over
        rewards = self._dt * self._rewards
        self._over[:] = ended
        seen = self._observe()
        final = {}
        if ended.any() and self.autoreset_mode == AutoresetMode.SAME_STEP:
            for k in range(self.num_envs):
                if ended[k]:
                    final[k] = seen[k].copy(), self._info(k)
                    self._draw(k)
            seen = self._observe()
        return [
            Outcome(seen[k], float(rewards[k]), False, bool(ended[k]), self._info(k), final.get(k))
            for k in range(self.num_envs)
        ]

    # ---- forecast ----

    def gradient_rates(self) -> NDArray[np.float64]:
        """Gradient at zero actions of the fatigue rewards of the next steps by each action.

        Returns
        -------
        numpy.ndarray, shape (n_runs, n, n_lags, 3)
            Entry (r, t, l, j): of the reward l steps after that of action t of run r, by offset j over its span.
        """
        loads, weights, spans = self._loads, self._weights, self._spans
        turning = 0.5 * (loads[..., 1] ** 2 + loads[..., 2] ** 2)
        blade = (1.0 - weights[1]) * loads[..., 0] ** 2 + turning
        slopes = np.empty_like(loads)  # of the rate by each load
        slopes[..., :3] = -weights[0] * loads[..., :3] / (1.0 + blade[..., None]) ** 2
        slopes[..., 0] *= 2.0 * (1.0 - weights[1])
        slopes[..., 3:] = -2.0 * weights[2:] * loads[..., 3:] / (1.0 + loads[..., 3:] ** 2) ** 2
        lags = self._responses.shape[1]
        steps = loads.shape[1] - lags - 1
        out, share = np.zeros((len(loads), steps, lags, 3)), self.model.share[:, :steps, None]
        for lag in range(lags):
            ahead = slopes[:, lag + 1 : lag + 1 + steps]
            out[:, :, lag] = np.einsum("abc,acj->abj", ahead, self._responses[:, lag, : len(LOADS)]) * spans * share
        if self._credited_steps:  # all of it in the step of the action
            out[:, :, 0] = out.sum(2)
            out[:, :, 1:] = 0.0
        return self._dt * out

    @property
    def effects(self) -> NDArray[np.float64]:
        """Changes of `RAW` at the current decisions (n_envs, 9)."""
        return self._effects[:, len(LOADS) : len(LOADS) + len(RAW)].copy()

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Attribute of the environment that is modeled, for every model."""
        if name == "np_random_seed":
            return tuple(-1 if seed is None else seed for seed in self._seeds)
        if name == "np_random":
            return tuple(self._generators)
        return tuple(getattr(self.envs[0], name) for _ in range(self.num_envs))


def make_modeled(env_id: str, arguments: Mapping[str, Any]) -> WindTurbineEnv:
    """Make the environment that is to be modeled; a ValueError where there is no linear model of it."""
    if gym.spec(env_id).entry_point != f"{WindTurbineEnv.__module__}:{WindTurbineEnv.__name__}":
        raise ValueError(f"a linear model needs an environment of the simulator of wt_gym, got {env_id}")
    env = WindTurbineEnv(**_modeled(env_id, arguments, **STILL))
    check_environment(env)
    return env


def _modeled(env_id: str, kwargs: Mapping[str, Any], **changes: Any) -> dict[str, Any]:
    return registered_arguments(env_id, dict(kwargs)) | changes


def _between(knots: NDArray[np.float64], values: NDArray[np.float64], at: float) -> Any:
    """Values (n, ...) at knots, between them."""
    if len(knots) == 1:
        return values[0]
    place = float(np.interp(at, knots, np.arange(len(knots))))
    k = min(int(place), len(knots) - 2)
    return values[k] + (place - k) * (values[k + 1] - values[k])


class LinearTurbineEnv(PlainSpec, gym.Env[np.ndarray, np.ndarray]):
    """One linear model of a turbine, see `LinearVectorEnv` and the module."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as its base

    def __init__(self, **kwargs: Any):
        self._models = LinearVectorEnv(1, autoreset_mode=AutoresetMode.DISABLED, **kwargs)
        self.observation_space = self._models.single_observation_space
        self.action_space = self._models.single_action_space
        self.layout = self._models.layout
        self.render_mode = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode in a recorded wind, at a drawn time."""
        super().reset(seed=seed)
        self._models._generators[0], self._models._most_steps = self.np_random, registered_limit(self.spec)
        start = self._models.reset_each([None], options, [0])[0]
        self._models._end[0] = self._models._recorded.shape[1] - 1  # a limit is that of the wrapper, and for the draw
        return start

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance by one control step."""
        out = self._models.step_each(np.asarray(action)[None])[0]
        return out.observation, cast(float, out.reward), out.terminated, out.truncated, out.info


def forecast(models: LinearVectorEnv, agent: Agent, skip: float = 30.0) -> list[dict[str, float]]:
    """Changes of the metrics of the lifetime cost by an agent, beside zero actions, in each recorded run of a model.

    Parameters
    ----------
    models : LinearVectorEnv
        With one model for each run.
    skip : float
        First part of the runs that does not count [s].

    Returns
    -------
    list of dict
        By run: relative changes of ``captured_power``, ``blade_flap_del``, ``blade_edge_del``, ``tower_fore_aft_del``,
        ``tower_side_side_del``, and the change of ``pitch_duty_cycle`` itself.
    """
    model, env = models.model, models.envs[0]
    dt, runs = env.control_dt, len(model.speeds)
    if models.num_envs != runs:
        raise ValueError(f"a forecast needs a model for each of {runs} runs, got {models.num_envs}")
    for k in range(runs):
        models.start_at(k, k, 2.0 * dt)
    seen, changes, acted = models._observe(), [], []
    for _ in range(model.observations.shape[1] - 3):
        action, _ = agent.predict(seen, deterministic=True)
        outcomes = models.step_each(np.asarray(action))
        seen = np.stack([out.observation for out in outcomes])
        changes.append(models.effects)
        acted.append(models._acted.copy())
    change, offsets = np.stack(changes, axis=1), np.stack(acted, axis=1)
    return [_changed(model, env, k, change[k], offsets[k], models._curvature[k], skip) for k in range(runs)]


def _changed(
    model: LinearModel, env: WindTurbineEnv, k: int, change: NDArray[np.float64], offsets: NDArray[np.float64],
    curvature: float, skip: float,
) -> dict[str, float]:  # fmt: skip
    dt, start = env.control_dt, round(skip / env.control_dt)
    raw, azimuth, pitch = (getattr(model, name)[k, -len(change) :] for name in ("raw", "azimuth", "pitch"))

    def metrics(loads: NDArray[np.float64], u: NDArray[np.float64]) -> dict[str, float]:
        flap, edge, moved = (to_blades(part.T, azimuth, pitch.shape[1]) for part in (loads[:, :3], loads[:, 5:8], u))
        tower, power = np.ascontiguousarray(loads[:, 3:5].T), float(loads[start:, _POWER].mean())
        time = (len(loads) - start) * dt
        return Forecast(flap, pitch.T + moved, tower, power).metrics(dt, env.turbine.pitch.max_rate, skip) | {
            "blade_edge_del": max(damage_equivalent_load(blade[start:], time, BLADE_EXPONENT) for blade in edge)
        }

    now, before = metrics(raw + change, offsets), metrics(raw, np.zeros_like(offsets))
    found = {name: now[name] / value - 1.0 for name, value in before.items() if name != "pitch_duty_cycle"}
    found["captured_power"] -= curvature * float((offsets[start:] ** 2).sum(1).mean())
    return found | {"pitch_duty_cycle": now["pitch_duty_cycle"] - before["pitch_duty_cycle"]}
