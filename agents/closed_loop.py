"""A controller and the simulator in a loop, without an environment between them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.baseline import BaselineController, BaselineParameters
from wt_gym.control.operating_point import operating_point
from wt_gym.simulation import Recorder

if TYPE_CHECKING:
    from collections.abc import Callable

    from wt_gym.simulation import Simulator

__all__ = ["run_baseline"]


def run_baseline(
    simulator: Simulator,
    duration: float,
    control_dt: float | None = None,
    on_step: Callable | None = None,
    parameters: BaselineParameters | None = None,
    rotor_speed: float | None = None,
) -> Recorder:
    """Simulate under the baseline controller from the operating point of the inflow's mean speed.

    Parameters
    ----------
    simulator : Simulator
        Is reset.
    duration : float
        [s].
    control_dt : float, optional
        Interval of the controller, by default one aerodynamic time step [s].
    on_step : callable, optional
        Called with the signals after every interval.
    parameters : BaselineParameters, optional
        Constants of the controller, by default those of the turbine.
    rotor_speed : float, optional
        To start with, by default that of the operating point [rad/s].

    Returns
    -------
    Recorder
        Signals at the start and after every interval.
    """
    turbine = simulator.turbine
    dt = control_dt or simulator.time_step
    point = operating_point(turbine, simulator.inflow.mean_speed)
    speed = point.rotor_speed if rotor_speed is None else rotor_speed
    signals = simulator.reset(rotor_speed=speed, pitch=point.pitch)
    controller = BaselineController(parameters or BaselineParameters.from_turbine(turbine))
    controller.start(signals.generator_speed, signals.pitch, signals.generator_torque)
    recorder = Recorder(simulator, controller="baseline", control_interval_s=dt)
    recorder.append(signals)
    for _ in range(round(duration / dt)):
        pitch, torque = controller.step(signals.generator_speed, dt)
        signals = simulator.advance(dt, pitch=pitch, generator_torque=torque)
        recorder.append(signals)
        if on_step is not None:
            on_step(signals)
    return recorder
