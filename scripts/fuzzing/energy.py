"""The energy that a turbine delivers beside that which the wind carries, from signals, apart from the simulator.

The simulator has balances of its own (`wt_gym.simulation.step.energy_kernels`), which end an episode. Here the
electrical energy and the kinetic energy of the rotor are set against Betz's share, 16/27 of rho A <|V|^3> / 2, of the
undisturbed wind over the disc. The turbine may have borrowed from the air round it, at most the kinetic energy of the
sphere of air that the rotor turns in, with what the rotor induces (v^2 = F / 2 rho A, Rankine and Froude). Blades that
swing in the plane of the rotor lend to the hub for a moment too, and take back: only a debt that lasts is one.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control.design import rotor_inertia
from wt_gym.turbines import Turbine
from wt_gym.wind import Inflow

if TYPE_CHECKING:
    from wt_gym.simulation import Signals

_BETZ = 16.0 / 27.0
_EXCESS_FACTOR = 2.0
"""Loans that a sum may reach before it counts as a finding: the wind is sampled once a control step only."""
_SWING = 5
"""Control steps through which a debt lasts: the slowest swing of blades in the plane, 1 s, is over."""
_RINGS = np.sqrt((np.arange(4) + 0.5) / 4)
_AZIMUTHS = 2.0 * math.pi * np.arange(8) / 8


class EnergyAccount:
    """Running account of an episode from its first signals.

    Attributes
    ----------
    excess : float
        Energy taken beyond Betz's share; sums below zero are forgotten [J].
    excess_limit : float
        What the air round the rotor may have lent [J].
    """

    def __init__(self, turbine: Turbine, inflow: Inflow, signals: Signals):
        radius = 0.5 * turbine.rotor_diameter
        self._area, self._density, self._inflow = math.pi * radius**2, turbine.air_density, inflow
        self._sphere = 0.5 * turbine.air_density * 4.0 / 3.0 * math.pi * radius**3
        self._half_inertia = 0.5 * rotor_inertia(turbine)
        disc = np.zeros((_RINGS.size, _AZIMUTHS.size, 3))
        disc[..., 1] = radius * np.outer(_RINGS, np.cos(_AZIMUTHS))
        disc[..., 2] = turbine.hub_height + radius * np.outer(_RINGS, np.sin(_AZIMUTHS))
        self._disc = disc.reshape(-1, 3)
        self._before, self._carried = signals, self._power_of_wind(signals)
        self.excess, self.excess_limit = 0.0, self._excess_limit(signals)
        self._excesses: deque[float] = deque(maxlen=_SWING)

    def take(self, signals: Signals, dt: float) -> None:
        """Book a step of length dt [s]."""
        before, carried = self._before, self._power_of_wind(signals)
        delivered = 0.5 * dt * (before["generator_power"] + signals["generator_power"])
        stored = self._half_inertia * (signals["rotor_speed"] ** 2 - before["rotor_speed"] ** 2)
        self.excess = max(self.excess + delivered + stored - 0.5 * dt * (carried + self._carried), 0.0)
        self._excesses.append(self.excess)
        self.excess_limit = max(self.excess_limit, self._excess_limit(signals))
        self._before, self._carried = signals, carried

    @property
    def exceeded(self) -> bool:
        """Whether more was delivered than the air had, in all of the last steps."""
        broken = [not debt <= _EXCESS_FACTOR * self.excess_limit for debt in self._excesses]
        return len(broken) == _SWING and all(broken)

    def _power_of_wind(self, signals: Signals) -> float:
        """Betz's share of what the wind carries through the disc [W]."""
        velocity = self._inflow.velocity(self._disc, signals["time"])
        squares = np.einsum("ij,ij->i", velocity, velocity)
        self._square = float(squares.mean())
        return _BETZ * 0.5 * self._density * self._area * float((squares**1.5).mean())

    def _excess_limit(self, signals: Signals) -> float:
        induced = abs(signals["aero_thrust"]) / (2.0 * self._density * self._area)
        return float(self._sphere * (self._square + induced))
