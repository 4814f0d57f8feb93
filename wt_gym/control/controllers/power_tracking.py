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

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from wt_gym.base.options import Options, option, option_record
from wt_gym.control.controllers.controller import demanded_power_of
from wt_gym.control.controllers.discon import BaselineController, BaselineParameters, DisconController
from wt_gym.control.controllers.tsr_tracking import TsrTrackingController
from wt_gym.control.rotor import RotorTable, rotor_table

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from wt_gym.control.actions import Demand
    from wt_gym.control.controllers.controller import Controller, Readings
    from wt_gym.control.controllers.discon import BaselineState
    from wt_gym.turbines import Turbine

__all__ = [
    "WAYS", "DerateOptions", "KineticOptions", "PowerTracking", "PowerTrackingLaw", "pitch_over_share",

]  # fmt: skip

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


def pitch_over_share(turbine: Turbine, table: RotorTable | None = None) -> NDArray[np.float64]:
    """Least pitch by which a share of the largest power coefficient is left at the best tip-speed ratio.

    By default of the turbine's own table.

    Returns
    -------
    numpy.ndarray, shape (2, n)
        Shares of the power [-], ascending, and pitch [rad].
    """
    table = rotor_table(turbine) if table is None else table
    ratio, _ = table.optimum
    least = BaselineParameters.from_turbine(turbine).min_pitch
    angles = np.linspace(least, float(table.pitch[-1]), 400)
    at = np.array([table.power_coefficient(ratio, angle) for angle in angles.tolist()])
    top = int(np.argmax(at))
    falling = np.minimum.accumulate(at[top:]) / at[top]
    pitch = np.interp(_SHARES, falling[::-1], angles[top:][::-1])
    pitch[_SHARES == 1.0] = least
    return np.array([_SHARES, pitch])


class PowerTrackingLaw(BaselineController):
    """Law of the baseline that makes no more than a power.

    Parameters
    ----------
    way : {"speed", "torque", "pitch", "kinetic"}
    shares, pitch : array_like, shape (n,)
        As of `pitch_over_share`.
    store : KineticOptions
        Speed at which the store is shut, by how much faster it is open, and rise of the reference speed.

    Attributes
    ----------
    power : float
        On the shaft of the generator, to be set before a step [W].
    """

    def __init__(
        self, parameters: BaselineParameters, way: str, shares: ArrayLike, pitch: ArrayLike, store: KineticOptions
    ) -> None:
        super().__init__(parameters)
        if way not in WAYS:
            raise ValueError(f"the way must be one of {WAYS}, got {way!r}")
        self.way, self.lowest_speed, self.band, self.raised = way, store.lowest_speed, store.band, store.raised
        self._shares, self._share_pitch = np.asarray(shares, dtype=np.float64), np.asarray(pitch, dtype=np.float64)
        self.power = parameters.torque.rated_power
        curve = parameters.torque
        self._least_speed_share = min(_ABOVE_REGION_2 * curve.region_2_speed / curve.rated_generator_speed, 1.0)
        self._measured = math.nan

    @property
    def share(self) -> float:
        """R: power over rated power, within limits [-]."""
        return min(max(self.power / self.parameters.torque.rated_power, LEAST_SHARE), 1.0)

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
        if self.way != "pitch":
            return least
        return max(least, float(np.interp(self.share, self._shares, self._share_pitch)))

    def start(self, generator_speed: float, pitch: ArrayLike, torque: float = math.nan) -> None:
        """Start bumplessly at rated speed, as of `BaselineController.start`, whatever the reference speed is."""
        super().start(generator_speed, pitch, torque)
        state, p = cast("BaselineState", self.state), self.parameters
        error = (1.0 - self.speed_share) * p.reference_speed
        integral = p.pitch_law.holding(float(state.pitch[0]), error)
        self.state = replace(state, speed_integral=float(integral))

    def step(self, generator_speed: float, dt: float) -> tuple[NDArray[np.float64], float]:
        """Advance by one call; arguments and results as of `BaselineController.step`."""
        self._measured = float(generator_speed)
        return super().step(generator_speed, dt)

    def _torque_law(self, filtered_speed: float, pitch: float) -> float:
        p, power = self.parameters, self.share * self.parameters.torque.rated_power
        pitched = pitch >= self.least_pitch + p.region_3_min_pitch - p.min_pitch
        torque = min(self._curve(filtered_speed, power, pitched), p.max_torque)
        if self.way != "kinetic":
            return torque
        held = min(power / max(self._measured, 1e-3), p.max_torque)
        return held if held < torque else torque + self._open(self._measured / p.reference_speed) * (held - torque)

    def _curve(self, speed: float, power: float, pitched: bool) -> float:
        """Torque of the curve, of its own rated speed, at most that of the power [N m]."""
        p = self.parameters
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

    def _open(self, speed: float) -> float:
        """Opening of the store at a speed over the reference speed, 0 … 1."""
        x = min(max((speed - self.lowest_speed) / self.band, 0.0), 1.0)
        return x * x * (3.0 - 2.0 * x)

    def _pitch(self, filtered_speed: float, previous: list[float], dt: float) -> tuple[list[float], float]:
        p = self.parameters
        error = filtered_speed - self.speed_share * p.reference_speed
        low, high = self.least_pitch, p.max_pitch
        before, integral = previous[0], cast("BaselineState", self.state).speed_integral
        demand, integral = p.pitch_law.step(before, integral, error, dt, low, high)
        step = p.max_pitch_rate * dt
        # the limit of the rate goes before a least pitch that has just risen
        return [min(max(demand, now - step), now + step, high) for now in previous], integral

    def shift_pitch(self, change: float) -> None:
        """Move the present command, as of `BaselineController.shift_pitch`, no lower than the least pitch."""
        state = cast("BaselineState", self.state)
        lowest = min(self.least_pitch - float(state.pitch[0]), 0.0)
        super().shift_pitch(max(change, lowest))


class PowerTracking(DisconController):
    """A controller that follows the demanded power: reads the generator speed and what is asked for.

    Parameters
    ----------
    generator_efficiency : float
        Electrical power over that on the shaft of the generator [-].
    level : float
        Share of the rated power that is followed where no demanded power is read [-].
    """

    def __init__(self, law: PowerTrackingLaw, generator_efficiency: float, level: float = 1.0):
        self.law: PowerTrackingLaw = law
        self.generator_efficiency, self.level = float(generator_efficiency), float(level)

    @classmethod
    def of_turbine(cls, turbine: Turbine, base: Controller, way: str, **parameters: Any) -> PowerTracking:
        """By rule for a turbine.

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
        options = KineticOptions(**parameters)
        shares, pitch = pitch_over_share(turbine)
        law = PowerTrackingLaw(constants, way, shares, pitch, options)
        return cls(law, turbine.drivetrain.generator_efficiency, options.power_level)

    def _ask(self, signals: Readings) -> None:
        """Tell the law what is asked for."""
        demanded = demanded_power_of(signals)
        if demanded is None:
            self.law.power = self.level * self.law.parameters.torque.rated_power
        else:
            self.law.power = demanded / self.generator_efficiency

    def start(self, signals: Readings, demand: Demand) -> None:
        """Start bumplessly from the present demand."""
        self._ask(signals)
        super().start(signals, demand)

    def step(self, signals: Readings, dt: float) -> Demand:
        """Demand for the next ``dt`` [s]."""
        self._ask(signals)
        return super().step(signals, dt)
