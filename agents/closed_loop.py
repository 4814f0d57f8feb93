"""A controller and the simulator in a loop, without an environment between them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control import Demand
from wt_gym.control.controllers import checked_demand, make_controller, readings_of
from wt_gym.control.controllers.discon import BaselineParameters, DisconController
from wt_gym.control.starting_point import starting_point
from wt_gym.simulation import Recorder

if TYPE_CHECKING:
    from collections.abc import Callable

    from wt_gym.control.controllers import Controller
    from wt_gym.simulation import Simulator

__all__ = ["run_baseline", "run_controller"]


def run_controller(
    simulator: Simulator,
    controller: Controller,
    duration: float,
    control_dt: float | None = None,
    on_step: Callable | None = None,
    rotor_speed: float | None = None,
    name: str = "controller",
    recorder: Recorder | None = None,
) -> Recorder:
    """Simulate under a controller from the operating point of the inflow's mean speed.

    Parameters
    ----------
    simulator : Simulator
        Is reset.
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
        That gets the signals, by default a new one. Whoever gives one has what was simulated where a run is stopped.

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
    point = starting_point(simulator.turbine, simulator.inflow)
    speed = point.rotor_speed if rotor_speed is None else rotor_speed
    signals = simulator.reset(rotor_speed=speed, pitch=point.pitch)
    inflow, height, n_blades = simulator.inflow, simulator.turbine.hub_height, simulator.turbine.n_blades
    controller.start(
        readings_of(controller, signals, inflow, height), Demand(np.array(signals.pitch), 0.0, signals.generator_torque)
    )
    recorder = Recorder(simulator) if recorder is None else recorder
    recorder.attributes |= {"controller": name, "control_interval_s": dt}
    recorder.append(signals)
    for _ in range(round(duration / dt)):
        demand = controller.step(readings_of(controller, signals, inflow, height), dt)
        demand = checked_demand(demand, controller, n_blades)
        signals = simulator.advance(
            dt, pitch=demand.pitch, yaw_rate=demand.yaw_rate, generator_torque=demand.generator_torque
        )
        recorder.append(signals)
        if on_step is not None:
            on_step(signals)
    return recorder


def run_baseline(
    simulator: Simulator,
    duration: float,
    control_dt: float | None = None,
    on_step: Callable | None = None,
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
