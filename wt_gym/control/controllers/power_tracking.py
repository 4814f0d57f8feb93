"""Controllers that make no more power than a grid operator asks for, and as nearly as much as wind and rotor allow.

All have the law of the NREL 5-MW's controller (`wt_gym.control.controllers.discon`): filtered generator speed w,
torque curve M(w), pitch law on the speed error. The power that is asked for, over generator efficiency, is the power P
on the shaft of the generator; R is P over rated power, within ``least_share`` and 1. A rotor that could make more is
held back in one of the ways of ROSCO 2.10 (its power reference control, mode 2: factors on rated speed, on rated torque
and on the power coefficient at fine pitch; Abbas, Zalkind, Pao and Wright, Wind Energ. Sci. 7 (2022) 53, and the
documentation of the program), and in a fourth one:

- *by speed* (``derate_speed``, R_Speed): rated speed of the torque curve and reference speed of the pitch law are
  R w_rated, at rated torque. The speed goes no lower than just above region 2; what is left is done by torque;
- *by torque* (``derate_torque``, R_Torque): rated speed stays, ``M = min(M(w), P / w)``;
- *by pitch* (``derate_pitch``, R_Pitch): the least pitch is that at which the power coefficient at the best tip-speed
  ratio is R times the largest one. Below rated wind that leaves a reserve of 1 - R; above it the torque is
  ``min(M(w), P / w)``;
- *by torque, with the rotor as a store* (``derate_kinetic``): as by torque, but where the wind is too weak for P the
  torque stays at P / w and takes kinetic energy from the rotor, down to ``lowest_speed`` w_rated, where it has gone
  over to M(w), from which the rotor recovers. The reference speed of the pitch law is (1 + ``raised``) w_rated: the
  store is larger, and in winds that hardly suffice a faster rotor is nearer to its best tip-speed ratio. The power is
  that of the measured speed, not of the filtered one: the lag of the filter is an error of the power.

Running at rated speed while derated stores most kinetic energy (Aho, Fleming and Pao, American Control Conference 2016,
compare the ways; Lio, Mirzaei and Larsen, J. Phys. Conf. Ser. 1037 (2018) 032040, their loads).

Where no demanded power can be read, a share ``power_level`` of the rated power is followed.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.options import Options, option, option_record
from wt_gym.control.actions import Demand
from wt_gym.control.controllers.controller import Controller, Readings, demanded_power_of
from wt_gym.control.controllers.discon import BaselineParameters, DisconController
from wt_gym.control.controllers.tsr_tracking import TsrTrackingController
from wt_gym.control.rotor import rotor_table
from wt_gym.turbines import Turbine

WAYS = ("speed", "torque", "pitch", "kinetic")
"""How a rotor is held back."""
LEAST_SHARE = 0.2
"""Of rated power: less is not followed, a turbine that is asked for it is stopped [-]."""
_ABOVE_REGION_2 = 1.05
"""Least rated speed of the derated torque curve over the end of region 1 1/2 [-]."""
_SHARES = np.linspace(LEAST_SHARE, 1.0, 33)


@option_record
class DerateOptions(Options):
    """Parameters of a `PowerTracking`."""

    title = "derate"

    power_level: float = option(
        "share of the rated power that is followed where no demanded power is read", default=1.0, unit="-",
        low=LEAST_SHARE, high=1.0,
    )  # fmt: skip


@option_record
class KineticOptions(DerateOptions):
    """Parameters of a `PowerTracking` with the rotor as a store."""

    lowest_speed: float = option(
        "rotor speed over rated at which no more energy is taken from the rotor", default=0.9, unit="-", low=0.3,
        high=0.99,
    )  # fmt: skip
    raised: float = option(
        "rise of the reference speed over rated, by which more is stored", default=0.05, unit="-", low=0.0, high=0.1
    )
    band: float = option(
        "rotor speed over rated above it within which the store closes", default=0.1, unit="-", low=0.005, high=0.3
    )


def pitch_over_share(turbine: Turbine) -> NDArray[np.float64]:
    """Least pitch by which a share of the largest power coefficient is left at the best tip-speed ratio.

    Returns
    -------
    numpy.ndarray, shape (2, n)
        Shares of the power [-], ascending, and pitch [rad].
    """
    table, least = rotor_table(turbine), BaselineParameters.from_turbine(turbine).min_pitch
    angles = np.linspace(least, float(table.pitch[-1]), 400)
    at = np.array([table.power_coefficient(table.optimum[0], angle) for angle in angles.tolist()])
    top = int(np.argmax(at))
    falling = np.minimum.accumulate(at[top:]) / at[top]
    pitch = np.interp(_SHARES, falling[::-1], angles[top:][::-1])
    pitch[_SHARES == 1.0] = least
    return np.array([_SHARES, pitch])


class PowerTracking(DisconController):
    """A controller that follows the demanded power: reads the generator speed and what is asked for.

    Parameters
    ----------
    base : DisconController or TsrTrackingController
        Whose constants are taken; of one that tracks the tip-speed ratio those of its pitch law, beside the torque
        curve of the turbine.
    way : {"speed", "torque", "pitch", "kinetic"}
    **parameters
        Of `KineticOptions`.

    Raises
    ------
    ValueError
        If the generator is a damper, or the base is none with a torque curve.
    """

    def __init__(self, turbine: Turbine, base: Controller, way: str, **parameters: Any):
        o = KineticOptions(**parameters)
        if not turbine.drivetrain.takes_torque:
            raise ValueError(f"{turbine.name} has a damper as generator: its torque must be a demand to follow a power")
        if type(base) is DisconController:
            constants = base.parameters
        elif type(base) is TsrTrackingController:
            constants = base.parameters.baseline
        else:
            raise ValueError(
                "a demanded power can be followed on 'discon', 'retuned' or 'tsr_tracking': the base must be one of "
                f"them, got a {type(base).__name__}"
            )
        super().__init__(constants)
        self.way, self.lowest_speed, self.band, self.raised = way, o.lowest_speed, o.band, o.raised
        # in the order in which recorded starts hold the numbers
        self.shares, self.share_pitch = pitch_over_share(turbine)
        curve = constants.torque
        self._power = curve.rated_power  # on the shaft of the generator [W]
        self._least_speed_share = min(_ABOVE_REGION_2 * curve.region_2_speed / curve.rated_generator_speed, 1.0)
        self._measured = math.nan  # speed of the generator [rad/s]
        self.generator_efficiency, self.level = turbine.drivetrain.generator_efficiency, o.power_level

    @property
    def share(self) -> float:
        """R: power over rated power, within limits [-]."""
        return min(max(self._power / self.parameters.torque.rated_power, LEAST_SHARE), 1.0)

    @property
    def speed_share(self) -> float:
        """Rated speed over that of the turbine [-]."""
        if self.way == "kinetic":
            return 1.0 + self.raised
        return max(self.share, self._least_speed_share) if self.way == "speed" else 1.0

    @property
    def least_pitch(self) -> float:
        """Lower limit of the pitch [rad]."""
        least = self.parameters.min_pitch
        return max(least, float(np.interp(self.share, self.shares, self.share_pitch))) if self.way == "pitch" else least

    def _read(self, signals: Readings) -> None:
        """Take the speed and what is asked for."""
        self._measured, demanded = float(signals["generator_speed"]), demanded_power_of(signals)
        level = self.level * self.parameters.torque.rated_power
        self._power = level if demanded is None else demanded / self.generator_efficiency

    def start(self, signals: Readings, demand: Demand) -> None:
        """Start bumplessly at rated speed, whatever the reference speed is."""
        self._read(signals)
        super().start(signals, demand)
        p = self.parameters
        error = (1.0 - self.speed_share) * p.reference_speed
        self.speed_integral = float(p.pitch_law.holding(float(self.pitch[0]), error))

    def step(self, signals: Readings, dt: float) -> Demand:
        """Demand for the next ``dt`` [s]."""
        self._read(signals)
        return super().step(signals, dt)

    def shift_pitch(self, change: float) -> None:
        """Move the current command, as of `DisconController.shift_pitch`, no lower than the least pitch."""
        super().shift_pitch(max(change, min(self.least_pitch - float(self.pitch[0]), 0.0)))

    def _torque_law(self, pitch: float) -> float:
        p, power = self.parameters, self.share * self.parameters.torque.rated_power
        pitched = pitch >= self.least_pitch + p.region_3_min_pitch - p.min_pitch
        torque = min(self._curve(power, pitched), p.max_torque)
        if self.way != "kinetic":
            return torque
        held = min(power / max(self._measured, 1e-3), p.max_torque)
        speed = self._measured / p.reference_speed
        x = min(max((speed - self.lowest_speed) / self.band, 0.0), 1.0)  # opening of the store
        return held if held < torque else torque + x * x * (3.0 - 2.0 * x) * (held - torque)

    def _curve(self, power: float, pitched: bool) -> float:
        """Torque of the curve, of its own rated speed, at most that of the power [N m]."""
        p, speed = self.parameters, self.filtered_speed
        curve, share = p.torque, min(self.speed_share, 1.0)
        rated = share * curve.rated_generator_speed
        if speed <= 0.0:
            return 0.0
        if pitched or speed >= rated:
            torque = power / speed
        elif share == 1.0:
            torque = min(curve.torque(speed), power / speed)
        else:
            # region 2 1/2 ends with the torque of the power at the derated speed
            start = rated / (1.0 + curve.slip)
            line = power / rated * (speed - start) / (rated - start)
            torque = min(max(curve.torque(min(speed, curve.transition_speed)), line), power / speed)
        return torque if p.constant_power else min(torque, p.rated_torque)

    def _pitch_commands(self, previous: list[float], dt: float) -> list[float]:
        p = self.parameters
        error, step = self.filtered_speed - self.speed_share * p.reference_speed, p.max_pitch_rate * dt
        demand, self.speed_integral = p.pitch_law.step(
            previous[0], self.speed_integral, error, dt, self.least_pitch, p.max_pitch
        )
        # the limit of the rate goes before a least pitch that has just risen
        return [min(max(demand, now - step), now + step, p.max_pitch) for now in previous]
