"""Do the rewards pay for what users want? Many controllers in the same winds: reward terms against loads and energy.

Each controller runs on the simulator, without an environment between them, in every wind. The rate of every reward
term at weight 1, averaged over the run, stands beside the damage-equivalent loads, the power and the actuator use of
the same run. All comparisons are differences to the baseline controller in the same wind, so that the wind's share
drops out.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np
import xarray as xr
from scipy.stats import spearmanr

from wt_gym.analysis.lifetime_cost import LIFETIME_COST_WEIGHTS
from wt_gym.analysis.metrics import run_metrics
from wt_gym.control import Demand
from wt_gym.control.closed_loop import advance_controlled
from wt_gym.control.coleman import from_harmonic, to_harmonic
from wt_gym.control.controllers import BaselineController, BaselineParameters, make_controller, readings_of
from wt_gym.control.controllers.discon import BaselineState
from wt_gym.control.operating_point import operating_point
from wt_gym.envs import rewards
from wt_gym.envs.wind_sampler import WindSampler
from wt_gym.simulation import Signals
from wt_gym.simulation.channels import channel_table
from wt_gym.tasks import TASKS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from wt_gym.control.controllers import Controller
    from wt_gym.simulation import Simulator
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = [
    "BASELINE",
    "COST_WEIGHTS",
    "LIBRARY",
    "LOADS",
    "RELATIVE",
    "StudyController",
    "controllers",
    "correlation",
    "cost",
    "differences",
    "evaluate",
    "lifetime",
    "simulate",
    "study_terms",
    "task_weights",
    "total_rate",
    "wind",
]

BASELINE = "baseline"

CONTROL_DT = 0.2
"""Control step of the environment, over which a reward is paid [s]."""

LOADS = {
    "flap": "blade_flap_del",
    "edge": "blade_edge_del",
    "fore_aft": "tower_fore_aft_del",
    "side_side": "tower_side_side_del",
}
"""Short names of the damage-equivalent loads and their keys in `wt_gym.analysis.metrics.METRICS`."""

_EXPONENTS = {"flap": 10.0, "edge": 10.0, "fore_aft": 4.0, "side_side": 4.0}

RELATIVE = (*LOADS, "mean_power")
"""Columns of which the difference to the baseline is taken relative to it."""

_COST_METRICS = {
    "mean_power": "captured_power",
    **LOADS,
    "pitch_duty": "pitch_duty_cycle",
    "torque_duty": "torque_rate",
}
COST_WEIGHTS = {name: LIFETIME_COST_WEIGHTS[metric] for name, metric in _COST_METRICS.items()}
"""Weights of the lifetime cost by the names of this study; duty cycles count as they are, over their full use."""


@dataclass(frozen=True)
class StudyController:
    """The baseline controller with changes.

    Attributes
    ----------
    pi_gain, integral_gain, torque_gain, filter_speed : float
        Factors on the gains of the pitch loop, on its integral gain alone, on the region-2 torque gain and on the
        corner frequency of the speed filter [-].
    fine_pitch : float
        Least collective pitch [rad].
    derating : float
        Rated power over that of the turbine [-].
    constant_torque : bool
        Above rated the torque stays at its rated value instead of the power.
    individual : float
        Integral gain of individual pitch control in the fixed frame [rad/(N m s)].
    faded : bool
        Individual pitch fades out towards fine pitch.
    fore_aft : float
        Gain of the fore-aft tower damper, collective pitch against the tower-top velocity [rad/(m/s)].
    side_side : float
        Gain of the side-side tower damper, torque against the tower-top velocity across the rotor [N m/(m/s)].
    dither : float
        Amplitude of a collective pitch oscillation with the tower's frequency [rad].
    torque_dither : float
        Amplitude of a torque oscillation with the tower's frequency [N m].
    yaw : float
        Misalignment of the nacelle [rad].
    """

    pi_gain: float = 1.0
    integral_gain: float = 1.0
    torque_gain: float = 1.0
    filter_speed: float = 1.0
    fine_pitch: float = 0.0
    derating: float = 1.0
    constant_torque: bool = False
    individual: float = 0.0
    faded: bool = True
    fore_aft: float = 0.0
    side_side: float = 0.0
    dither: float = 0.0
    torque_dither: float = 0.0
    yaw: float = 0.0

    def parameters(self, turbine: Turbine) -> BaselineParameters:
        """Constants of the baseline controller underneath."""
        base = BaselineParameters.from_turbine(turbine)
        # A larger gain leaves room for region 2 1/2, as `TorqueCurve.from_turbine` does.
        curve = base.torque
        power = self.derating * curve.rated_power
        gain = min(self.torque_gain * curve.region_2_gain, 0.95 * power / curve.rated_generator_speed**3)
        fine_pitch = max(base.min_pitch, self.fine_pitch)
        return replace(
            base,
            corner_frequency=self.filter_speed * base.corner_frequency,
            proportional_gain=self.pi_gain * base.proportional_gain,
            integral_gain=self.pi_gain * self.integral_gain * base.integral_gain,
            min_pitch=fine_pitch,
            region_3_min_pitch=fine_pitch + base.region_3_min_pitch - base.min_pitch,
            torque=replace(curve, region_2_gain=gain, rated_power=power),
        )


def controllers() -> dict[str, StudyController]:
    """The baseline and 22 variations: better and worse ones, each a thing that an agent could learn to do."""
    degree = math.pi / 180
    return {
        BASELINE: StudyController(),
        "pitch gains x 0.5": StudyController(pi_gain=0.5),
        "pitch gains x 2": StudyController(pi_gain=2.0),
        "integral gain x 0.3": StudyController(integral_gain=0.3),
        "speed filter x 0.4": StudyController(filter_speed=0.4),
        "torque gain x 0.5": StudyController(torque_gain=0.5),
        "torque gain x 0.75": StudyController(torque_gain=0.75),
        "torque gain x 1.3": StudyController(torque_gain=1.3),
        "fine pitch 2 deg": StudyController(fine_pitch=2 * degree),
        "derated to 85 %": StudyController(derating=0.85),
        "constant torque": StudyController(constant_torque=True),
        "individual pitch, weak": StudyController(individual=1e-9),
        "individual pitch": StudyController(individual=3e-9),
        "individual pitch, strong": StudyController(individual=8e-9),
        "individual pitch, not faded": StudyController(individual=3e-9, faded=False),
        "fore-aft damper": StudyController(fore_aft=1.0 * degree),
        "fore-aft damper, strong": StudyController(fore_aft=3.0 * degree),
        "side-side damper": StudyController(side_side=20e3),
        "both dampers, individual pitch": StudyController(individual=3e-9, fore_aft=1.5 * degree, side_side=20e3),
        "pitch dither 0.5 deg": StudyController(dither=0.5 * degree),
        "torque dither 1 kN m": StudyController(torque_dither=1e3),
        "yawed by 10 deg": StudyController(yaw=10 * degree),
        "yawed by -20 deg": StudyController(yaw=-20 * degree),
    }


LIBRARY = (
    "retuned", "tsr_tracking", "ipc", "ipc_2p", "constrained_ipc", "fore_aft_damper", "side_side_damper",
    "tsr_tracking+ipc+tower_dampers",
)  # fmt: skip
"""Controllers of the library on which the weights of the reward were not chosen."""


class _Loop:
    """A study controller at work, one call a step of the simulator (`wt_gym.control.controllers.Controller`)."""

    # Largest individual pitch [rad]; lead of the azimuth [s]: 0.15 s of the drive (`pitch_delay`), else blade and air.
    _MOST_INDIVIDUAL, _LEAD = math.radians(6.0), 0.25
    # Frequency that the dithers excite the tower with [rad/s], and corner of the dampers' high-pass filters.
    _TOWER, _CORNER = 2 * math.pi * 0.32, 0.2

    def __init__(self, description: StudyController, turbine: Turbine, signals: Signals):
        self.description, self.turbine = description, turbine
        self.baseline = BaselineController(description.parameters(turbine))
        pitch = np.maximum(signals.pitch, self.baseline.parameters.min_pitch)
        self.baseline.start(signals.generator_speed, pitch, signals.generator_torque)
        self.tilt_yaw = np.zeros(2)
        self.velocity = np.zeros(2)  # of the tower top along and across the nacelle, high-passed [m/s]

    def step(self, signals: Signals, dt: float) -> Demand:
        """Demand for the next step."""
        d, limits, time = self.description, self.turbine.drivetrain, signals.time
        pitch, torque = self.baseline.step(signals.generator_speed, dt)
        if d.constant_torque:
            torque = min(torque, self.baseline.parameters.torque.rated_power / self.baseline.parameters.reference_speed)
        acceleration = np.array([signals.nacelle_acceleration_fore_aft, signals.nacelle_acceleration_side_side])
        self.velocity += dt * (acceleration - self._CORNER * self.velocity)
        pitch = pitch + d.fore_aft * self.velocity[0] + d.dither * math.sin(self._TOWER * time)
        torque += d.side_side * self.velocity[1] + d.torque_dither * math.sin(self._TOWER * time)
        if d.individual != 0.0:
            pitch = pitch + self._individual(signals, dt)
        low, high = self.turbine.pitch.min_pitch, self.turbine.pitch.max_pitch
        torque = min(max(torque, 0.0), limits.max_generator_torque)
        return Demand(np.clip(pitch, max(low, 0.0), high), 0.0, torque)

    def _individual(self, signals: Signals, dt: float) -> np.ndarray:
        """Individual pitch [rad], shape (n_blades,): integrals of the tilt and yaw moments, turned back to the blades.

        Faded out, if so wanted, below rated, where the blades stand at fine pitch.
        """
        moments = np.array(to_harmonic(signals.root_flap_moment, signals.azimuth))
        room = min(max(float(cast(BaselineState, self.baseline.state).pitch[0]) / math.radians(5.0), 0.0), 1.0)
        room = room if self.description.faded else 1.0
        self.tilt_yaw = np.clip(
            self.tilt_yaw + self.description.individual * moments * dt, -self._MOST_INDIVIDUAL, self._MOST_INDIVIDUAL
        )
        led = signals.azimuth + signals.rotor_speed * self._LEAD
        tilt, yaw = self.tilt_yaw
        return room * from_harmonic(tilt, yaw, led, self.turbine.n_blades)


class _FormerPower:
    """Power of the reward of the first version: over rated power, whatever the wind; kept for the comparison."""

    name, weight = "former_power", 1.0

    def __call__(self, transition: rewards.Transition) -> float:
        ratio = transition.after["generator_power"] / transition.turbine.drivetrain.rated_power
        return max(-1.0, ratio if ratio <= 1.0 else 1.0 - 2.0 * (ratio - 1.0))


FORMER_WEIGHTS = {
    "former_power": 1.0, "tip_deflection": 0.1, "tower_load": 0.2, "actuator_use": 0.1, "overspeed": 0.6,
}  # fmt: skip
"""The reward of the first version."""


def study_terms() -> tuple[rewards.RewardTerm, ...]:
    """Every term of the library at weight 1, and variations that did not become the default."""
    named = rewards.compose(dict.fromkeys(rewards.DEFAULT_WEIGHTS, 1.0))
    single = rewards.BladeFatigue(weight=1.0, fixed_frame=0.0, name="blade_fatigue_single")
    fixed = rewards.BladeFatigue(weight=1.0, fixed_frame=1.0, name="blade_fatigue_fixed_frame")
    return (*named, single, fixed, _FormerPower())


def wind(turbine: Turbine, wind_speed: float, seed: int) -> Inflow:
    """Turbulent wind as the environment draws it, from the beginning of its box [m/s]."""
    sampler = WindSampler(turbine, "turbulent", wind_speed, wind_seeds=(seed,))
    return sampler.sample(np.random.default_rng(0), wind_seed=seed).inflow


def simulate(
    controller: StudyController | str,
    simulator: Simulator,
    duration: float = 160.0,
    control_dt: float = CONTROL_DT,
) -> np.ndarray:
    """One controller in the wind of a simulator.

    Parameters
    ----------
    controller : StudyController or str
        Called at every step of the simulator; a name is one of `wt_gym.control.controllers.make_controller`.
    simulator : Simulator
        Is reset.
    duration : float
        Length of the run [s].
    control_dt : float
        Interval of the samples, a multiple of the simulator's step [s].

    Returns
    -------
    numpy.ndarray, shape (n + 1, n_channels)
        Signals, those of the start first.
    """
    turbine = simulator.turbine
    start = operating_point(turbine, simulator.inflow.mean_speed)
    pitch, yaw = start.pitch, 0.0
    if isinstance(controller, StudyController):
        pitch, yaw = max(pitch, controller.fine_pitch), controller.yaw
    signals = simulator.reset(start.rotor_speed, pitch, yaw=yaw, generator_torque=start.generator_torque)
    loop: _Loop | Controller
    if isinstance(controller, StudyController):
        loop = _Loop(controller, turbine, signals)
    else:
        loop = make_controller(controller, turbine)
        loop.start(
            readings_of(loop, signals, simulator.inflow, turbine.hub_height),
            Demand(signals.pitch.copy(), 0.0, signals.generator_torque),
        )
    rows = [signals.values]
    count = round(control_dt / simulator.time_step)

    def demand_at(_: int, now: Signals) -> Demand:
        read = readings_of(cast("Controller", loop), now, simulator.inflow, turbine.hub_height)
        return loop.step(cast(Signals, read), simulator.time_step)

    for _ in range(round(duration / control_dt)):
        signals = advance_controlled(demand_at, simulator, signals, simulator.time_step, count)
        rows.append(signals.values)
    return np.array(rows)


def evaluate(turbine: Turbine, inflow: Inflow, samples: np.ndarray, skip: float = 20.0) -> dict[str, float]:
    """Reward terms, loads, power and actuator use of a run.

    Parameters
    ----------
    turbine : Turbine
    inflow : Inflow
        The wind of the run.
    samples : numpy.ndarray, shape (n + 1, n_channels)
        As `simulate` gives them.
    skip : float
        Start that is left out [s]; the filters of the terms run through it.

    Returns
    -------
    dict
        Mean rate of each of `study_terms` [1/s]; damage-equivalent loads (`LOADS`) [N m]; ``mean_power`` [W];
        ``pitch_duty`` and ``torque_duty``, mean rates over the greatest ones [-].
    """
    names = [channel.name for channel in channel_table(turbine.n_blades)]
    time = samples[:, names.index("time")]
    dt = float(time[1] - time[0])
    terms, signals = study_terms(), [Signals(values, turbine.n_blades) for values in samples]
    rewards.reset(terms, turbine, signals[0])
    sums = dict.fromkeys((term.name for term in terms), 0.0)
    for before, after in itertools.pairwise(signals):
        _, values = rewards.total(terms, rewards.Transition(turbine, before, after, dt, inflow))
        if after.time > time[0] + skip + 1e-9:
            sums = {term: sums[term] + value for term, value in values.items()}
    kept = samples[time > time[0] + skip + 1e-9]
    data = xr.Dataset({name: ("time", kept[:, k]) for k, name in enumerate(names) if name != "time"})
    measured = run_metrics(data.assign_coords(time=kept[:, names.index("time")]), turbine)
    torque_rate = np.abs(np.diff(data["generator_torque"].values)).mean() / dt
    row = {term: value / (len(kept) * dt) for term, value in sums.items()}
    row |= {load: measured[key] for load, key in LOADS.items()}
    row |= {"mean_power": measured["mean_power"], "pitch_duty": measured["pitch_duty_cycle"]}
    return row | {"torque_duty": float(torque_rate / turbine.drivetrain.max_torque_rate)}


def differences(rows: Iterable[Mapping]) -> list[dict]:
    """Differences of every run to the baseline in the same wind.

    Parameters
    ----------
    rows : iterable of mapping
        Columns as `evaluate` gives them, with ``controller``, ``wind_speed`` and ``seed``; the baseline among them.

    Returns
    -------
    list of dict
        The rows of the other controllers: the columns `RELATIVE` as relative differences, all others, rates and duty
        cycles, as they are subtracted. ``cost`` is the `cost` of the row.

    Raises
    ------
    ValueError
        If the baseline is missing in a wind.
    """
    rows = list(rows)
    baselines = {(row["wind_speed"], row["seed"]): row for row in rows if row["controller"] == BASELINE}
    result = []
    for row in rows:
        wind = row["wind_speed"], row["seed"]
        if wind not in baselines:
            raise ValueError(f"there is no run of the baseline at {wind[0]:g} m/s with seed {wind[1]}")
        if row["controller"] != BASELINE:
            result.append(_difference(row, baselines[wind]))
    return result


def _difference(row: Mapping, base: Mapping) -> dict:
    """Row less baseline, with its cost."""
    labels = ("controller", "wind_speed", "seed")
    change = {key: row[key] for key in labels if key in row}
    change |= {key: row[key] - base[key] for key in row if key not in labels}
    change |= {key: change[key] / base[key] for key in RELATIVE}
    return change | {"cost": cost(change)}


def cost(change: Mapping[str, float], weights: Mapping[str, float] | None = None) -> float:
    """Relative change of the cost of energy by differences to the baseline, by default with `COST_WEIGHTS` [-]."""
    return sum(weight * change[key] for key, weight in (COST_WEIGHTS if weights is None else weights).items())


def total_rate(row: Mapping[str, float], weights: Mapping[str, float] | None = None) -> float:
    """Sum of the terms of a row with weights, by default `rewards.DEFAULT_WEIGHTS` [1/s]."""
    weights = rewards.DEFAULT_WEIGHTS if weights is None else weights
    return sum(weight * row[name] for name, weight in weights.items())


def task_weights() -> dict[str, dict[str, float]]:
    """Weights of the reward of each task (`wt_gym.tasks.TASKS`), in its newest version, that changes them."""
    given = {name: (task.arguments | task.versions[-1]).get("reward", {}) for name, task in TASKS.items()}
    return {name: rewards.DEFAULT_WEIGHTS | changed for name, changed in given.items() if changed}


def lifetime(rows: Iterable[Mapping], mean_wind: float = 10.0) -> list[dict]:
    """What each controller amounts to over the winds of a site, as differences to the baseline.

    Wind speeds follow the Rayleigh distribution of IEC 61400-1; each one simulated stands for the speeds nearer to it
    than to its neighbors, from 3 to 25 m/s. Means are weighted with that probability p, damage-equivalent loads by
    their damage: ``(sum p DEL^m)^(1/m)``.

    Parameters
    ----------
    rows : iterable of mapping
        As for `differences`.
    mean_wind : float
        Annual mean of the wind speed at hub height, 10 m/s for class I [m/s].

    Returns
    -------
    list of dict
        As `differences`, one row a controller.
    """
    rows = list(rows)
    winds = sorted({row["wind_speed"] for row in rows})
    edges = [3.0, *((low + high) / 2 for low, high in itertools.pairwise(winds)), 25.0]
    beyond = [math.exp(-math.pi / 4 * (edge / mean_wind) ** 2) for edge in edges]
    probability = {wind: low - high for wind, (low, high) in zip(winds, itertools.pairwise(beyond), strict=True)}
    whole = sum(probability.values())
    sums = {}
    for name in dict.fromkeys(row["controller"] for row in rows):
        own = [row for row in rows if row["controller"] == name]
        count = {wind: sum(row["wind_speed"] == wind for row in own) for wind in winds}
        share = [probability[row["wind_speed"]] / whole / count[row["wind_speed"]] for row in own]
        if not math.isclose(sum(share), 1.0):
            raise ValueError(f"controller {name!r} has no run in some of the winds {winds}")
        sums[name] = {"controller": name}
        for key in own[0].keys() - {"controller", "wind_speed", "seed"}:
            exponent = _EXPONENTS.get(key, 1.0)
            mean = sum(p * row[key] ** exponent for p, row in zip(share, own, strict=True))
            sums[name][key] = mean ** (1.0 / exponent) if key in _EXPONENTS else mean
    return [_difference(row, sums[BASELINE]) for name, row in sums.items() if name != BASELINE]


def correlation(first: Iterable[float], second: Iterable[float]) -> float:
    """Spearman's rank correlation of two columns; NaN where one of them is constant."""
    first, second = np.array(list(first)), np.array(list(second))
    if np.ptp(first) == 0.0 or np.ptp(second) == 0.0:
        return math.nan
    return float(spearmanr(first, second).statistic)
