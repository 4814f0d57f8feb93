"""Time in which a turbine makes no power although the wind allows it and nothing has stopped it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wt_gym.control.controllers.controller import starting_part
from wt_gym.envs.rewards.power import DiscWind
from wt_gym.simulation.drivetrain.faults import GeneratorLoss, ShutDown, VoltageDip

if TYPE_CHECKING:
    from collections.abc import Iterable

    from wt_gym.control.controllers import Controller
    from wt_gym.simulation import Signals
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["IDLE_POWER", "LEAST_SPELL", "IdleClock"]

IDLE_POWER = 1e-3
"""Electrical power over rated power below which a turbine makes none [-]."""
LEAST_SPELL = 20.0
"""Time without power that counts in a run [s]: a rotor that a lull has slowed down takes some seconds to recover."""


class IdleClock:
    """Counts the time in which a turbine idles or stands without a reason.

    The turbine makes less than `IDLE_POWER` of its rated power. The mean wind over the rotor disc (`DiscWind`) lies
    between cut-in and cut-out. Nothing has stopped the turbine: no shut-down, loss of the generator or voltage dip has
    begun; the controller is in production (`wt_gym.control.controllers.Supervisor`; stages of ROSCO with ``start_stop``
    are not known); a demanded power is not zero.

    Parameters
    ----------
    turbine : Turbine

    Attributes
    ----------
    time : float
        Length of the present spell, 0 while there is a reason or the turbine makes power [s].
    total : float
        Length of all spells of at least `LEAST_SPELL` [s].
    """

    def __init__(self, turbine: Turbine):
        self._least = IDLE_POWER * turbine.drivetrain.rated_power
        self._cut_in, self._cut_out = turbine.cut_in, turbine.cut_out
        self._disc = DiscWind(turbine)
        self.start()

    def start(self) -> None:
        """Begin a run."""
        self.time = self.total = 0.0

    def advance(
        self,
        signals: Signals,
        dt: float,
        inflow: Inflow | None,
        controller: Controller | None = None,
        faults: Iterable[object] = (),
        demanded: float | None = None,
    ) -> None:
        """Count a step; nothing is computed while the turbine makes power.

        Parameters
        ----------
        signals : Signals
            At the end of the step.
        dt : float
            Its length [s].
        inflow : Inflow or None
        controller : Controller, optional
        faults : iterable
            Faults of the run.
        demanded : float, optional
            Demanded power [W].
        """
        if signals["generator_power"] >= self._least or self._has_reason(signals, inflow, controller, faults, demanded):
            self.time = 0.0
            return
        before, self.time = self.time, self.time + dt
        if self.time >= LEAST_SPELL:
            self.total += dt if before >= LEAST_SPELL else self.time

    def _has_reason(
        self,
        signals: Signals,
        inflow: Inflow | None,
        controller: Controller | None,
        faults: Iterable[object],
        demanded: float | None,
    ) -> bool:
        """Return True where wind, grid, fault or controller explain that there is no power."""
        if demanded is not None and demanded < self._least:
            return True
        if not self._cut_in < self._disc.begin(inflow, signals) < self._cut_out:
            return True
        if not getattr(starting_part(controller), "in_production", True):
            return True
        now = signals["time"]
        return any(
            now < fault.recovered if isinstance(fault, VoltageDip) else isinstance(fault, ShutDown | GeneratorLoss)
            for fault in faults
            if getattr(fault, "time", now) <= now
        )
