"""One run of a design load case: an agent in its environment, or a parked turbine that nobody controls."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.analysis.metrics import idle_time, run_metrics
from wt_gym.base.errors import SimulationError
from wt_gym.control import Demand
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.loadcases.cases import EVENT, SKIP, inflow_of
from wt_gym.runs.playing import play, run_controller
from wt_gym.simulation import Recorder, Simulator
from wt_gym.simulation.drivetrain.faults import FEATHER
from wt_gym.turbines.variants import unloaded_clearance

if TYPE_CHECKING:
    import gymnasium as gym
    import xarray as xr

    from wt_gym.control.controllers.controller import Readings
    from wt_gym.envs.episode import Agent
    from wt_gym.experiment.loadcases.cases import Condition
    from wt_gym.simulation import Fidelity
    from wt_gym.turbines import Turbine

__all__ = ["COMPLETE", "EXTREMES", "TRACES", "run_agent", "run_parked"]

EXTREMES = ("blade_flap_max", "blade_edge_max", "tower_base_max", "rotor_speed_max", "tip_clearance_min")
"""What is kept of a run: largest sizes of moments [N m], largest rotor speed [rad/s], smallest clearance [m]."""
_FATIGUE = ("blade_flap_del", "blade_edge_del", "tower_fore_aft_del", "tower_side_side_del")
TRACES = ("wind_x", "rotor_speed", "generator_power", "pitch_1", "root_flap_moment_1", "tower_base_fore_aft_moment")
"""Signals that are kept of a transient, from 10 s before it on."""
COMPLETE = ("time", "stopped")
"""Ends of runs that went as planned: their time is over, or the rotor has come to rest after a shut-down."""
_SEED = 2**40 + 2**33
"""Seeds of the environment, for noise: beyond those of any training and evaluation."""
_BEFORE_EVENT = 10.0
_LEAST_MEASURED = 2.0
_PARKED_STEP = 0.2


def run_agent(env: gym.Env, agent: Agent, condition: Condition) -> dict[str, Any]:
    """Run an agent.

    What the simulation does not survive is a result as any other.

    Parameters
    ----------
    env : gymnasium.Env
        Without a limit of time.
    agent : Agent
    condition : Condition

    Returns
    -------
    dict
        JSON values: ``ending`` ("time", "stopped", or why the episode was terminated), ``failure`` (message or None),
        ``time`` [s], ``idle_time`` (`wt_gym.envs.terminations.IdleClock.total`) [s], ``extremes`` (`EXTREMES`) and
        ``fatigue`` after the skipped start, None where there was nothing to measure, ``unloaded_clearance`` [m], and
        ``trace``: signals of a transient.
    """
    plain = turbine_env_of(env)
    options = {
        "inflow": inflow_of(condition, plain.turbine), "faults": condition.faults,
        "azimuth": math.radians(condition.azimuth),
    }  # fmt: skip
    seed = _SEED + (condition.seed or 0)
    try:
        found = play(env, agent, seed=seed, options=options, duration=condition.duration)
    except SimulationError as error:
        return _nothing(str(error))
    ending, stops = found.ending, condition.stops_at
    if ending == "standstill" and stops is not None and plain.signals["time"] > stops:
        ending = "stopped"
    return _result(found.data, plain.turbine, condition, ending, found.failure)


class _Feathered:
    """Holds the blades at feather and asks for nothing else."""

    channels: tuple[str, ...] = ()

    def __init__(self, pitch: float, n_blades: int):
        self._demand = Demand(np.full(n_blades, pitch), 0.0, 0.0)

    def start(self, readings: Readings, demand: Demand) -> None:
        """Need nothing."""

    def step(self, readings: Readings, dt: float) -> Demand:
        """Give the same demand."""
        return self._demand


def run_parked(turbine: Turbine, fidelity: str | Fidelity, condition: Condition) -> dict[str, Any]:
    """Run a turbine that idles with feathered blades, from rest; as `run_agent`, without an agent."""
    simulator = Simulator(turbine, inflow_of(condition, turbine), fidelity)
    step = simulator.time_step * max(1, round(_PARKED_STEP / simulator.time_step))
    pitch, recorder = min(FEATHER, turbine.pitch.max_pitch), Recorder(simulator)
    rest = {
        "rotor_speed": 0.0, "pitch": pitch, "azimuth": math.radians(condition.azimuth), "generator_torque": 0.0,
    }  # fmt: skip
    ending, failure = "time", None
    try:
        feathered = _Feathered(pitch, turbine.n_blades)
        run_controller(simulator, feathered, condition.duration, step, recorder=recorder, start=rest)
    except SimulationError as error:
        if not len(recorder):
            return _nothing(str(error))
        ending, failure = "failure", str(error)
    return _result(recorder.to_dataset(), turbine, condition, ending, failure)


def _nothing(failure: str | None) -> dict[str, Any]:
    """Result of a run that could not start."""
    return {
        "ending": "failure", "failure": failure, "time": 0.0, "extremes": None, "fatigue": None,
        "idle_time": 0.0, "unloaded_clearance": None, "trace": None,
    }  # fmt: skip


def _result(
    data: xr.Dataset, turbine: Turbine, condition: Condition, ending: str, failure: str | None
) -> dict[str, Any]:
    """What is kept of a run."""
    time = data["time"].values
    result = _nothing(failure) | {
        "ending": ending,
        "time": float(time[-1]),
        "idle_time": idle_time(data),
        "unloaded_clearance": unloaded_clearance(turbine),
    }
    if time[-1] >= SKIP + _LEAST_MEASURED:
        metrics = run_metrics(data.isel(time=slice(1, None)), turbine, SKIP)
        edge = [np.abs(data[f"root_edge_moment_{b + 1}"].values[time >= SKIP]).max() for b in range(turbine.n_blades)]
        metrics["blade_edge_max"] = float(max(edge))
        result |= {
            "extremes": {name: metrics[name] for name in EXTREMES},
            "fatigue": {name: metrics[name] for name in _FATIGUE},
        }
    if condition.seed is None:
        kept = time >= EVENT - _BEFORE_EVENT
        result["trace"] = {
            name: [float(f"{value:.5g}") for value in values[kept]]
            for name, values in (("time", time), *((name, data[name].values) for name in TRACES))
        }
    return result
