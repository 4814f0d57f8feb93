"""A check of a turbine under its own controller: steady winds from cut-in to cut-out, and a verdict in each.

The turbine must hold its operating point: over the end of a run its speed stays within 2 % of rated speed around its
mean. It must make at least 90 % of the power of a table that comes with it, or of blade elements. Above rated wind it
must make at least 99 % of rated power, and its speed must be within 2 % of rated speed around that of the table or of
the operating point. Below rated wind the law of a table may have another speed at nearly the same power.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import SimulationError
from wt_gym.control.controllers import make_controller
from wt_gym.control.operating_point import operating_point
from wt_gym.experiment.execute import executor_for
from wt_gym.experiment.run import run_controller
from wt_gym.simulation import Simulator
from wt_gym.turbines import Turbine
from wt_gym.wind import SteadyInflow

if TYPE_CHECKING:
    from wt_gym.turbines.openfast_control import SteadyTable

DURATION = 100.0
"""Length of a run [s]."""
_AVERAGE = 30.0
"""End of a run over which means are taken [s]."""
_WINDS = 9
_WORKERS = 2
LARGEST_DEVIATION, LEAST_POWER, LEAST_RATED_POWER = 0.02, 0.9, 0.99
"""Limits of the speed over rated speed, of the power over that of the table, and above rated wind over rated [-]."""
_ABOVE_RATED = 1.15
"""Wind over rated wind from which on rated power and speed are expected [-]."""


@dataclass(frozen=True)
class SteadyRun:
    """Means over the end of a run in a steady wind."""

    wind: float  #: [m/s]
    rotor_speed: float = math.nan  #: [rad/s]
    pitch: float = math.nan  #: [rad]
    power: float = math.nan  #: electrical [W]
    thrust: float = math.nan  #: aerodynamic [N]
    deviation: float = math.nan  #: largest deviation of the rotor speed from its mean, over rated speed [-]
    failure: str = ""  #: message of a simulation that failed; "" for none


def steady_winds(turbine: Turbine) -> tuple[float, ...]:
    """Return nine winds from cut-in to cut-out [m/s]."""
    return tuple(np.linspace(turbine.cut_in, turbine.cut_out, _WINDS).round(2).tolist())


def steady_check(turbine: Turbine, on_point: Callable[[int, float], None] | None = None) -> list[SteadyRun]:
    """Run a turbine under its own controller in the winds of `steady_winds`, two at a time.

    Parameters
    ----------
    on_point : callable, optional
        Called with the number of finished runs and the time since the start [s].

    Returns
    -------
    list of SteadyRun
        In the order of the winds.
    """
    began, points = time.monotonic(), []
    with executor_for(workers=_WORKERS) as executor:
        for _, point in executor.results(partial(_run, turbine), steady_winds(turbine)):
            points.append(point)
            if on_point is not None:
                on_point(len(points), time.monotonic() - began)
    return sorted(points, key=lambda point: point.wind)


def _run(turbine: Turbine, wind: float) -> SteadyRun:
    """Run one wind."""
    simulator = Simulator(turbine, inflow=SteadyInflow(wind, hub_height=turbine.hub_height))
    point = SteadyRun(wind)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the caller has shown what is said of this controller
        controller = make_controller("discon", turbine)
    try:
        data = run_controller(simulator, controller, DURATION).to_dataset()
    except SimulationError as error:
        return replace(point, failure=str(error))
    end = data.sel(time=slice(DURATION - _AVERAGE, None))
    pitch = sum(float(end[f"pitch_{b + 1}"].mean()) for b in range(turbine.n_blades)) / turbine.n_blades
    speed = float(end.rotor_speed.mean())
    return replace(
        point,
        rotor_speed=speed,
        pitch=pitch,
        power=float(end.generator_power.mean()),
        thrust=float(end.aero_thrust.mean()),
        deviation=float(abs(end.rotor_speed - speed).max()) / turbine.drivetrain.rated_rotor_speed,
    )


def verdict(turbine: Turbine, point: SteadyRun, table: SteadyTable | None = None) -> str:
    """Return the faults of a point in words, "" where it is right.

    Parameters
    ----------
    table : SteadyTable, optional
        Without it, and outside its winds, blade elements and the operating point are the reference.
    """
    if point.failure:
        return point.failure
    faults = []
    if point.deviation > LARGEST_DEVIATION:
        faults.append(f"the rotor speed moves by {100.0 * point.deviation:.1f} % of rated")
    drivetrain, steady = turbine.drivetrain, operating_point(turbine, point.wind)
    reference, source = table.at(point.wind, "power") if table is not None else None, "the table's"
    if reference is None:
        torque = steady.generator_torque * drivetrain.gear_ratio * drivetrain.generator_efficiency
        reference, source = torque * steady.rotor_speed, "blade elements'"
    if point.power < LEAST_POWER * reference:
        faults.append(f"{point.power / reference:.0%} of {source} power")
    if point.wind > _ABOVE_RATED * turbine.rated_wind_speed:
        if point.power < LEAST_RATED_POWER * drivetrain.rated_power:
            faults.append(f"{point.power / drivetrain.rated_power:.1%} of rated power")
        speed, source = table.at(point.wind, "rotor_speed") if table is not None else None, "the table's"
        if speed is None:
            speed, source = steady.rotor_speed, "the operating point's"
        if abs(point.rotor_speed - speed) > LARGEST_DEVIATION * drivetrain.rated_rotor_speed:
            faults.append(f"{point.rotor_speed / speed:.1%} of {source} rotor speed")
    return "; ".join(faults)
