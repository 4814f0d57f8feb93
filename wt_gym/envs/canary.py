"""Canary of the package for a turbine: numbers of a few short episodes, by which two versions of the package compare.

It holds samples of observations, rewards, costs, terminations and signals of four episodes of a few seconds, demands of
the controllers by name for the readings of one of them, and random draws of winds and faults. `wt_gym.base.canary`
stores and compares canaries.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.canary import Canary, cached_canary, canary_text
from wt_gym.base.errors import InflowError, SimulationError
from wt_gym.control import Demand
from wt_gym.control.controllers import WithDemandedPower, readings_of
from wt_gym.control.controllers.names import make_controller
from wt_gym.envs.faults import FAULT_KINDS, GRID_KINDS, SIZES, FaultOptions, FaultTerm
from wt_gym.envs.record_store import user_record_digest
from wt_gym.envs.running_record import time_scale
from wt_gym.envs.wind_sampler import WindOptions, WindSampler
from wt_gym.simulation import Fidelity, Signals
from wt_gym.simulation.contract import fingerprint
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.turbines import Turbine
from wt_gym.wind.inflow import fill_velocity
from wt_gym.wind.turbulent import speed_path

if TYPE_CHECKING:
    from wt_gym.envs.turbine_env import WindTurbineEnv

MakeEnv: TypeAlias = "Callable[..., WindTurbineEnv]"
"""Makes an environment of its arguments: that class, which stands above this module."""
_STEP = 0.1  # Control step of the episodes of a large turbine [s]
_SAMPLES = 4  # Samples of a signal in an episode
_SIGNALS = (
    "rotor_speed", "generator_power", "aero_thrust", "pitch", "root_flap_moment", "tower_base_fore_aft_moment",
    "tower_top_side_side",
)  # fmt: skip
_WINDS = ("steady", "gusts", "turbulent")
_CONTROLLERS = (
    "discon", "retuned", "tsr_tracking", "discon+ipc_2p", "discon+constrained_ipc", "discon+linear_optimal",
    "discon+tower_dampers", "discon+yaw", "discon+supervisor", "discon+fault_supervisor", "discon+derate_speed",
    "discon+derate_torque", "discon+derate_pitch", "discon+derate_kinetic", "discon+lidar",
)  # fmt: skip


def canary_of(turbine: Turbine, fidelity: str | Fidelity, make: MakeEnv) -> Canary:
    """Canary of the environment, from the cache or measured."""
    key = fingerprint(turbine, fidelity_of(fidelity), user_record_digest(turbine))
    return cached_canary("environment", key, lambda: environment_canary(turbine, fidelity, make))


def environment_canary(turbine: Turbine, fidelity: str | Fidelity, make: MakeEnv) -> Canary:
    """Measure the canary of the environment."""
    canary = {f"draws/{name}": canary_text(numbers) for name, numbers in (_winds(turbine) | _faults(turbine)).items()}
    for name, (time, arguments, options) in _episodes(turbine).items():
        try:
            arguments |= {"turbine": turbine, "fidelity": fidelity, "control_dt": control_step(turbine, fidelity)}
            run = _Run(make(**arguments, episode_length=None), time * time_scale(turbine), options)
        except (InflowError, SimulationError) as error:  # the turbine has no such episode, which is a behavior too
            canary[f"{name}/start"] = type(error).__name__
            continue
        canary |= {f"{name}/{channel}": text for channel, text in run.numbers().items()}
        if name == "residual":
            canary |= _demands(run)
    return canary


def _episodes(turbine: Turbine) -> dict[str, tuple[float, dict[str, Any], dict[str, Any]]]:
    """Length of each episode [s] for a large turbine, arguments of the environment, and options of the reset."""
    speeds = tuple(min(share * turbine.rated_wind_speed, 0.95 * turbine.cut_out) for share in (1.15, 1.3))
    torque = ("torque",) if turbine.drivetrain.takes_torque else ()
    half_speed = {"rotor_speed": 0.5 * turbine.drivetrain.rated_rotor_speed}
    residual = {
        "action_mode": "residual", "pitch": "fixed-frame", "residual_fade": True, "residual_washout": 15.0,
        "inflow": "turbulent", "wind_speed": speeds,
    }  # fmt: skip
    steady = {"inflow": "steady", "wind_speed": speeds, "start": "steady"}
    return {
        # running start; residual actions in their fade and washout; rewards; observations with noise
        "residual": (5.0, {
            **residual, "action_components": ("pitch", *torque), "sensor_noise": 1.0, "history": 2,
            "reward": dict.fromkeys(("tip_deflection", "tower_load", "extreme_loads", "damage"), 0.1),
            "observation": ("rotor", "power", "pitch", "wind", "wind_estimate", "blades", "fixed_frame", "tower",
                            "azimuth", "controller", "offsets", "lidar", "previous_action"),
        }, {}),
        # drawn plant, wind and instruments; sensors of controllers; washed observations
        "variation": (2.5, {
            **residual, "action_components": ("pitch",), "variation": "train", "sensors": "all",
            "observation": ("measurable",), "sensor_washout": 20.0,
        }, {}),
        # faults of a drive or a sensor; wind from the side; yaw; absolute actions from an operating point
        "faults": (2.5, {
            **steady, "wind_direction": (-0.3, 0.3), "action_mode": "absolute",
            "action_components": ("pitch", "yaw", *torque), "fault_kinds": ("misaligned_blade", "biased_moment"),
            "fault_time": (0.2, 1.0),
        }, {}),
        # a rotor that is too slow: the first step ends the episode
        "termination": (1.0, {
            **steady, "action_mode": "rate", "standstill_limit": 0.9, "termination_penalty": 10.0,
        }, half_speed),
    }  # fmt: skip


def _winds(turbine: Turbine) -> dict[str, Iterable[float]]:
    """Drawn winds of each kind with velocities in them, and a path of the mean speed."""
    points = np.array([[0.0, y, turbine.hub_height + y] for y in (-0.3, 0.0, 0.4)]) * [1.0, turbine.rotor_diameter, 1.0]
    numbers: dict[str, Iterable[float]] = {}
    for kind in _WINDS:
        rng = np.random.default_rng(3)
        try:
            wind = WindSampler(turbine, WindOptions(inflow=kind)).sample(rng)
        except InflowError:  # no class of IEC 61400-1
            numbers[f"{kind} velocity"] = []
            continue
        velocities = np.empty((2, *points.shape))
        for time, velocity in zip((0.0, 7.0), velocities, strict=True):
            fill_velocity(wind.inflow, points, time, velocity)
        numbers |= {f"{kind} velocity": velocities.ravel(), f"{kind} seed": [wind.wind_seed]}
        numbers |= {f"{kind} speed": [wind.wind_speed], f"{kind} time": [wind.time_offset]}
    times, speeds = speed_path(np.random.default_rng(3), turbine.cut_in, turbine.cut_out, (200.0, 400.0), 600.0)
    return numbers | {"path": speeds[:: len(times) // 8].tolist()}


def _faults(turbine: Turbine) -> dict[str, Iterable[float]]:
    """Drawn faults of each kind: place among the kinds, blade, time and size."""
    kinds, rng, rows = (*FAULT_KINDS, *GRID_KINDS), np.random.default_rng(4), []
    for sizes in SIZES:
        draws = FaultTerm(turbine, FaultOptions(kinds=kinds, sizes=sizes, time=(5.0, 20.0)))
        for kind in (None, None, *kinds):
            fault = draws.drawn(rng, kind)
            rows.append((kinds.index(fault.kind), fault.blade, fault.time, fault.size))
    return dict(zip(("fault kind", "fault blade", "fault time", "fault size"), zip(*rows, strict=True), strict=True))


def _demands(run: _Run) -> Canary:
    """Demands of the controllers by name after they have read the signals of an episode.

    A controller that this turbine cannot have, and the lidar of a small, fast one, whose table takes a minute, are left
    out.
    """
    env, canary = run.env, {}
    turbine, inflow = env.turbine, env.episode_wind.inflow
    power = 0.8 * turbine.drivetrain.rated_power
    for name in _CONTROLLERS:
        if name == "discon+lidar" and time_scale(turbine) < 0.5:
            continue
        try:
            controller = make_controller(name, turbine)
        except ValueError as error:
            canary[f"controllers/{name}"] = type(error).__name__
            continue
        demand = Demand(np.array(run.signals[0].pitch), 0.0, run.signals[0].generator_torque)
        for k, signals in enumerate(run.signals):
            readings = readings_of(controller, signals, inflow, turbine.hub_height, turbine.rotation)
            readings = WithDemandedPower(readings, power)
            if k == 0:
                controller.start(readings, demand)
            demand = controller.step(readings, env.control_dt)
        rows: dict[str, Iterable[float]] = {"torque": [demand.generator_torque], "yaw rate": [demand.yaw_rate]}
        rows["pitch"] = np.broadcast_to(demand.pitch, turbine.n_blades)
        canary |= {f"controllers/{name} {of}": canary_text(numbers) for of, numbers in rows.items()}
    return canary


def control_step(turbine: Turbine, fidelity: str | Fidelity) -> float:
    """Control step of short episodes: whole steps of the simulator [s]."""
    step = fidelity_of(fidelity).step_for(turbine.drivetrain.rated_rotor_speed)
    return step * max(1, round(time_scale(turbine) * _STEP / step))


class _Run:
    """Short episode of a time [s] with actions that change from step to step."""

    def __init__(self, env: WindTurbineEnv, time: float, options: dict[str, Any]):

        self.env = env
        observation, _ = env.reset(seed=1, options=options)
        self.observations: list[NDArray[np.float32]] = [observation]
        self.signals: list[Signals] = [env.signals]
        self.outcomes: list[tuple[float, float, bool]] = []  # reward, cost and termination of each step
        rng, size = np.random.default_rng(2), env.layout.action.size
        for _ in range(round(time / env.control_dt)):
            observation, reward, terminated, _, info = env.step(rng.uniform(-1.0, 1.0, size))
            self.observations.append(observation)
            self.signals.append(env.signals)
            self.outcomes.append((float(reward), info["cost"], terminated))
            if terminated:
                break
        env.close()

    def numbers(self) -> Canary:
        """Samples of the signals, of rewards and costs, and of the observations."""
        at = np.unique(np.linspace(0, len(self.signals) - 1, _SAMPLES).astype(int))
        steps = np.unique(np.linspace(0, len(self.outcomes) - 1, 2 * _SAMPLES).astype(int))
        reward, cost, terminated = np.array(self.outcomes, dtype=np.float64).T
        rows = {name: np.array([self.signals[k][name] for k in at]).ravel() for name in _SIGNALS} | {
            "reward": reward[steps], "return": [reward.sum()], "cost": [cost.sum()],
            "terminated": [terminated.sum(), len(terminated)], "observation": self.observations[-1],
        }  # fmt: skip
        return {name: canary_text(values) for name, values in rows.items()}
