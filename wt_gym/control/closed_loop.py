"""The simulator under demands that change at its own step, over a control step."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from wt_gym.control.actions import Demand
    from wt_gym.simulation import Signals, Simulator

__all__ = ["advance_controlled"]


def advance_controlled(
    demand_at: Callable[[int, Signals], Demand], simulator: Simulator, signals: Signals, step: float, count: int
) -> Signals:
    """Simulate several steps, each under a demand of its own.

    Parameters
    ----------
    demand_at : callable
        Demand for step k = 1 … count from the signals before it.
    simulator : Simulator
    signals : Signals
        Of the present instant.
    step : float
        Of the simulator [s].
    count : int
        Steps, at least 1.

    Returns
    -------
    Signals
        At the end, with the extremes and ways of all the steps.
    """
    for k in range(1, count + 1):
        demand = demand_at(k, signals)
        signals = simulator.advance(step, demand.pitch, demand.yaw_rate, demand.generator_torque, accumulate=k > 1)
    return signals
