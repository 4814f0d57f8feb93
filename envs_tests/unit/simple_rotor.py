"""A rotor of a few lines, for tests of controllers from standstill to storm."""

import math

from wt_gym.control.design import rotor_inertia
from wt_gym.control.rotor import rotor_table


class SimpleRotor:
    """A rotor with the coefficients of the turbine's table, and where those end that of a section at 70 % radius.

    Attributes
    ----------
    speed : float
        [rad/s].
    """

    def __init__(self, turbine, speed=0.0):
        self.table, self.inertia = rotor_table(turbine), rotor_inertia(turbine)
        self.gear, self.n_blades, self.speed = turbine.drivetrain.gear_ratio, turbine.n_blades, speed
        self.arm, self.size = 0.7 * self.table.radius, self.table.radius / 63.0

    def air(self, wind, pitch):
        """Moment of the air [N m] in a wind [m/s] at a pitch [rad]."""
        around = self.arm * self.speed
        if pitch <= self.table.pitch[-1] and around > 1.5 * wind:
            return self.table.torque(wind, self.speed, pitch)
        inflow = math.atan2(wind, around)
        attack = inflow - pitch
        lift = 2.0 * math.pi * math.sin(attack) if abs(attack) < 0.2 else math.sin(2.0 * attack)
        drag = 0.01 + 1.3 * math.sin(attack) ** 2
        force = lift * math.sin(inflow) - drag * math.cos(inflow)
        area = self.n_blades * 3.5 * 40.0 * self.size**2
        return 0.5 * 1.225 * area * self.arm * (wind * wind + around * around) * force

    def advance(self, dt, wind, pitch, torque):
        """Turn for ``dt`` [s] under a generator torque [N m]."""
        self.speed = max(self.speed + dt * (self.air(wind, pitch) - self.gear * torque) / self.inertia, 0.0)
        return self.speed
